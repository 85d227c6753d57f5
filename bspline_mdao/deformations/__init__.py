"""Named deformations of surface points."""

from .bumps import Bumps, random_bumps
from .deformation import Deformation, planes_of
from .frame import Frame, Plane, surface_frame
from .named import DEFORMATIONS, parse_deformation, wall_spacing
from .point_maps import (
    Bend,
    Dihedral,
    Pitch,
    PointMap,
    ScaleChord,
    ScaleThickness,
    Stretch,
    Sweep,
    Translate,
    Twist,
)
from .points_file import GivenPoints, read_points

__all__ = [
    "DEFORMATIONS",
    "Bend",
    "Bumps",
    "Deformation",
    "Dihedral",
    "Frame",
    "GivenPoints",
    "Pitch",
    "Plane",
    "PointMap",
    "ScaleChord",
    "ScaleThickness",
    "Stretch",
    "Sweep",
    "Translate",
    "Twist",
    "parse_deformation",
    "planes_of",
    "random_bumps",
    "read_points",
    "surface_frame",
    "wall_spacing",
]
