"""Measures of the regenerated surface: thickness, volume, area, radius, angle, curvature and clearance."""
