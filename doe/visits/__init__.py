"""In which order the poses of a plan are visited, and which of them again."""
