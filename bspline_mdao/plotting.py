"""Pictures: grids, control meshes, wings and optimisations.

They need matplotlib, and PyVista for rendered ones: ``pip install bspline_mdao[pictures]``. Both are imported when
something is drawn, so importing this module is cheap.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
