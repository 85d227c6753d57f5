"""Evaluation of fitted grids: nodes from control points, family members, metrics, parameters of points."""
