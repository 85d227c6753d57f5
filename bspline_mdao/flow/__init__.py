"""Flow about the regenerated shape."""
