"""Fit a multi-block grid with B-spline volumes: parameters, knots, least squares and parameter correction (II.D)."""
