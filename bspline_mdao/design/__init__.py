"""Design variables and linear constraints of the surface control points, and deformations by name."""
