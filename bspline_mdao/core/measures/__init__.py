"""Measures of the surface: thickness, volume, area, radius, angle, curvature and clearance."""
