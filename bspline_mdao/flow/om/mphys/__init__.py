"""Flows and structures in the roles of MPhys."""

from importlib.util import find_spec

if find_spec("mphys") is None:
    raise ImportError('bspline_mdao.flow.om.mphys needs MPhys: pip install "bspline_mdao[mphys]"')
