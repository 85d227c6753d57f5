"""Many designs of one problem: plans of them, and a file of their grids, quality and outputs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
