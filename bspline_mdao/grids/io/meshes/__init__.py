"""Files of meshes that are not fitted: read, and written back with other coordinates and all else as it was."""
