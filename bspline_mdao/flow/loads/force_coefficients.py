"""Coefficients of lift, drag and moment of forces that act at points, and what all flows about a wing have as outputs.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
from scipy.sparse import csr_array

from ...errors import InputError
from .axis_moments import AxisMoment
from .hinges import HingeMoment
from .induced_drag import InducedDrag
from .section_loads import SECTION_LOADS, SectionLoads
from .stream import stream_axes

__all__ = ["ForceCoefficients", "WingCoefficients"]


@dataclass(frozen=True, eq=False)
class ForceCoefficients:
    """Coefficients of lift, drag, and moments about the axes x, y and z of the grid, in this order.

    Parameters
    ----------
    points : csr_array, shape (n_forces, n_nodes)
        Weights of the nodes of a grid in the points that forces act at.
    axes : ndarray, shape (3, 3)
        Rows are the directions downstream, along the span, and up.
    area, chord : float
        Reference area (m^2) and chord (m).
    reference : sequence of three float
        Point that moments are taken about (m).

    Raises
    ------
    InputError
        If the area or the chord is not a positive number, or the point is none.
    """

    points: csr_array
    axes: np.ndarray
    area: float
    chord: float
    reference: Sequence[float]

    def __post_init__(self):
        for name, value, unit in (("area", self.area, "square metres"), ("chord", self.chord, "metres")):
            if not isinstance(value, Real) or not 0.0 < value < np.inf:
                raise InputError(f"flow: reference {name} {value}; give a positive number of {unit}")
        if np.shape(self.reference) != (3,) or not np.isfinite(self.reference).all():
            raise InputError(f"flow: moment reference {self.reference}; give the coordinates x, y and z of a point")

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha) -> np.ndarray:
        """Coefficients, shape (5,); real or complex.

        Parameters
        ----------
        forces : ndarray, shape (n_forces, 3)
            Forces divided by the dynamic pressure (m^2).
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of the grid (m).
        alpha : float
            Angle of attack (rad).
        """
        moment = np.cross(self._arms(nodes), forces).sum(axis=0)
        return self._coefficients(self._directions(alpha) @ forces.sum(axis=0), moment)

    def jvp(self, forces, nodes, alpha, d_forces, d_nodes, d_alpha) -> np.ndarray:
        """Derivatives of `evaluate` along a direction in all of its arguments, shape (5,)."""
        d_moment = np.cross(self._arms(nodes), d_forces) + np.cross(self.points @ d_nodes, forces)
        turned = d_alpha * (self._slopes(alpha) @ forces.sum(axis=0))
        return self._coefficients(self._directions(alpha) @ d_forces.sum(axis=0) + turned, d_moment.sum(axis=0))

    def vjp(self, forces, nodes, alpha, bar) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives with respect to the coefficients, shape (5,).

        Returns
        -------
        tuple
            Derivatives with respect to the forces, shape (n_forces, 3), the nodes, shape (n_nodes, 3), and the angle
            (1/rad).
        """
        force_bar, moment_bar = bar[:2] / self.area, bar[2:] / (self.area * self.chord)
        forces_bar = force_bar @ self._directions(alpha) + np.cross(moment_bar, self._arms(nodes))
        nodes_bar = self.points.T @ np.cross(forces, moment_bar)
        return forces_bar, nodes_bar, force_bar @ self._slopes(alpha) @ forces.sum(axis=0)

    def _arms(self, nodes):
        return self.points @ nodes - np.asarray(self.reference)

    def _directions(self, alpha):
        """Directions of lift and of drag, shape (2, 3)."""
        return stream_axes(alpha, self.axes)[::-1]

    def _slopes(self, alpha):
        """Derivatives of the directions with respect to the angle."""
        drag, lift = stream_axes(alpha, self.axes)
        return np.stack([-drag, lift])

    def _coefficients(self, force, moment):
        return np.concatenate([force, moment / self.chord]) / self.area


NO_FACES = np.zeros((0, 4), dtype=int)
"""Corners of the wall faces of a flow that has none, such as a lattice."""


