"""Grids from control points, II.E: nodes, family members, metrics, parameters of points."""
