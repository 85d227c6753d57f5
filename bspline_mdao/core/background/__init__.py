"""Meshes without structure: a B-spline lattice in the background moves them behind their walls."""
