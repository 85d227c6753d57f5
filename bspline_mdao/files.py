"""Files besides those of `read_grid` and `write_grid`: pictures, OpenFOAM, CAD, curved and unstructured meshes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("bspline_mdao", __file__)
