"""What belongs to optimisations besides their drivers: combinations of responses, records, and runs to compare."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
