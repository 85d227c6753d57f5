"""B-spline meshes as integrated geometry parametrization and grid movement for OpenMDAO."""

__version__ = "0.1.0"
