"""What a design changes: variables of planform and section, free form, variables of your own, and motions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
