"""The layer below `fit_grid`: fits of blocks and surfaces, knots, points in volumes, members of a grid family."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
