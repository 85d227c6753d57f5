"""Meshes without structure: what their markers are, and what moves them, alone or along with a fitted grid."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
