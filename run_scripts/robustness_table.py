"""Movers compared on drastic deformations.

Drastic changes of shape by every mover: how often no cell is inverted, and how good the worst cell is. It takes two
minutes on two small canonical grids, and hours at the paper's size on real grids. The output is a table with a row for
each mover, of all grids, of the canonical and of the real ones, by deformation and by grid, and the cases that the
first mover loses and others do not.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

import bspline_mdao as bm
from bspline_mdao.grids import GridQuality, judge_move, with_guessed_patches
from bspline_mdao.movers import ConstantLaw, InverseVolumeLaw, WallDistanceLaw
from bspline_mdao.scripts import run

CANONICAL = {
    "plate": (bm.generators.flat_plate_grid, bm.generators.generic_blended_wing_body),
    "M6": (bm.generators.onera_m6_grid, bm.generators.rectangular_wing),
}
"""The grids of section IV, each with the shape that it becomes there."""

SIZES = {True: ((23, 33, 17), (9, 9, 7), 200_000), False: ((11, 13, 9), (7, 8, 5), 20_000)}
"""Nodes and control points of each of their twelve blocks, and nodes of the largest real grid, by ``paper``."""

DEFORMATIONS = ("twist=90deg", "stretch=2", "bend=120deg@0.7", "chord=0.5", "bumps=20cells")
"""What is asked of every grid."""

KINDS = {
    "elasticity": bm.movers.LinearElasticity,
    "held": bm.movers.FixedInterior,
    "transfinite": bm.movers.Transfinite,
    "torsional springs": bm.movers.TorsionalSprings,
    "radial, wendland c2": bm.movers.RadialBasis,
    "radial, volume": partial(bm.movers.RadialBasis, kernel="volume"),
    "delaunay": bm.movers.DelaunayGraph,
    "inverse distance": bm.movers.InverseDistance,
}
"""All movers that take increments, at their defaults but for these."""

PAPER = partial(bm.movers.LinearElasticity, n_increments=5)
"""Elasticity as in the paper."""

ELASTICITY = {
    "m = 5": PAPER,
    **{f"nu = {ratio}": partial(PAPER, poisson_ratio=float(ratio)) for ratio in ("-0.6", "0", "0.3")},
    "constant": partial(PAPER, stiffness=ConstantLaw()),
    "1 / V": partial(PAPER, stiffness=InverseVolumeLaw()),
    "1 / V^2": partial(PAPER, stiffness=InverseVolumeLaw(power=2.0)),
    "1 / d": partial(PAPER, stiffness=WallDistanceLaw()),
}
"""Elasticity with one setting changed at a time."""


@dataclass(frozen=True)
class Chosen:
    """A mover that moves in as many increments as the surface at hand needs."""

    mover: bm.movers.LinearElasticity | bm.movers.TorsionalSprings

    @property
    def mesh(self) -> bm.movers.MovingMesh:
        """Mesh that is moved."""
        return self.mover.mesh

    def move(self, initial: np.ndarray, surface: np.ndarray):
        """Move points (n_points, 3) of the baseline behind surface points (n_surface, 3), both in metres."""
        return replace(self.mover, n_increments=bm.movers.increments_for(self.mover, [surface])).move(initial, surface)


def chosen(kind: Callable) -> Callable:
    """Make movers of a kind that take as many increments as they need."""
    return lambda mesh: Chosen(kind(mesh))


INCREMENTS = {
    "chosen": chosen(bm.movers.LinearElasticity),
    **{f"m = {m}": partial(bm.movers.LinearElasticity, n_increments=m) for m in (1, 2, 5, 10, 20)},
    "torsional springs, chosen": chosen(bm.movers.TorsionalSprings),
    "torsional springs, m = 5": partial(bm.movers.TorsionalSprings, n_increments=5),
}
"""Numbers of increments, and the number that is chosen for each case."""

STUDIES = {
    "movers": {name: partial(kind, n_increments=5) for name, kind in KINDS.items()}
    | {"rotations": bm.movers.Rotations},
    "one increment": {name: partial(kind, n_increments=1) for name, kind in KINDS.items()},
    "elasticity": ELASTICITY,
    "increments": INCREMENTS,
}
"""What is compared: movers by name, each made of a mesh."""


@dataclass(frozen=True, eq=False)
class Body:
    """A fitted grid, its residual kept: the grid that is judged is the user's; and a shape that it may become."""

    name: str
    grid: bm.Grid
    n_control: tuple[int, int, int] | None = None
    target: bm.generators.Shape | None = None

    def __post_init__(self):
        if not self.mesh.is_free.any():
            raise bm.InputError("no control point is free")

    @cached_property
    def model(self) -> bm.FittedModel:
        """Its fit, as it is done without any option."""
        return bm.fit_grid(with_guessed_patches(self.grid), n_control=self.n_control)

    @cached_property
    def mesh(self):
        """The control mesh."""
        return bm.movers.moving_mesh(self.model)

    @cached_property
    def quality(self) -> GridQuality:
        """Cells of the grid before any move."""
        return GridQuality.of_baseline(self.model.regenerate())

    def surface(self, request: str) -> np.ndarray:
        """Place the surface control points, shape (n_surface, 3), where a request wants them (m).

        Raises
        ------
        InputError
            If the surface leaves a plane of symmetry or the box around the grid, whose outer boundary stays, or has no
            such direction.
        """
        if request == "shape":
            return bm.generators.fit_shape(self.model, self.mesh.surface_ids, self.target)
        points = self.mesh.points
        surface = bm.design.parse_deformation(request, self.model, self.mesh).apply(points[self.mesh.surface_ids])
        outside = np.maximum(surface - points.max(axis=0), points.min(axis=0) - surface).max()
        if outside > 1e-6 * self.mesh.size:
            raise bm.InputError(f"the surface would leave the box around the grid by {outside:.3g} m")
        return surface

    def judge(self, points: np.ndarray) -> tuple[int, float]:
        """Count the cells that moved control points invert, and find the smallest Q; of cells that were valid."""
        return judge_move(self.quality, self.model.regenerate(points).to_vector().reshape(-1, 3))[:2]


