"""Movers of the inner points of a mesh behind its surface, and the linear systems that they solve."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
