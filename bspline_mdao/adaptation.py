"""Better grids: where errors are estimated to come from, and where cells are worst."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
