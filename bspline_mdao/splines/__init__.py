"""B-spline curves, surfaces and volumes with curved knots."""
