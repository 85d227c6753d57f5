"""Movers, stiffness laws and solvers by the names that the command line gives them."""

from __future__ import annotations

from dataclasses import dataclass, fields

from ..errors import InputError
from ..mesh.moving_mesh import MovingMesh
from ..movement.delaunay import DelaunayGraph
from ..movement.elasticity import LinearElasticity
from ..movement.fixed_interior import FixedInterior
from ..movement.inverse_distance import InverseDistance
from ..movement.mover import Mover
from ..movement.radial_basis import RadialBasis
from ..movement.springs import LinealSprings, TorsionalSprings
from ..movement.transfinite import Transfinite
from ..movement.young_modulus import ConstantLaw, InverseVolumeLaw, OrthogonalityLaw, WallDistanceLaw
from ..sparse.cholesky import Cholesky
from ..sparse.cholmod import Cholmod
from ..sparse.conjugate_gradient import ConjugateGradients
from ..sparse.pardiso import Pardiso

MOVERS = {
    "elasticity": LinearElasticity,
    "springs": LinealSprings,
    "torsional": TorsionalSprings,
    "transfinite": Transfinite,
    "rbf": RadialBasis,
    "idw": InverseDistance,
    "delaunay": DelaunayGraph,
    "held": FixedInterior,
}

STIFFNESS = {
    "orthogonality": OrthogonalityLaw,
    "volume": InverseVolumeLaw,
    "distance": WallDistanceLaw,
    "constant": ConstantLaw,
}

SOLVERS = {"cholesky": Cholesky, "cg": ConjugateGradients, "cholmod": Cholmod, "pardiso": Pardiso}


@dataclass(frozen=True)
class MoverOptions:
    """Options of ``move`` that make the mover; None leaves a setting at the mover's own default.

    Parameters
    ----------
    mover : str
        Name out of `MOVERS`.
    increments : int or "auto", optional
        Increments of the move.
    nu : float, optional
        Poisson's ratio.
    stiffness, solver : str, optional
        Names out of `STIFFNESS` and `SOLVERS`.
    """

    mover: str = "elasticity"
    increments: int | str | None = None
    nu: float | None = None
    stiffness: str | None = None
    solver: str | None = None

    def make(self, mesh: MovingMesh) -> Mover:
        """Make the mover of a mesh.

        Raises
        ------
        InputError
            If a name is not known, or the mover has no such setting.
        """
        kind = _named(MOVERS, self.mover, "--mover")
        known = {field.name for field in fields(kind)}
        settings = {
            "n_increments": ("--increments", self.increments),
            "poisson_ratio": ("--nu", self.nu),
            "stiffness": ("--stiffness", self.stiffness and _named(STIFFNESS, self.stiffness, "--stiffness")()),
            "solver": ("--solver", self.solver and _named(SOLVERS, self.solver, "--solver")()),
        }
        given = {name: setting for name, setting in settings.items() if setting[1] is not None}
        for name, (option, _) in given.items():
            if name not in known:
                raise InputError(f"{option}: the mover '{self.mover}' has no such setting; leave the option out")
        return kind(mesh, **{name: value for name, (_, value) in given.items()})


def _named(known: dict, name: str, option: str):
    """Look a name up."""
    if name not in known:
        raise InputError(f"{option} {name}: is not known; give one of {', '.join(known)}")
    return known[name]
