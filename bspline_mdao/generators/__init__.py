"""Canonical grids: the twelve-block H-H topology of the paper about any trapezoidal wing."""

from .canonical import flat_plate_grid, onera_m6_grid
from .hh_wing import FarField, Spacing, hh_wing_grid
from .onera_m6 import onera_d_section, onera_m6_planform
from .planform import Planform
from .section import Section, flat_section, naca_section
from .wing_surface import Wing

__all__ = [
    "FarField",
    "Planform",
    "Section",
    "Spacing",
    "Wing",
    "flat_plate_grid",
    "flat_section",
    "hh_wing_grid",
    "naca_section",
    "onera_d_section",
    "onera_m6_grid",
    "onera_m6_planform",
]
