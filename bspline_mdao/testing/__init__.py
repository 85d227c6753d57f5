"""Derivative checks for those who write their own variables, kernels and components.

The caller passes what is to be checked, a function or an OpenMDAO problem. No check passes if there is nothing to
compare: empty vectors, derivatives that are all zero and functions that do not change are errors. Use them in this
order: the complex step of the function, forward products against it, reverse products against those (`dot_test`), then
partials of the component and totals of the problem.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
