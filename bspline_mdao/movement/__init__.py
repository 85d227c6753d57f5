"""Movement of a control mesh, or of a fine grid node by node, behind a moving surface (section III)."""
