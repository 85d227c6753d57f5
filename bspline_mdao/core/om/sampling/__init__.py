"""Many designs of one problem: design plans, and a file of their grids."""