@dataclass(frozen=True)
class Outcome:
    """What a mover made of a case: of cells and control elements, those that were valid before the move count."""

    body: str
    deformation: str
    mover: str
    n_inverted: int = 0
    q_min: float = float("nan")
    n_tangled: int = 0
    failure: str = ""
    seconds: float = 0.0

    @property
    def case(self) -> tuple[str, str]:
        """What was asked of which grid."""
        return self.body, self.deformation

    @property
    def is_valid(self) -> bool:
        """Whether the mover gave a grid in which no cell has inverted."""
        return not self.failure and self.n_inverted == 0


def main(
    paper: bool = False,
    folder: str | None = None,
    study: Literal["movers", "one increment", "elasticity", "increments"] = "movers",
    deformations: Sequence[str] = DEFORMATIONS,
) -> dict:
    """Move every grid by every deformation with every mover, five increments each where it takes any.

    Parameters
    ----------
    paper : bool
        Canonical grids of 12 blocks of 23 x 33 x 17 nodes with 9 x 9 x 7 control points, and real ones of up to 200 000
        nodes; by default 11 x 13 x 9 with 7 x 8 x 5, and 20 000.
    folder : path-like, optional
        Folder of real grids; the environment variable ``BSPLINE_MDAO_GRIDS`` by default, and none without it.
    study : {"movers", "elasticity", "one increment", "increments"}
        What is compared: all movers; settings of elasticity; all movers in a single increment; numbers of increments,
        and the choice.
    deformations : sequence of str
        What is asked of every grid, as for `parse_deformation`.

    Returns
    -------
    dict
        ``movers``, a row for each, see `row`; ``canonical`` and ``real``, the same for only those grids;
        ``by_deformation`` and ``by_grid``, the same for each; ``lost``, the cases that the first mover does not manage
        and others do; ``fallback``, the grids on which control points fall back; ``left_out``, why a file is;
        ``not_applicable``, why a grid cannot take a deformation.
    """
    bodies, left_out = collect(paper, folder or os.environ.get("BSPLINE_MDAO_GRIDS"))
    outcomes, not_applicable = [], {}
    for body in bodies:
        for request in ([] if body.target is None else ["shape"]) + list(deformations):
            try:
                surface = body.surface(request)
            except bm.InputError as error:
                not_applicable[f"{body.name}: {request}"] = str(error)
                continue
            outcomes += [attempt(body, request, surface, *mover) for mover in STUDIES[study].items()]
    return {
        **rows(outcomes, lambda outcome: "canonical" if outcome.body in CANONICAL else "real"),
        "movers": table(outcomes),
        "by_deformation": rows(outcomes, lambda outcome: outcome.deformation),
        "by_grid": rows(outcomes, lambda outcome: outcome.body),
        "lost": lost(outcomes, next(iter(STUDIES[study]))),
        "fallback": [body.name for body in bodies if body.model.candidate_weights is not None],
        "left_out": left_out,
        "not_applicable": not_applicable,
    }


