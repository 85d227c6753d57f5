"""Meshes of other programs: their nodes move with the control mesh of a fitted grid."""
