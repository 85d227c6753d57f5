"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.cad.cad_body import CadBody as CadBody
from .core.cad.files import CadShape as CadShape
from .core.cad.files import read_cad as read_cad
from .core.cad.write_body import write_cad_body as write_cad_body
from .core.cad.write_cad import CadReport as CadReport
from .core.cad.write_cad import write_cad as write_cad
from .grids.io.curved import write_curved_grid as write_curved_grid
from .grids.io.meshes.files import read_mesh as read_mesh
from .grids.io.openfoam import CaseField as CaseField
from .grids.io.openfoam import write_case as write_case
from .grids.io.openfoam import write_polymesh as write_polymesh
from .grids.io.patches import read_patches as read_patches
from .grids.io.plane_grids import lift_plane_grid as lift_plane_grid
from .grids.io.tecplot import write_tecplot as write_tecplot
from .grids.io.triangles import Triangles as Triangles
from .grids.io.triangles import read_triangles as read_triangles
from .grids.io.vtk import write_vtk as write_vtk
