"""Unstructured meshes, moved with their walls by a background B-spline lattice."""
