"""Sparse symmetric matrices of 3 x 3 blocks and their solvers."""
