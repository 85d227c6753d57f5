"""Volume grids from surface grids by hyperbolic extrusion."""
