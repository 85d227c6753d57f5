"""Deformations by a lattice whose points have moved: a free-form box moves what is in it.

Theory: ``docs/theory/deformations.rst``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ..splines.volume import evaluate, evaluate_gradients
from .embedding import FreeFormVolumes
from .lattice_file import read_lattice

__all__ = ["LatticeDeformation", "moved_lattice"]


@dataclass(frozen=True, eq=False)
class LatticeDeformation(OneLine):
    """Move points by ``amount`` times the displacement of a lattice."""

    lattice: FreeFormVolumes  # on the baseline
    displacement: np.ndarray  # (n, 3), of its points (m)
    amount: float = 1.0

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres; real, or complex by a step. `InputError` if some are outside the lattice."""
        found = self.lattice.find(np.ascontiguousarray(points.real))
        outside = np.flatnonzero(~found.is_inside)
        if len(outside):
            place = ", ".join(f"{x:.4g}" for x in points.real[outside[0]])
            raise InputError(
                f"lattice: {len(outside)} of {len(points)} points of the surface lie outside, by up to "
                f"{found.distance[outside].max():.3g} m, the first at {place}; make the lattice larger, or deform less "
                f"of the surface (--design)"
            )
        mesh, moved = self.lattice.mesh, points + 0.0 * self.amount  # complex if one of them is
        nets, changes = mesh.nets(self.lattice.points), mesh.nets(self.displacement)
        for number, volume in enumerate(mesh.volumes):
            rows = np.flatnonzero(found.volume == number)
            if not len(rows):
                continue
            at = found.parameters[rows]
            moved[rows] = moved[rows] + self.amount * evaluate(volume, changes[number], at)
            if np.iscomplexobj(points):  # parameters change with the points
                metrics = evaluate_gradients(volume, nets[number], at)
                rates = np.linalg.solve(metrics, points.imag[rows, :, None])
                by = (evaluate_gradients(volume, changes[number], at) @ rates)[:, :, 0]
                moved[rows] = moved[rows] + 1j * self.amount * by
        return moved


def moved_lattice(before: str | os.PathLike, after: str | os.PathLike) -> LatticeDeformation:
    """Deform as a lattice did from one file to another, such as a pyGeo box before and after a design."""
    lattice, moved = read_lattice(before), read_lattice(after)
    if lattice.counts != moved.counts or lattice.points.shape != moved.points.shape:
        raise InputError(
            f"{after}: has {moved.counts} points, and {before} has {lattice.counts}; give the same lattice, moved"
        )
    return LatticeDeformation(lattice, moved.points - lattice.points)
