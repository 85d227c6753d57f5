"""Builders and components of MPhys, and the points of its solvers in a grid."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
