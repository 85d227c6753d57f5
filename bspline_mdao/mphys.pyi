"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.om.mphys.geometry import GeometryBuilder as GeometryBuilder
from .core.om.mphys.geometry import SurfaceGeometry as SurfaceGeometry
from .core.om.mphys.warper import VolumeWarper as VolumeWarper
from .flow.om.mphys.beam import BeamBuilder as BeamBuilder
from .flow.om.mphys.builders import EulerBuilder as EulerBuilder
from .flow.om.mphys.builders import FlowBuilder as FlowBuilder
from .flow.om.mphys.openfoam import OpenFoamBuilder as OpenFoamBuilder
from .flow.om.mphys.rigid_links import RigidLinkBuilder as RigidLinkBuilder
from .grids.topology.sharing import numbers_of_points as numbers_of_points
from .grids.topology.sharing import rows_of_points as rows_of_points
