"""Tools for optimisations besides their drivers: combined responses, records, and comparisons of runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
