"""Canonical grids, the twelve-block H-H topology of the paper about any wing, and the shapes that wings become."""
