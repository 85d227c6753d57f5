"""Marching a front away from a surface, layer by layer.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....base.display import OneLine
from ....base.numerics.progress import Progress
from ....base.numerics.vectors import dots
from .first_layer import with_exact_heights
from .front import differences, normals_and_areas, smallest_corner, smooth
from .repeats import Repeats
from .rings import Rings
from .solver import solve
from .step_system import FREE, assemble
from .surface import SurfaceMesh

LARGEST_STRETCH = 2.0
"""Largest factor on a step that gives layers their heights on average."""

ONSET = 0.4
"""Power of the layer with which dissipation sets in. With the root the smallest corner of the M6, at its tip, falls
over the layers that are not smoothed yet; with 0.35 the 1 % corner of the wing body is worse."""


@dataclass(frozen=True)
class Marching(OneLine):
    """Settings of an extrusion; the defaults suit the M6 and the wing body of ``docs/theory/extrusion.rst``.

    Parameters
    ----------
    dissipation : float
        Coefficient of Chan and Steger. 0.25 inverts cells at the tip of the M6; from 0.7 on the 1 % corner of the wing
        body is worse than pyHyp's.
    ratio : float
        Longest step relative to the shortest edge at a node; a layer is made in as many steps as needed.
    steps : int
        Most steps of a layer, the last one as long as necessary: lines that meet would need ever more.
    explicit : float
        The same ratio of the first layer below which the heights of nodes are exact.
    blend : float
        Weight with which a cycle of smoothing blends areas with the neighbours'.
    cycles : int
        Number of such cycles at the last layer; there are none at the first. 50 invert cells where a thin wing meets a
        body, 100 at blunt tips.
    mitre : float
        Power of mitres beyond the first layer: with 0 edges of convex surfaces become round, with 1 they stay sharp.
    tolerance : float
        Relative residual of the systems; 1e-5 moves no quantile of corners by 1e-3.
    iterations : int
        Most iterations of the solver.
    retries : int
        Tries of a layer with inverted cells, each with twice the dissipation and half the ratio.

    Examples
    --------
    >>> from bspline_mdao.generators import Marching
    >>> Marching(dissipation=1.0).dissipation
    1.0
    """

    dissipation: float = 0.65
    ratio: float = 10.0
    steps: int = 30
    explicit: float = 0.5
    blend: float = 0.25
    cycles: int = 50
    mitre: float = 0.0
    tolerance: float = 1e-3
    iterations: int = 200
    retries: int = 3


@dataclass(frozen=True, eq=False)
class Conditions:
    """Constraints of the nodes, see `bspline_mdao.core.generators.extrusion.rims`."""

    # arrays are for the n marching nodes
    repeats: Repeats
    rings: Rings
    constraint: np.ndarray  # int (n,)
    projectors: np.ndarray  # (n_projectors, 3, 3)
    splay: np.ndarray  # (n, 3)
    is_side: np.ndarray  # bool (n,), nodes at sides of blocks: heights there are measured from each block
    places: np.ndarray  # int (n_places,), the node in each place of a side of a block
    areas: np.ndarray  # (n_places, 3), area vectors there (m2)


@dataclass(frozen=True, eq=False)
class March:
    """Result of a march, as far as it got."""

    fronts: np.ndarray  # (n_layers + 1, n, 3) (m)
    corners: np.ndarray  # (n_layers,), smallest triple product of unit edges at corners of the cells of each layer
    worst: np.ndarray  # int (n_layers,), quad below it

    @property
    def is_valid(self) -> bool:
        """Whether no cell is inverted."""
        return bool((self.corners > 0.0).all() and np.isfinite(self.fronts).all())


def march(
    mesh: SurfaceMesh,
    conditions: Conditions,
    steps: np.ndarray,  # (n_layers,), heights of layers (m)
    settings: Marching,
    through: bool,  # whether to continue if cells are inverted
    progress: Progress,
) -> March:
    """March over layers, all of them or up to the first with inverted cells."""
    repeats, front, fronts, corners = conditions.repeats, mesh.points[conditions.repeats.first], [mesh.points], []
    previous = np.zeros(0)
    for number, step in enumerate(steps):
        level = (number / max(1, len(steps) - 1)) ** ONSET
        tries = []
        for retry in range(settings.retries + 1):
            make = _layer if number else _first_layer
            with np.errstate(all="ignore"):  # NaN counts as an inverted cell
                after, lengths = make(front, previous, conditions, step, level, settings, 2.0**retry)
            tries.append((*smallest_corner(fronts[-1], repeats.all(after), mesh.quads), after, lengths))
            if tries[-1][0] > 0.0:
                break
        corner, quad, front, previous = max(tries, key=lambda each: np.nan_to_num(each[0], nan=-np.inf))
        fronts.append(repeats.all(front))
        corners.append((corner, quad))
        if not (corner > 0.0 or through) or not np.isfinite(front).all():
            break
        progress((number + 1) / len(steps), "marching")
    least, worst = zip(*corners)
    return March(np.array(fronts), np.array(least), np.array(worst))


def _first_layer(
    front: np.ndarray,  # (n, 3), the surface
    previous: np.ndarray,  # none, then as for a layer
    conditions: Conditions,
    step: float,
    level: float,
    settings: Marching,
    effort: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Make the layer at the surface: if it is low, nodes move independently and have their exact heights."""
    rings = conditions.rings
    d, lengths = differences(front, *rings)
    normals, mitres, areas = normals_and_areas(d, rings.starts, conditions.is_side)
    rates, shortest = mitres * _rates(areas, rings, level, settings), np.minimum.reduceat(lengths, rings.starts[:-1])
    largest = effort * settings.explicit * shortest / step
    exact = front + step * _explicit(normals * rates[:, None], conditions, largest)
    is_low = rates <= largest
    if is_low.all():
        return exact, lengths
    after, lengths = _layer(front, previous, conditions, step, level, settings, effort)
    return np.where(is_low[:, None], exact, after), lengths


