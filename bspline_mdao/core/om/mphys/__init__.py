"""Geometry, grid movement and flow as MPhys components, so other solvers can take part."""

from importlib.util import find_spec

if find_spec("mphys") is None:
    raise ImportError('bspline_mdao.core.om.mphys needs MPhys: pip install "bspline_mdao[mphys]"')
