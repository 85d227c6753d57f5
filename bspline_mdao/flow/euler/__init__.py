"""Steady compressible Euler flow on the cells of a multi-block grid, and its derivatives: pure kernels."""
