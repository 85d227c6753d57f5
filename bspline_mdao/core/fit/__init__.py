"""The fit of a grid, II.D: parameters, knots, least squares and parameter correction."""
