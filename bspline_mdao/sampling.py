"""Many designs of one problem: sampling plans, and one file with their grids, quality and outputs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
