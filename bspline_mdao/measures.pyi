"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.measures.area import ProjectedArea as ProjectedArea
from .core.measures.area import SurfaceArea as SurfaceArea
from .core.measures.camber_surface import CamberSurface as CamberSurface
from .core.measures.clearance import Clearance as Clearance
from .core.measures.clearance import PlaneClearance as PlaneClearance
from .core.measures.curvature import Curvature as Curvature
from .core.measures.seam_smoothness import SeamSmoothness as SeamSmoothness
from .core.measures.seams import PoleContinuity as PoleContinuity
from .core.measures.seams import SeamContinuity as SeamContinuity
from .core.measures.seams import pole_continuity as pole_continuity
from .core.measures.seams import seam_continuity as seam_continuity
from .core.measures.section_area import SectionArea as SectionArea
from .core.measures.section_thickness import SectionThickness as SectionThickness
from .core.measures.thickness import Thickness as Thickness
from .core.measures.volume import EnclosedVolume as EnclosedVolume
from .core.measures.wing_edges import LeadingEdgeRadius as LeadingEdgeRadius
from .core.measures.wing_edges import TrailingEdgeAngle as TrailingEdgeAngle
from .core.mesh.surface import SurfaceGrid as SurfaceGrid
from .core.om.seam_measure import SeamMeasure as SeamMeasure
