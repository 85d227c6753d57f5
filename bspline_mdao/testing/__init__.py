"""Checks of derivatives: for those who write their own variables, kernels and components.

Each takes what is to be checked from its caller, a function or an OpenMDAO problem, and none passes where there is
nothing to compare: empty vectors, derivatives that are all zero and functions that do not change are errors. The order
in which they are used is that of the chain of trust: complex step of the function, against it forward products, against
them reverse products (`dot_test`), then partials of the component and totals of the problem.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
