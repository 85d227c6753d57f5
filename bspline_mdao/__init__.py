"""B-spline meshes as integrated geometry parametrization and grid movement for OpenMDAO.

The names that most scripts need are here, the rest in namespaces such as `bspline_mdao.design`. They are listed in
``__init__.pyi`` and in a stub next to each namespace. Each is imported on first use, so importing the package stays
cheap, and editors know all names.
"""

import lazy_loader

from .base.kernel_cache import ensure_kernel_cache
from .base.shipped_kernels import enable_with_numba

__version__ = "0.2.0"

ensure_kernel_cache()
enable_with_numba()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
