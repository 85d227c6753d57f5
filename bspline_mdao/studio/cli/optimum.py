"""The grid of the optimum in ``optimize``, by the kind of its model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from typing import Any, Protocol

import openmdao.api as om

from ...base.numerics.vectors import lengths
from ...core.background.mesh_model import MeshModel
from ...core.design.cad_variables import moved_body
from ...core.mesh.surface_map import SurfaceMap
from ...core.model.fitted_model import FittedModel
from ...core.model.movable import Movable
from ...grids.topology.periodic_gap import periodic_gaps
from ...names import CONTROL_POINTS, SURFACE_CONTROL_POINTS
from ..study.study import Study
from .moved_mesh import MovedMesh

__all__ = ["CadOptimum", "Optimum", "cad_optima", "optimum_of"]

MOST_MISSED = 0.1
"""Distance between wall nodes and their targets, relative to the move of the faces, above which a warning is given."""


class Optimum(Protocol):
    """The grid of the optimum, compared with the baseline."""

    def numbers(self) -> dict:
        """Numbers for JSON."""

    def show(self) -> None:
        """Print what is known about its cells."""

    def warnings(self) -> list[str]:
        """Problems of the grid."""


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
        """One for each pair."""
        return list(self.texts)


@singledispatch
def optimum_of(
    model: Movable,  # the optimised model
    problem: om.Problem,  # at the optimum
) -> Optimum:
    """Examine the grid of the optimum."""
    raise TypeError(f"an optimum of {type(model).__name__}")


@optimum_of.register
def _of_blocks(model: FittedModel, problem: om.Problem) -> Optimum:
    moved = model.regenerate(problem.get_val(CONTROL_POINTS).reshape(-1, 3))
    return _Gaps(tuple(map(str, periodic_gaps(model.topology, model.regenerate(), moved))))


@optimum_of.register
def _of_mesh(model: MeshModel, problem: om.Problem) -> Optimum:
    points = problem.get_val(CONTROL_POINTS).reshape(-1, 3)
    return MovedMesh.of(model, points, model.node_map.at(points).nodes)  # nodes of all processes


@dataclass(frozen=True)
class CadOptimum:
    """A CAD file of the optimum, and how far walls of the grid are from where its faces moved them."""

    result: str  # name of the file
    moved: float  # largest target move of a wall node by its faces (m)
    missed: float  # largest distance of a wall node from its target (m)

    def __str__(self) -> str:
        return (
            f"{self.result}: faces move walls by up to {self.moved:.2g} m, and walls of the grid are within "
            f"{self.missed:.2g} m of that"
        )

    @property
    def warning(self) -> str:
        """Why file and grid are not the same shape; empty if they are."""
        if self.missed <= MOST_MISSED * self.moved:
            return ""
        return (
            f"{self.result}: is {self.missed:.2g} m off walls of the grid, which it moves by up to {self.moved:.2g} m: "
            f"the grid has too few control points for such moves; fit it with more, or let fewer points of faces move"
        )


def cad_optima(
    study: Study,  # the study
    names: dict[str, Any],  # namespace of its script, at the optimum
) -> list[CadOptimum]:
    """Compare CAD files of the optimum with the grid."""
    found, problem = [], names["problem"]
    for file, result in study.cad_results.items():
        tied, cad = names["tied"][file], names["cad"]
        variables = [cad[name] for name, table in study.variables.items() if table.get("file") == file]
        body = moved_body(variables, {variable.name: problem.get_val(variable.name) for variable in variables})
        points = problem.get_val(SURFACE_CONTROL_POINTS).reshape(-1, 3)
        nodes, asked = SurfaceMap.of(tied.model, names["wing"].mesh, tied.surface).at(points).nodes, tied.nodes(body)
        moved, missed = (float(lengths(there - asked).max()) for there in (tied.surface.points, nodes))
        found.append(CadOptimum(result, moved, missed))
    return found