def _layer(
    front: np.ndarray,  # (n, 3)
    previous: np.ndarray,  # (n_neighbours,), lengths of the differences one step before; none at the surface
    conditions: Conditions,
    step: float,  # height of the layer (m)
    level: float,  # 0 at the first layer, 1 at the last
    settings: Marching,
    effort: float,  # factor that raises dissipation and shortens steps
) -> tuple[np.ndarray, np.ndarray]:  # the next front, and lengths of differences at the last step
    """Make a layer in as many steps as the shortest edges need."""
    rings, left = conditions.rings, 1.0
    for last in range(settings.steps - 1, -1, -1):
        d, lengths = differences(front, *rings)
        normals, mitres, areas = normals_and_areas(d, rings.starts, conditions.is_side & (level == 0.0))
        # where three faces meet, the offsets of all of them narrow the corners from layer to layer
        rates = (mitres if level == 0.0 else mitres**settings.mitre) * _rates(areas, rings, level, settings)
        ratio = step * float((rates / np.minimum.reduceat(lengths, rings.starts[:-1])).max())
        part = left / max(1, math.ceil(left * ratio * effort / settings.ratio)) if last and np.isfinite(ratio) else left
        before = previous if len(previous) else lengths
        system = assemble(
            d, lengths, before, *rings[:4], normals,
            part * step * rates, max(level, 1e-3), effort * settings.dissipation,
            conditions.projectors, conditions.constraint, level * conditions.splay,
        )  # fmt: skip
        move = system[2].copy()
        solve(rings.starts, rings.nodes, *system, move, settings.tolerance, settings.iterations)
        # where the front widens, its volumes give less height than the layer's; on average it gets the layer's
        asked, made = part * step * rates.mean(), float(dots(move, normals).mean())
        front, previous = front + min(asked / made, LARGEST_STRETCH) * move if made > 0.0 else front + move, lengths
        if part == left:
            break
        left -= part
    return front, previous


def _rates(areas: np.ndarray, rings: Rings, level: float, settings: Marching) -> np.ndarray:
    """Heights of nodes relative to the layer's: areas are smoothed, and small ones give higher cells."""
    volumes = areas.copy()
    smooth(volumes, rings.starts, rings.nodes, settings.blend, int(settings.cycles * level**2))
    rates = volumes / areas
    return rates / rates.mean()


def _explicit(moves: np.ndarray, conditions: Conditions, largest: np.ndarray) -> np.ndarray:
    """Independent moves of nodes within their constraints, relative to the height."""
    allowed = conditions.projectors[np.where(conditions.constraint == FREE, 0, conditions.constraint)]
    moves = np.einsum("nij,nj->ni", allowed, moves)
    return with_exact_heights(moves, conditions.places, conditions.areas, allowed, largest)
