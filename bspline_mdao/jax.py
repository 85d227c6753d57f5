"""Grids, quality and measures as functions of JAX, with exact derivatives: extra ``jax``."""

import lazy_loader

# the loader stores what it loads in the package it is given: at the top level `measures` is a namespace
__getattr__, __dir__, __all__ = lazy_loader.attach(
    "bspline_mdao.core.bridges",
    submod_attrs={"jax_evaluation": ["device_grid"], "jax_functions": ["grid", "measures", "quality"]},
)
