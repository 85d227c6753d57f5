"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .base.sparse.cholesky import Cholesky as Cholesky
from .base.sparse.conjugate_gradient import ConjugateGradients as ConjugateGradients
from .base.sparse.petsc import PetscCholesky as PetscCholesky
from .base.sparse.petsc import PetscMultigrid as PetscMultigrid
from .core.mesh.boundary import moving_grid as moving_grid
from .core.mesh.boundary import moving_mesh as moving_mesh
from .core.mesh.moving_mesh import MovingMesh as MovingMesh
from .core.movement.comoving import ComovingFrame as ComovingFrame
from .core.movement.delaunay import DelaunayGraph as DelaunayGraph
from .core.movement.elasticity import LinearElasticity as LinearElasticity
from .core.movement.fixed_interior import FixedInterior as FixedInterior
from .core.movement.increments import increments_for as increments_for
from .core.movement.inverse_distance import InverseDistance as InverseDistance
from .core.movement.radial_basis import RadialBasis as RadialBasis
from .core.movement.rotations import Rotations as Rotations
from .core.movement.springs import LinealSprings as LinealSprings
from .core.movement.springs import TorsionalSprings as TorsionalSprings
from .core.movement.transfinite import Transfinite as Transfinite
from .core.movement.young_modulus import ConstantLaw as ConstantLaw
from .core.movement.young_modulus import InverseVolumeLaw as InverseVolumeLaw
from .core.movement.young_modulus import OrthogonalityLaw as OrthogonalityLaw
from .core.movement.young_modulus import StiffnessLaw as StiffnessLaw
from .core.movement.young_modulus import WallDistanceLaw as WallDistanceLaw