def collect(paper: bool, folder) -> tuple[list[Body], dict[str, str]]:
    """Prepare the canonical grids and the grids of a folder; and the reason why a file is left out, by its name."""
    shape, n_control, largest = SIZES[paper]
    bodies = [Body(name, make(shape), n_control, target()) for name, (make, target) in CANONICAL.items()]
    left_out, seen = {}, set()
    for path in sorted(Path(folder).iterdir()) if folder else ():
        try:
            grid = bm.read_grid(path)
            if grid.n_nodes > largest:
                raise bm.InputError(f"{grid.n_nodes} nodes")
            if grid.shapes in seen:  # the same one in another dialect
                raise bm.InputError("another grid has the same blocks")
            seen.add(grid.shapes)
            bodies.append(Body(path.name, grid))
        except bm.InputError as error:
            left_out[path.name] = str(error).replace(f"{path}: ", "")
    return bodies, left_out


def attempt(body: Body, request: str, surface: np.ndarray, name: str, make_mover: Callable) -> Outcome:
    """Move a body and judge the grid that comes of it."""
    case = Outcome(body.name, request, name)
    try:
        with threadpool_limits(1):
            start = time.process_time()
            points = make_mover(body.mesh).move(body.mesh.points, surface).points
            case = replace(case, seconds=time.process_time() - start)
            n_inverted, q_min = body.judge(points)
    except (bm.InputError, bm.MovementError) as error:
        return replace(case, failure=str(error))
    return replace(case, n_inverted=n_inverted, q_min=q_min, n_tangled=body.mesh.tangled(points).n_tangled)


def row(outcomes: list[Outcome], best: dict[tuple[str, str], float]) -> dict:
    """Sum up what a mover made of all cases; ``best`` is the largest worst Q of those that at least one mover manages.

    Returns
    -------
    dict
        ``n_cases``, ``n_valid``, ``share``, ``share_of_possible``, ``q_min`` (the smallest of all cases), ``q_median``
        (of the smallest Q of every case), ``n_best``, valid cases with the largest smallest Q of all movers,
        ``n_inverted`` cells of all cases, ``n_tangled`` cases with new invalid control elements, ``n_failed``, where
        the mover gave up, and ``seconds``, the median CPU time of a move.
    """
    n_valid = sum(outcome.is_valid for outcome in outcomes)
    q_min = [outcome.q_min for outcome in outcomes if not outcome.failure]
    return {
        "n_cases": len(outcomes),
        "n_valid": n_valid,
        "share": n_valid / max(1, len(outcomes)),
        "share_of_possible": n_valid / max(1, len(best)),
        "q_min": min(q_min, default=np.nan),
        "q_median": float(np.median(q_min)) if q_min else np.nan,
        "n_best": sum(outcome.is_valid and outcome.q_min >= best[outcome.case] for outcome in outcomes),
        "n_inverted": sum(outcome.n_inverted for outcome in outcomes),
        "n_tangled": sum(outcome.n_tangled > 0 for outcome in outcomes),
        "n_failed": sum(bool(outcome.failure) for outcome in outcomes),
        "seconds": float(np.median([outcome.seconds for outcome in outcomes])),
    }


def rows(outcomes: list[Outcome], key: Callable[[Outcome], str]) -> dict:
    """Rows of all movers, for each value of a key."""
    values = dict.fromkeys(map(key, outcomes))
    return {value: table([outcome for outcome in outcomes if key(outcome) == value]) for value in values}


def table(outcomes: list[Outcome]) -> dict:
    """Rows of all movers."""
    valid = [outcome for outcome in outcomes if outcome.is_valid]
    best = {case: max(o.q_min for o in valid if o.case == case) for case in {o.case for o in valid}}
    movers = dict.fromkeys(outcome.mover for outcome in outcomes)
    return {mover: row([outcome for outcome in outcomes if outcome.mover == mover], best) for mover in movers}


def lost(outcomes: list[Outcome], first: str) -> list[dict]:
    """Cases that the first mover does not manage and others do."""
    valid = [outcome for outcome in outcomes if outcome.is_valid]
    return [
        {"case": f"{o.body}: {o.deformation}", "n_inverted": o.n_inverted, "n_tangled": o.n_tangled, "others": others}
        for o in outcomes
        if o.mover == first and not o.is_valid and (others := {v.mover: v.q_min for v in valid if v.case == o.case})
    ]


if __name__ == "__main__":
    run(main)
