"""B-splines, Eqs. (1) to (5): curves, volumes and curved knots."""
