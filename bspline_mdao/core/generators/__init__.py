"""Wings and their grids: the twelve-block H-H topology of the paper, and the shapes that wings become."""
