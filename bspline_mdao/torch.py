"""Grids, quality and measures as functions of PyTorch, with exact derivatives: extra ``torch``."""

import lazy_loader

# the loader stores what it loads in the package it is given: at the top level `measures` is a namespace
__getattr__, __dir__, __all__ = lazy_loader.attach(
    "bspline_mdao.core.bridges", submod_attrs={"torch_functions": ["grid", "measures", "quality"]}
)
