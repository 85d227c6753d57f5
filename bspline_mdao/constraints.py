"""Linear constraints on the control points of a design: pinned, linked, mirrored, in a plane, tangent across edges."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
