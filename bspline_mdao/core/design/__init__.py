"""Variables and constraints: how surface control points may change, and named deformations."""
