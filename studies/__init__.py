"""studies: what a person runs."""
