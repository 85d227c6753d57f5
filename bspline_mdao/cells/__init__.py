"""Cells of a grid: orthogonality (Eq. 9), Jacobians, volumes, first cells at walls, aggregates and reports."""
