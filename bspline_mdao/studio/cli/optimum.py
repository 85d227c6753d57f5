"""What ``optimize`` says of the grid of the design that it found, by the kind of its model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from typing import Protocol

import openmdao.api as om

from ...core.background.mesh_model import MeshModel
from ...core.model.fitted_model import FittedModel
from ...core.model.movable import Movable
from ...grids.topology.periodic_gap import periodic_gaps
from ...names import CONTROL_POINTS
from .moved_mesh import MovedMesh

__all__ = ["Optimum", "optimum_of"]


class Optimum(Protocol):
    """The grid of the design that was found, beside that before."""

    def numbers(self) -> dict:
        """Numbers for JSON."""

    def show(self) -> None:
        """Print what is known of its cells."""

    def warnings(self) -> list[str]:
        """What is wrong with it."""


@dataclass(frozen=True)
class _Gaps:
    """Periodic faces of a grid of blocks that have drifted apart."""

    texts: tuple[str, ...]

    def numbers(self) -> dict:
        """None."""
        return {}

    def show(self) -> None:
        """Nothing: bounds of its cells are among the responses."""

    def warnings(self) -> list[str]:
        """One for each."""
        return list(self.texts)


@singledispatch
def optimum_of(
    model: Movable,  # what was optimised
    problem: om.Problem,  # at the design that was found
) -> Optimum:
    """Look at the grid of the design that was found."""
    raise TypeError(f"an optimum of {type(model).__name__}")


@optimum_of.register
def _of_blocks(model: FittedModel, problem: om.Problem) -> Optimum:
    moved = model.regenerate(problem.get_val(CONTROL_POINTS).reshape(-1, 3))
    return _Gaps(tuple(map(str, periodic_gaps(model.topology, model.regenerate(), moved))))


@optimum_of.register
def _of_mesh(model: MeshModel, problem: om.Problem) -> Optimum:
    points = problem.get_val(CONTROL_POINTS).reshape(-1, 3)
    return MovedMesh.of(model, points, model.node_map.at(points).nodes)  # nodes of all processes
