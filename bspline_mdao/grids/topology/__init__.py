"""Multi-block grids: blocks, interfaces, segments, shared and periodic points."""
