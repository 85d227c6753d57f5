"""What belongs to optimisations besides their drivers: combinations of responses, and records that stay short."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
