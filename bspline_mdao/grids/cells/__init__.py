"""Cells and their quality, Eq. (9): orthogonality, Jacobians, volumes, first cells at walls, aggregates, reports."""
