"""Multi-block structured grids in memory: blocks, interfaces, segments, shared and periodic points."""
