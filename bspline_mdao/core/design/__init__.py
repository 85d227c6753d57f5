"""Variables and constraints: what may change of the surface control points, and deformations by name."""
