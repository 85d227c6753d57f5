"""Movement by radial basis functions about the surface and the held points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..mesh.moving_mesh import MovingMesh
from .centres import CentredInterpolation, Centres, find_centres
from .increments import IncrementalMover
from .interpolation import InterpolatedStep, interpolated_step
from .radial_functions import COMPACT, GLOBAL, NEEDS_LINEAR
from .radial_interpolation import radial_interpolation

__all__ = ["MOST_CENTRES", "RadialBasis"]

MOST_CENTRES = 12_000
"""Number of centres beyond which the dense system is refused; its factor then takes 1.2 GB an increment."""


@dataclass(frozen=True)
class RadialBasis(IncrementalMover):
    """Interpolate the known displacements by radial functions about all points of the surface and all held ones.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    kernel : str
        ``"wendland c0"``, ``"wendland c2"`` or ``"wendland c4"``, zero from the radius on; or one that is felt
        everywhere: ``"volume"``, ``"thin plate"``, ``"multiquadric"``, ``"inverse multiquadric"`` or ``"gaussian"``.
    radius : float
        Radius of the functions, in units of the mesh's size.
    has_linear : bool, optional
        Whether a linear polynomial is added, with which affine displacements are reproduced; by default for the kernels
        that need it: volume, thin plate and multiquadric.
    n_increments : int or "auto"
        Increments of the move; each has its own dense factor, which is kept for the derivatives.

    References
    ----------
    S. Jakobsson and O. Amoignon, "Mesh deformation using radial basis functions for gradient-based aerodynamic shape
    optimization", Computers & Fluids 36, 2007.

    A. de Boer, M. S. van der Schoot and H. Bijl, "Mesh deformation based on radial basis function interpolation",
    Computers & Structures 85, 2007.

    H. Wendland, "Piecewise polynomial, positive definite and compactly supported radial functions of minimal degree",
    Advances in Computational Mathematics 4, 1995.
    """

    mesh: MovingMesh
    kernel: str = "wendland c2"
    radius: float = 0.5
    has_linear: bool | None = None
    n_increments: int | str = 1

    name = "radial basis"

    def __post_init__(self):
        super().__post_init__()
        if self.kernel not in (*COMPACT, *GLOBAL):
            raise InputError(f"radial basis: no kernel '{self.kernel}'; take one of {', '.join((*COMPACT, *GLOBAL))}")
        if not 0.0 < self.radius < np.inf:
            raise InputError(f"radial basis: radius {self.radius}; give a positive number, in units of the mesh's size")
        if self.has_linear is False and self.kernel in NEEDS_LINEAR:
            raise InputError(f"radial basis: kernel '{self.kernel}' needs the linear polynomial; leave it in")
        n_centres = len(self.mesh.surface_ids) + len(self.mesh.fixed_ids)
        if n_centres > MOST_CENTRES:
            raise InputError(
                f"radial basis: {n_centres} known points are more than the {MOST_CENTRES} of a dense system; "
                "move the control mesh instead of the grid, or take another mover"
            )

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> InterpolatedStep:
        centres = self._centres
        scattered = radial_interpolation(
            self.kernel,
            self.radius * self.mesh.size,
            self.kernel in NEEDS_LINEAR if self.has_linear is None else self.has_linear,
            before[centres.target_ids],
            centres.position @ before,
            centres.displacement(surface - before[self.mesh.surface_ids]),
        )
        carried = CentredInterpolation(centres, scattered)
        return interpolated_step(self.mesh, before, surface, carried, scattered.report)

    @cached_property
    def _centres(self) -> Centres:
        return find_centres(self.mesh)
