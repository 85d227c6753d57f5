"""Flow about the regenerated shape, as OpenMDAO components and groups."""
