"""The command line of run scripts, and the sizes of their problems."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
