"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.riding.riding_mesh import EmbeddedMesh as EmbeddedMesh
from .core.riding.section_span import section_span as section_span
from .grids.cells.mixed_cells import MixedMesh as MixedMesh
from .grids.io.meshes.layer_of_cells import SectionSpan as SectionSpan
