"""Canonical grids, the twelve-block H-H topology of the paper about any wing, and the shapes that wings become."""

from .blended_wing_body import BlendedWingBody, Rib, generic_blended_wing_body
from .canonical import flat_plate_grid, onera_m6_grid, rectangular_wing
from .hh_wing import FarField, Spacing, hh_wing_grid
from .infinite_wing import infinite_wing_grid
from .onera_m6 import onera_d_section, onera_m6_planform
from .planform import Planform
from .section import Section, cambered_section, flat_section, naca_section
from .shape import Shape, lay_nodes, lay_walls
from .shell import ball_grid, brick_grid
from .targets import fit_shape, nodes_on_shape
from .wing_surface import Wing

__all__ = [
    "BlendedWingBody",
    "FarField",
    "Planform",
    "Rib",
    "Section",
    "Shape",
    "Spacing",
    "Wing",
    "ball_grid",
    "brick_grid",
    "cambered_section",
    "fit_shape",
    "flat_plate_grid",
    "flat_section",
    "generic_blended_wing_body",
    "hh_wing_grid",
    "infinite_wing_grid",
    "lay_nodes",
    "lay_walls",
    "naca_section",
    "nodes_on_shape",
    "onera_d_section",
    "onera_m6_grid",
    "onera_m6_planform",
    "rectangular_wing",
]
