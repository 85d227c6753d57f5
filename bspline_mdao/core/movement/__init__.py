"""Movers of the mesh, Eqs. (6) to (8): elasticity, springs, radial basis functions and others (section III)."""
