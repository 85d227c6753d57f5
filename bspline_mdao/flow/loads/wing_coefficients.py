"""The functionals of all flows about a wing from the forces on it: the table of kernels, and their sum.

A kernel computes functionals by name, with derivatives, from forces, nodes and angle of attack. To add one, add it to
`KERNELS`, and its outputs to `bspline_mdao.flow.functionals.FUNCTIONALS`.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...errors import InputError
from ..functionals import FUNCTIONALS
from .axis_moments import AxisMoment, HingeLoads
from .force_coefficients import ForceCoefficients
from .hinges import HingeMoment
from .induced_drag import InducedDrag
from .section_loads import SectionLoads

__all__ = ["KERNELS", "Wing", "WingCoefficients", "WingKernel"]

NO_FACES = np.zeros((0, 4), dtype=int)
"""Corners of the wall faces for flows without any, such as a lattice."""


class WingKernel(Protocol):
    """Functionals of forces on a wing: forces divided by the dynamic pressure (m^2), nodes (m), an angle (rad)."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Their names."""

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha: float) -> dict[str, Any]:
        """Values by name; real or complex."""

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> dict[str, Any]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the outputs, by name."""


@dataclass(frozen=True, eq=False)
class Wing:
    """Inputs for making kernels: the points of application and the references, the wake, and the baseline nodes."""

    coefficients: ForceCoefficients
    induced: InducedDrag
    nodes: np.ndarray  # (n_nodes, 3), m

    @property
    def bending(self) -> AxisMoment:
        """The moment that bends the wing up at its plane of symmetry."""
        at = self.coefficients
        return AxisMoment.bending(at.points, self.nodes, at.axes, at.reference, math.prod((at.area, at.chord)))


@dataclass(frozen=True, eq=False)
class InducedCoefficients:
    """Induced drag divided by the reference area (m^2), and the span load."""

    induced: InducedDrag
    area: float

    outputs = ("CD_induced", "span_load")

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha: float) -> dict[str, Any]:
        return self._named(*self.induced.evaluate(forces, nodes, alpha))

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> dict[str, Any]:
        return self._named(*self.induced.jvp(forces, nodes, alpha, d_forces, d_nodes, d_alpha))

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float]:
        drag_bar = bars.get("CD_induced", 0.0) / self.area
        return self.induced.vjp(forces, nodes, alpha, bars.get("span_load", 0.0), drag_bar)

    def _named(self, load: np.ndarray, drag: float) -> dict[str, Any]:
        return {"CD_induced": drag / self.area, "span_load": load}


@dataclass(frozen=True, eq=False)
class MomentCoefficient:
    """A moment about an axis, by its name."""

    name: str
    moment: AxisMoment

    @property
    def outputs(self) -> tuple[str, ...]:
        return (self.name,)

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha: float) -> dict[str, Any]:
        return {self.name: self.moment.evaluate(forces, nodes)}

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> dict[str, Any]:
        return {self.name: self.moment.jvp(forces, nodes, d_forces, d_nodes)}

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float]:
        return (*self.moment.vjp(forces, nodes, np.sum(bars[self.name])), 0.0)


KERNELS: dict[str, Callable[[Wing], WingKernel]] = {
    "forces": lambda wing: wing.coefficients,
    "wake": lambda wing: InducedCoefficients(wing.induced, wing.coefficients.area),
    "bending": lambda wing: MomentCoefficient("CM_bending", wing.bending),
    "sections": lambda wing: SectionLoads(wing.induced.strips, wing.coefficients.points),
}
"""Makers of the kernels of a wing, by their names in the table of functionals."""


@dataclass(frozen=True, eq=False)
class WingCoefficients:
    """All functionals of the forces on a wing, and moments about the hinges of control surfaces."""

    coefficients: ForceCoefficients  # points of application, and the references
    induced: InducedDrag  # the wake
    kernels: tuple[WingKernel, ...]  # compute the functionals

    @classmethod
    def of(
        cls,
        coefficients: ForceCoefficients,  # coefficients, induced: see above
        induced: InducedDrag,
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m)
        # of bool, parts of the wall and their axes, and the faces of the patches of each
        hinges: Sequence[tuple[HingeMoment, np.ndarray]] = (),
        # (n_forces, 4) of int, corners of the wall faces of the forces, which hinges need
        faces: np.ndarray = NO_FACES,
    ) -> WingCoefficients:
        """Make the kernels."""
        points, references = coefficients.points, (coefficients.area, coefficients.chord)
        wing = Wing(coefficients, induced, nodes)
        keys = dict.fromkeys(each.kernel for each in FUNCTIONALS.values() if each.kernel in KERNELS)
        kernels, taken = [KERNELS[key](wing) for key in keys], set(FUNCTIONALS)
        for hinge, is_within in hinges:
            if hinge.output in taken:
                raise InputError(f"hinge {hinge.name}: there is a moment {hinge.output} already; give another name")
            taken.add(hinge.output)
            moment = hinge.moment(points, references, induced.strips, nodes, faces, is_within)
            kernels.append(moment if isinstance(moment, HingeLoads) else MomentCoefficient(hinge.output, moment))
        return cls(coefficients, induced, tuple(kernels))

    @property
    def moments(self) -> dict[str, AxisMoment]:
        """Moments about axes, by name."""
        return {kernel.name: kernel.moment for kernel in self.kernels if isinstance(kernel, MomentCoefficient)}

    @property
    def hinge_loads(self) -> tuple[str, ...]:
        """Names of forces and moments of control surfaces whose hinges move."""
        return tuple(kernel.name for kernel in self.kernels if isinstance(kernel, HingeLoads))

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha: float) -> dict[str, np.ndarray]:
        """Compute them for forces divided by the dynamic pressure (m^2), nodes (m) and an angle of attack (rad)."""
        # Arguments as in `ForceCoefficients.evaluate`.
        return _merged(kernel.evaluate(forces, nodes, alpha) for kernel in self.kernels)

    def jvp(
        self,
        forces: np.ndarray,
        nodes: np.ndarray,
        alpha: float,
        d_forces: np.ndarray,
        d_nodes: np.ndarray,
        d_alpha: float,
    ) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        at = forces, nodes, alpha, d_forces, d_nodes, d_alpha
        return _merged(kernel.jvp(*at) for kernel in self.kernels)

    def vjp(
        self, forces: np.ndarray, nodes: np.ndarray, alpha: float, bars: dict
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the outputs, by name."""
        # Returns derivatives with respect to the forces, shape (n_forces, 3), the nodes, shape (n_nodes, 3), and the
        # angle (1/rad).
        forces_bar, nodes_bar, alpha_bar = np.zeros_like(forces), np.zeros_like(nodes), 0.0
        for kernel in self.kernels:
            if not bars.keys().isdisjoint(kernel.outputs):
                parts = kernel.vjp(forces, nodes, alpha, bars)
                forces_bar, nodes_bar, alpha_bar = forces_bar + parts[0], nodes_bar + parts[1], alpha_bar + parts[2]
        return forces_bar, nodes_bar, alpha_bar


def _merged(parts: Iterable[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Merge several mappings."""
    return {name: value for part in parts for name, value in part.items()}
