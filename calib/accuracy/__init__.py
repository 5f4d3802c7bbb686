"""How accurate an identified robot is: by source, at its targets, and against a tolerance."""
