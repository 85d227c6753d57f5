"""A fitted grid, and the file that holds it."""
