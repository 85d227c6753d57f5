"""Multi-block grids without splines: blocks and windows, cells and their quality, files of other programs."""
