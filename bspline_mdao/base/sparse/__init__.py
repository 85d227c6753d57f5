"""Sparse matrices of 3 x 3 blocks: Cholesky factors, conjugate gradients and incomplete factors."""
