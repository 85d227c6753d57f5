"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.background.fit_mesh import fit_mesh as fit_mesh
from .core.background.free_lattice import free_lattice as free_lattice
from .core.background.lattice_settings import LatticeSettings as LatticeSettings
from .core.background.mesh_model import MeshModel as MeshModel
from .core.background.open_mesh_file import open_mesh_file as open_mesh_file
from .core.background.thin_plate import ThinPlate as ThinPlate
from .core.riding.riding_mesh import EmbeddedMesh as EmbeddedMesh
from .core.riding.section_span import section_span as section_span
from .grids.cells.mixed_cells import MixedMesh as MixedMesh
from .grids.cells.skin_parts import with_markers as with_markers
from .grids.io.marker_guess import MarkerGuess as MarkerGuess
from .grids.io.marker_guess import guess_kinds as guess_kinds
from .grids.io.marker_kinds import marker_kinds as marker_kinds
from .grids.io.marker_kinds import read_kinds as read_kinds
from .grids.io.meshes.layer_of_cells import SectionSpan as SectionSpan
