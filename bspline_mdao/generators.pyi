"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.generators.blended_wing_body import BlendedWingBody as BlendedWingBody
from .core.generators.blended_wing_body import Rib as Rib
from .core.generators.blended_wing_body import generic_blended_wing_body as generic_blended_wing_body
from .core.generators.canonical import flat_plate_grid as flat_plate_grid
from .core.generators.canonical import onera_d_section as onera_d_section
from .core.generators.canonical import onera_m6_grid as onera_m6_grid
from .core.generators.canonical import onera_m6_planform as onera_m6_planform
from .core.generators.canonical import rectangular_wing as rectangular_wing
from .core.generators.hh_wing import FarField as FarField
from .core.generators.hh_wing import Spacing as Spacing
from .core.generators.hh_wing import hh_wing_grid as hh_wing_grid
from .core.generators.hh_wing import infinite_wing_grid as infinite_wing_grid
from .core.generators.section_o_grid import section_o_grid as section_o_grid
from .core.generators.shell import ball_grid as ball_grid
from .core.generators.shell import brick_grid as brick_grid
from .core.generators.target_shapes import Shape as Shape
from .core.generators.target_shapes import fit_shape as fit_shape
from .core.generators.target_shapes import lay_nodes as lay_nodes
from .core.generators.target_shapes import lay_walls as lay_walls
from .core.generators.target_shapes import nodes_on_shape as nodes_on_shape
from .core.generators.wing import Planform as Planform
from .core.generators.wing import Section as Section
from .core.generators.wing import Wing as Wing
from .core.generators.wing import cambered_section as cambered_section
from .core.generators.wing import flat_section as flat_section
from .core.generators.wing import naca_section as naca_section
