"""Drastic changes of shape by every mover: how often no cell inverts, and how good the worst cell is."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from common import run
from robustness_grids import MORPHS, Body, collect
from threadpoolctl import threadpool_limits

from bspline_mdao import InputError
from bspline_mdao.errors import MovementError
from bspline_mdao.movement.delaunay import DelaunayGraph
from bspline_mdao.movement.elasticity import LinearElasticity
from bspline_mdao.movement.fixed_interior import FixedInterior
from bspline_mdao.movement.inverse_distance import InverseDistance
from bspline_mdao.movement.radial_basis import RadialBasis
from bspline_mdao.movement.springs import LinealSprings, TorsionalSprings
from bspline_mdao.movement.transfinite import Transfinite
from bspline_mdao.movement.young_modulus import ConstantLaw, InverseVolumeLaw, WallDistanceLaw

DEFORMATIONS = ("twist=90deg", "stretch=2", "bend=120deg@0.7", "chord=0.5", "bumps=20cells")
"""What is asked of every grid."""

KINDS = {
    "elasticity": LinearElasticity,
    "held": FixedInterior,
    "transfinite": Transfinite,
    "lineal springs": LinealSprings,
    "torsional springs": TorsionalSprings,
    "radial, wendland c2": RadialBasis,
    "radial, volume": partial(RadialBasis, kernel="volume"),
    "delaunay": DelaunayGraph,
    "inverse distance": InverseDistance,
}
"""All movers, at their defaults but for the increments."""

PAPER = partial(LinearElasticity, n_increments=5)
"""Elasticity as in the paper."""

ELASTICITY = {
    "m = 5": PAPER,
    "nu = -0.6": partial(PAPER, poisson_ratio=-0.6),
    "nu = 0": partial(PAPER, poisson_ratio=0.0),
    "nu = 0.3": partial(PAPER, poisson_ratio=0.3),
    "constant": partial(PAPER, stiffness=ConstantLaw()),
    "1 / V": partial(PAPER, stiffness=InverseVolumeLaw()),
    "1 / V^2": partial(PAPER, stiffness=InverseVolumeLaw(power=2.0)),
    "1 / d": partial(PAPER, stiffness=WallDistanceLaw()),
}
"""Elasticity with one setting changed at a time."""

INCREMENTS = {
    "auto": LinearElasticity,
    "m = 1": partial(LinearElasticity, n_increments=1),
    "m = 2": partial(LinearElasticity, n_increments=2),
    "m = 5": PAPER,
    "m = 10": partial(LinearElasticity, n_increments=10),
    "m = 20": partial(LinearElasticity, n_increments=20),
    "torsional springs, auto": TorsionalSprings,
    "torsional springs, m = 5": partial(TorsionalSprings, n_increments=5),
    "lineal springs, auto": LinealSprings,
    "lineal springs, m = 5": partial(LinealSprings, n_increments=5),
}
"""Numbers of increments, and the number that the move chooses."""

STUDIES = {
    "movers": {name: partial(kind, n_increments=5) for name, kind in KINDS.items()},
    "one increment": {name: partial(kind, n_increments=1) for name, kind in KINDS.items()},
    "elasticity": ELASTICITY,
    "increments": INCREMENTS,
}
"""What is compared: movers by name, each made of a mesh."""


@dataclass(frozen=True)
class Outcome:
    """What a mover made of a case.

    Parameters
    ----------
    body, deformation, mover : str
        The case.
    n_inverted : int
        Cells of the regenerated grid that were valid before the move and are not after it.
    q_min : float
        Smallest Q of the cells that were valid before.
    n_tangled : int
        Control elements that were valid before the move and are not after it.
    failure : str
        Why the mover gave up; "" if it did not.
    """

    body: str
    deformation: str
    mover: str
    n_inverted: int = 0
    q_min: float = float("nan")
    n_tangled: int = 0
    failure: str = ""

    @property
    def case(self) -> tuple[str, str]:
        """Grid and deformation."""
        return self.body, self.deformation

    @property
    def is_valid(self) -> bool:
        """Whether the mover gave a grid in which no cell has inverted."""
        return not self.failure and self.n_inverted == 0


def main(paper: bool = False, figures=None, folder=None, study: str = "movers", deformations=DEFORMATIONS) -> dict:
    """Move every grid by every deformation with every mover, five increments each.

    Parameters
    ----------
    paper : bool
        Canonical grids of 12 blocks of 23 x 33 x 17 nodes with 9 x 9 x 7 control points, and real ones of up to 200 000
        nodes; by default 11 x 13 x 9 with 7 x 8 x 5, and 20 000.
    figures : path-like, optional
        No effect: there is nothing to draw.
    folder : path-like, optional
        Where real grids are; the environment variable ``BSPLINE_MDAO_GRIDS`` by default, and none without it.
    study : {"movers", "elasticity", "one increment", "increments"}
        All movers; settings of elasticity; all movers in a single increment; numbers of increments, and the choice.
    deformations : sequence of str
        What is asked of every grid, as for `bspline_mdao.design.named_deformations.parse_deformation`.

    Returns
    -------
    dict
        ``movers``, a row for each, see `row`; ``canonical`` and ``real``, the same for those grids alone;
        ``by_deformation`` and ``by_grid``, the same for each; ``lost``, the cases that the first mover does not manage
        and others do; ``fallback``, the grids on which control points fall back; ``left_out``, why a file is;
        ``not_applicable``, why a grid cannot take a deformation.
    """
    bodies, left_out = collect(paper, folder or os.environ.get("BSPLINE_MDAO_GRIDS"))
    outcomes, not_applicable = [], {}
    for body in bodies:
        for request in body.requests(deformations):
            try:
                surface = body.surface(request)
            except InputError as error:
                not_applicable[f"{body.name}: {request}"] = str(error)
                continue
            outcomes += [attempt(body, request, surface, *mover) for mover in STUDIES[study].items()]
    return {
        **rows(outcomes, lambda outcome: "canonical" if outcome.body in MORPHS else "real"),
        "movers": table(outcomes),
        "by_deformation": rows(outcomes, lambda outcome: outcome.deformation),
        "by_grid": rows(outcomes, lambda outcome: outcome.body),
        "lost": lost(outcomes, next(iter(STUDIES[study]))),
        "fallback": [body.name for body in bodies if body.falls_back],
        "left_out": left_out,
        "not_applicable": not_applicable,
    }


def attempt(body: Body, text: str, surface: np.ndarray, name: str, make_mover: Callable) -> Outcome:
    """Move a body and judge the grid that comes of it."""
    case = Outcome(body.name, text, name)
    try:
        with threadpool_limits(1):
            points = make_mover(body.mesh).move(body.mesh.points, surface).points
            n_inverted, q_min = body.judge(points)
    except (InputError, MovementError) as error:
        return replace(case, failure=str(error))
    return replace(case, n_inverted=n_inverted, q_min=q_min, n_tangled=body.mesh.tangled(points).n_tangled)


def row(outcomes: list[Outcome], possible: set) -> dict:
    """Sum up what a mover made of all cases.

    Parameters
    ----------
    outcomes : list of Outcome
        Those of the mover.
    possible : set
        Cases that at least one mover manages.

    Returns
    -------
    dict
        ``n_cases``, ``n_valid``, ``share``, ``share_of_possible``, ``q_min`` (the smallest of all cases), ``q_median``
        (of the smallest Q of every case), ``n_inverted`` cells of all cases, ``n_tangled`` cases with new invalid
        control elements, and ``n_failed``, where the mover gave up.
    """
    n_valid = sum(outcome.is_valid for outcome in outcomes)
    q_min = [outcome.q_min for outcome in outcomes if not outcome.failure]
    return {
        "n_cases": len(outcomes),
        "n_valid": n_valid,
        "share": n_valid / max(1, len(outcomes)),
        "share_of_possible": n_valid / max(1, len(possible)),
        "q_min": min(q_min, default=np.nan),
        "q_median": float(np.median(q_min)) if q_min else np.nan,
        "n_inverted": sum(outcome.n_inverted for outcome in outcomes),
        "n_tangled": sum(outcome.n_tangled > 0 for outcome in outcomes),
        "n_failed": sum(bool(outcome.failure) for outcome in outcomes),
    }


def rows(outcomes: list[Outcome], key: Callable[[Outcome], str]) -> dict:
    """Rows of all movers, for each value of a key."""
    groups = {key(outcome): [] for outcome in outcomes}
    for outcome in outcomes:
        groups[key(outcome)].append(outcome)
    return {value: table(group) for value, group in groups.items()}


def table(outcomes: list[Outcome]) -> dict:
    """Rows of all movers."""
    possible = {outcome.case for outcome in outcomes if outcome.is_valid}
    movers = dict.fromkeys(outcome.mover for outcome in outcomes)
    return {mover: row([outcome for outcome in outcomes if outcome.mover == mover], possible) for mover in movers}


def lost(outcomes: list[Outcome], first: str) -> list[dict]:
    """Cases that the first mover does not manage and others do."""
    won = {}
    for outcome in outcomes:
        if outcome.is_valid:
            won.setdefault(outcome.case, {})[outcome.mover] = outcome.q_min
    return [
        {"case": ": ".join(o.case), "n_inverted": o.n_inverted, "n_tangled": o.n_tangled, "others": won[o.case]}
        for o in outcomes
        if o.mover == first and not o.is_valid and o.case in won
    ]


if __name__ == "__main__":
    run(
        main,
        __doc__,
        folder={"help": "folder of real grids"},
        study={"choices": tuple(STUDIES), "default": "movers", "help": "what is compared"},
    )
