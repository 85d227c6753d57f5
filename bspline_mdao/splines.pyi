"""Public names: each is imported when it is first asked for, from the module that is written here."""

from .core.evaluation.inversion import embed_points as embed_points
from .core.evaluation.inversion import invert_points as invert_points
from .core.evaluation.inversion import require_inside as require_inside
from .core.evaluation.transfer import CellTransfer as CellTransfer
from .core.evaluation.transfer import NodeTransfer as NodeTransfer
from .core.fit.fitting import fit_blocks as fit_blocks
from .core.fit.surface_fit import SurfaceFollower as SurfaceFollower
from .core.fit.surface_fit import fit_surface as fit_surface
from .core.model.curved import curved_grid as curved_grid
from .core.splines.basis import basis as basis
from .core.splines.basis import basis_jets as basis_jets
from .core.splines.curve import Curve as Curve
from .core.splines.curve import uniform_parameters as uniform_parameters
from .core.splines.knots import BilinearKnots as BilinearKnots
from .core.splines.knots import ConstantKnots as ConstantKnots
from .core.splines.knots import FunctionKnots as FunctionKnots
from .core.splines.volume import evaluate_gradients as evaluate_gradients
