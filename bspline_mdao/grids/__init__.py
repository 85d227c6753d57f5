"""Multi-block structured grids: files, patches, topology and cells."""
