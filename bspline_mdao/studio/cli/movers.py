"""Options for moving the control mesh, and movers, stiffness laws and solvers by name.

The tables give classes as import paths, imported on request: help shows the names, and should not wait for NumPy and
numba.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pkgutil import resolve_name
from typing import TYPE_CHECKING

import click

from ...errors import InputError

if TYPE_CHECKING:
    from ...core.mesh.moving_mesh import MovingMesh
    from ...core.movement.mover import Mover

MOVERS = {
    "elasticity": "bspline_mdao.core.movement.elasticity.LinearElasticity",
    "rotations": "bspline_mdao.core.movement.rotations.Rotations",
    "springs": "bspline_mdao.core.movement.springs.TorsionalSprings",
    "torsional": "bspline_mdao.core.movement.springs.TorsionalSprings",
    "transfinite": "bspline_mdao.core.movement.transfinite.Transfinite",
    "rbf": "bspline_mdao.core.movement.radial_basis.RadialBasis",
    "idw": "bspline_mdao.core.movement.inverse_distance.InverseDistance",
    "delaunay": "bspline_mdao.core.movement.delaunay.DelaunayGraph",
    "held": "bspline_mdao.core.movement.fixed_interior.FixedInterior",
}
"""Import path of the class of each mover, by name."""

STIFFNESS = {
    "orthogonality": "bspline_mdao.core.movement.young_modulus.OrthogonalityLaw",
    "volume": "bspline_mdao.core.movement.young_modulus.InverseVolumeLaw",
    "distance": "bspline_mdao.core.movement.young_modulus.WallDistanceLaw",
    "constant": "bspline_mdao.core.movement.young_modulus.ConstantLaw",
}
"""Import path of the class of each stiffness law."""

SOLVERS = {
    "cholesky": "bspline_mdao.base.sparse.cholesky.Cholesky",
    "cg": "bspline_mdao.base.sparse.conjugate_gradient.ConjugateGradients",
    "multigrid": "bspline_mdao.base.sparse.petsc.PetscMultigrid",
    "mumps": "bspline_mdao.base.sparse.petsc.PetscCholesky",
}
"""Import path of the class of each solver."""


MOVING = (
    click.option(
        "--mover",
        default="rotations",
        show_default=True,
        metavar="NAME",
        help=f"What moves the control mesh: {', '.join(MOVERS)}.",
    ),
    click.option(
        "--increments",
        type=click.IntRange(min=1),
        metavar="N",
        help="Increments; 5 by default with elasticity and springs, 1 with others; rotations have none.",
    ),
    click.option(
        "--nu", type=float, metavar="NU", help="Poisson's ratio of elasticity, -1 < NU < 0.5; -0.2 by default."
    ),
    click.option(
        "--stiffness",
        metavar="NAME",
        help=f"Stiffness of elasticity: {', '.join(STIFFNESS).replace(',', ' (default),', 1)}.",
    ),
    click.option(
        "--solver",
        metavar="NAME",
        help=f"Solver of elasticity and springs: {', '.join(SOLVERS).replace(',', ' (default),', 1)}.",
    ),
    click.option(
        "--comoving",
        is_flag=True,
        help="Move all that is fixed, such as the far field, with the rigid part of the surface's motion.",
    ),
    click.option("--design", multiple=True, metavar="PATCH", help="Patch to deform; all walls by default."),
    click.option(
        "--slide",
        multiple=True,
        metavar="PATCH",
        help="Patch that slides in its plane, as symmetry planes and planes on which the surface ends do, or on its "
        "cylinder, cone, sphere or surface of revolution.",
    ),
    click.option("--fix", "--pin", multiple=True, metavar="PATCH", help="Patch to fix where it is."),
    click.option("--release", multiple=True, metavar="PATCH", help="Patch that moves freely with the grid."),
)


def moving_options(function: Callable) -> Callable:
    """Add the options for moving the control mesh and for the role of its patches."""
    for option in reversed(MOVING):
        function = option(function)
    return function


@dataclass(frozen=True)
class MoverOptions:
    """Options of ``move`` that make the mover; None keeps the mover's default."""

    mover: str = "rotations"  # a key of `MOVERS`
    increments: int | None = None  # increments of the move
    nu: float | None = None  # poisson's ratio
    # stiffness, solver: keys of `STIFFNESS` and `SOLVERS`
    stiffness: str | None = None
    solver: str | None = None
    comoving: bool = False  # whether outer boundaries follow the rigid part of the surface's motion

    def make(self, mesh: MovingMesh) -> Mover:
        """Make the mover of a mesh."""
        kind = class_named(MOVERS, self.mover, "--mover")
        accepted = {field.name for field in fields(kind)}
        settings = {
            "n_increments": ("--increments", self.increments),
            "poisson_ratio": ("--nu", self.nu),
            "stiffness": ("--stiffness", self.stiffness and class_named(STIFFNESS, self.stiffness, "--stiffness")()),
            "solver": ("--solver", self.solver and class_named(SOLVERS, self.solver, "--solver")()),
        }
        chosen = {name: setting for name, setting in settings.items() if setting[1] is not None}
        for name, (option, _) in chosen.items():
            if name not in accepted:
                raise InputError(
                    f"{option}: the mover '{self.mover}' has no such setting; leave the option out, or take --mover "
                    f"elasticity"
                )
        mover = kind(mesh, **{name: value for name, (_, value) in chosen.items()})
        return resolve_name("bspline_mdao.core.movement.comoving.ComovingFrame")(mover) if self.comoving else mover


def class_named(table: Mapping[str, str], name: str, option: str) -> type:
    """Import the class for a name of a table."""
    if name not in table:
        raise InputError(f"{option} {name}: is not known; give one of {', '.join(table)}")
    return resolve_name(table[name])
