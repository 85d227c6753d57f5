"""The functions offered to frameworks, as chains: grids, quality and measures.

Each takes points, or design variables by name, and is the same for every framework; the specific parts are in
`.jax_functions` and `.torch_functions`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.checks import require_list
from ...base.numerics.processes import ONE
from ...errors import InputError
from ...grids.cells.aggregates import AGGREGATES
from ...names import CONTROL_POINTS, GRID, SURFACE, SURFACE_CONTROL_POINTS
from ..design.parametrization import Parametrization
from ..fit.surface_fit import follower_of
from ..measures.measure import MEMBERS, Measure
from ..mesh.boundary import moving_mesh, require_mesh_of
from ..mesh.surface import SurfaceGrid
from ..mesh.surface_map import SurfaceMap
from ..model.movable import Movable
from ..movement.default_mover import default_mover
from ..movement.mover import Mover
from .batches import Batches
from .chain import Chain, Step
from .steps import ControlStep, FollowStep, MapStep, MeasureStep, MoveStep, QualityStep

__all__ = ["grid_function", "measures_function", "quality_function"]


def grid_function(
    model: Movable,
    parametrization: Parametrization | None = None,
    *,
    mover: Mover | None = None,
    surface: SurfaceGrid | None = None,
    numbers: Sequence[int] | np.ndarray | None = None,
    memory: int = 1,
) -> Batches:
    """Nodes of the grid from control points, from prescribed surface nodes, or from design variables."""
    _require_whole(model)
    points = {CONTROL_POINTS: model.control_points.shape}
    if parametrization is None and surface is None:
        if mover is not None:
            raise InputError("grid: control points are given, and nothing is moved; leave 'mover' out")
        evaluate = MapStep(model.node_map, points, GRID, model.n_nodes)
        return Batches(Chain(evaluate.inputs, [evaluate], [GRID]), False, False, memory)
    steps: list[Step] = []
    if parametrization is not None:
        moves_nodes = surface is not None and not parametrization.mesh.blocks
        if surface is not None and not moves_nodes:
            raise InputError("grid: both a parametrization and the nodes of a surface would move it; give one")
        steps.append(ControlStep(parametrization, SURFACE if moves_nodes else SURFACE_CONTROL_POINTS))
    mover = mover or _default_mover(model, parametrization, surface)
    require_mesh_of(model, mover.mesh, "grid: the mover's mesh")
    if surface is not None:
        chosen = _numbers(surface, numbers)
        follower = follower_of(model, mover.mesh, surface, chosen)
        steps.append(FollowStep(follower, len(mover.mesh.surface_ids)))
        node_map = model.map_meeting(surface.rows[chosen], model, mover.mesh.slides)
        if SURFACE in node_map.inputs:
            points = {**points, SURFACE: (len(chosen), 3)}
    else:
        node_map = model.map_sliding(mover.mesh.slides, model)
    steps += [MoveStep(mover), MapStep(node_map, points, GRID, model.n_nodes)]
    return Batches(Chain(steps[0].inputs, steps, [GRID]), parametrization is not None, False, memory)


def quality_function(
    model: Movable,
    aggregates: Sequence[str] | None = None,
    *,
    rho: float = 100.0,
    p: int = 64,
    rho_height: float = 1000.0,
    memory: int = 1,
) -> Batches:
    """Quality bounds of all cells by name, from the nodes of the grid."""
    _require_whole(model)
    judge = model.judge(None, ONE, rho=rho, p=p, rho_height=rho_height)
    names = aggregates
    if names is None:
        names = [name for name in judge.aggregates if AGGREGATES[name].is_default]
    judge.require(names)
    step = QualityStep(judge, tuple(names))
    return Batches(Chain(step.inputs, [step], list(names)), False, True, memory)


def measures_function(
    measures: Sequence[Measure],
    model: Movable | None = None,
    parametrization: Parametrization | None = None,
    *,
    memory: int = 1,
) -> Batches:
    """Measures of one surface by name, from its nodes or from design variables."""
    found = require_list(measures, "measure", MEMBERS, "measures")
    if not found:
        raise InputError("measures: there is none; give one or more")
    surface = found[0].surface
    if any(measure.surface is not surface for measure in found):
        raise InputError("measures: they are of several surfaces; make one function for each")
    names = [measure.name for measure in found]
    if len(set(names)) < len(names):
        raise InputError("measures: two of them have one name; give them others with name=...")
    if (model is None) != (parametrization is None):
        raise InputError("measures: design variables need both the model and the parametrization; give both or none")
    steps: list[Step] = []
    if model is not None and parametrization is not None:
        mesh = parametrization.mesh
        if mesh.blocks:
            node_map = SurfaceMap.of(model, mesh, surface)
            shapes = {SURFACE_CONTROL_POINTS: (len(mesh.surface_ids), 3)}
            steps += [ControlStep(parametrization), MapStep(node_map, shapes, SURFACE, surface.n_points)]
        else:
            steps.append(ControlStep(parametrization, SURFACE))
    steps += [MeasureStep(measure) for measure in found]
    return Batches(Chain(steps[0].inputs, steps, names), parametrization is not None, True, memory)


def _require_whole(model: Movable) -> None:
    if not isinstance(model, Movable):
        raise InputError(f"the model is of type {type(model).__name__}; make it with fit_grid(grid)")
    if model.ownership is not None:
        raise InputError(f"{model.source}: a process has a part of the grid alone; give the whole model")


def _default_mover(model: Movable, parametrization: Parametrization | None, surface: SurfaceGrid | None) -> Mover:
    """Mover on the mesh of the parametrization, or with the patches of a surface as the design surface."""
    if parametrization is not None and surface is None:
        return default_mover(model, parametrization.mesh)
    patches = None if surface is None else sorted(set(surface.patches))
    return default_mover(model, moving_mesh(model, patches))


def _numbers(surface: SurfaceGrid, numbers: Sequence[int] | np.ndarray | None) -> np.ndarray:
    """Numbers of the given nodes of a surface, each once."""
    if numbers is None:
        return np.arange(surface.n_points)
    found = np.asarray(numbers)
    is_sound = found.ndim == 1 and found.dtype.kind in "iu" and len(np.unique(found)) == len(found) > 0
    if not (is_sound and found.min() >= 0 and found.max() < surface.n_points):
        raise InputError(f"'numbers' are no numbers of the {surface.n_points} nodes of the surface, each once")
    return found
