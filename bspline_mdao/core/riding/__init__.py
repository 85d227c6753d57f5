"""Meshes of other programs that ride along: their nodes move with the control mesh of a fitted grid."""
