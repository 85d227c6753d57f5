"""Many designs of one problem: plans of them, and a file of their grids."""
