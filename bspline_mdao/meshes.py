"""Unstructured meshes: the kinds of their markers, and the movers for them, with or without a fitted grid."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
