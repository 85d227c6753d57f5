"""Files of meshes that are not fitted: read, and written back with new coordinates and otherwise unchanged."""
