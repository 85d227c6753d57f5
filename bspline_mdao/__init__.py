"""B-spline meshes as integrated geometry parametrization and grid movement for OpenMDAO.

What most scripts begin with is here, the rest in namespaces such as `bspline_mdao.design`. The names are those of
``__init__.pyi``, and of a stub beside each namespace; each is imported when it is first asked for, so that importing
the package stays cheap and editors know all of them.
"""

import lazy_loader

from .base.kernel_cache import ensure_kernel_cache
from .base.shipped_kernels import enable_with_numba

__version__ = "0.2.0"

ensure_kernel_cache()
enable_with_numba()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