@dataclass(frozen=True, eq=False)
class WingCoefficients:
    """Coefficients ``CL``, ``CD``, ``CM`` and ``CD_induced``, moments about axes, and the loads along the span.

    Parameters
    ----------
    coefficients : ForceCoefficients
        The first three.
    induced : InducedDrag
        ``CD_induced`` and ``span_load`` (m).
    sections : SectionLoads
        ``strip_span``, ``strip_chord``, ``strip_cl``, ``strip_cd`` and ``strip_cm``.
    moments : dict of str to AxisMoment
        ``CM_bending`` and whatever has an axis, by name.
    """

    coefficients: ForceCoefficients
    induced: InducedDrag
    sections: SectionLoads
    moments: dict[str, AxisMoment]

    @classmethod
    def of(
        cls,
        coefficients: ForceCoefficients,
        induced: InducedDrag,
        nodes: np.ndarray,
        hinges: Sequence[tuple[HingeMoment, np.ndarray]] = (),
        faces: np.ndarray = NO_FACES,
    ) -> WingCoefficients:
        """Add moments about axes and the loads of sections.

        Parameters
        ----------
        coefficients, induced
            See above.
        nodes : ndarray, shape (n_nodes, 3)
            Baseline nodes (m).
        hinges : sequence of (HingeMoment, ndarray of bool)
            Parts of the wall and their axes, and which faces belong to the patches of each.
        faces : ndarray of int, shape (n_forces, 4), optional
            Corners of the wall faces that the forces are on, which hinges need.

        Raises
        ------
        InputError
            If a hinge has no faces, or its name is another's.
        """
        points, references = coefficients.points, (coefficients.area, coefficients.chord)
        bending = AxisMoment.bending(points, nodes, coefficients.axes, coefficients.reference, math.prod(references))
        moments = {"CM_bending": bending}
        for hinge, is_within in hinges:
            if hinge.output in moments:
                raise InputError(f"hinge {hinge.name}: there is a moment {hinge.output} already; give another name")
            moments[hinge.output] = hinge.moment(points, references, induced.strips, nodes, faces, is_within)
        return cls(coefficients, induced, SectionLoads(induced.strips, points), moments)

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha) -> dict[str, np.ndarray]:
        """Compute them for forces divided by the dynamic pressure (m^2), nodes (m) and an angle of attack (rad).

        Arguments are those of `ForceCoefficients.evaluate`.
        """
        at = forces, nodes, alpha
        moments = {name: moment.evaluate(forces, nodes) for name, moment in self.moments.items()}
        named = self._named(self.coefficients.evaluate(*at), *self.induced.evaluate(*at))
        return named | moments | self.sections.evaluate(*at)

    def jvp(self, forces, nodes, alpha, d_forces, d_nodes, d_alpha) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        at = forces, nodes, alpha, d_forces, d_nodes, d_alpha
        moments = {name: moment.jvp(forces, nodes, d_forces, d_nodes) for name, moment in self.moments.items()}
        return self._named(self.coefficients.jvp(*at), *self.induced.jvp(*at)) | moments | self.sections.jvp(*at)

    def vjp(self, forces, nodes, alpha, bars: dict) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives with respect to some of the outputs, by name.

        Returns
        -------
        tuple
            Derivatives with respect to the forces, shape (n_forces, 3), the nodes, shape (n_nodes, 3), and the angle
            (1/rad).
        """
        moment_bar, induced_bar = bars.get("CM", np.zeros(3)), bars.get("CD_induced", 0.0) / self.coefficients.area
        coefficients_bar = np.hstack([bars.get("CL", 0.0), bars.get("CD", 0.0), moment_bar])
        parts = [
            self.coefficients.vjp(forces, nodes, alpha, coefficients_bar),
            self.induced.vjp(forces, nodes, alpha, bars.get("span_load", 0.0), induced_bar),
        ]
        asked = self.moments.keys() & bars.keys()
        parts += [(*self.moments[name].vjp(forces, nodes, np.sum(bars[name])), 0.0) for name in asked]
        if bars.keys() & set(SECTION_LOADS):
            parts.append(self.sections.vjp(forces, nodes, alpha, bars))
        forces_bars, nodes_bars, alpha_bars = zip(*parts)
        return np.sum(forces_bars, axis=0), np.sum(nodes_bars, axis=0), sum(alpha_bars)

    def _named(self, coefficients, load, drag):
        lift, drag_of_forces, *_ = coefficients
        return {
            "CL": lift,
            "CD": drag_of_forces,
            "CM": coefficients[2:],
            "CD_induced": drag / self.coefficients.area,
            "span_load": load,
        }
