"""Periodic sides of a mesh or a grid in commands: the motion between them, and the remaining gap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ...core.background.periodic_sides import PeriodicSides
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.topology.grid import Grid
from ...grids.topology.periodic_gap import pair_gaps
from ...grids.topology.periodic_ties import gap_between, sides_of
from ...grids.topology.topology import Topology, describe

__all__ = ["block_numbers", "gap_lines", "side_numbers", "split_lines"]

SPLIT = 1e-9
"""Difference of a deformation between copies of nodes, relative to the size of a mesh, that counts as round-off."""


def side_numbers(
    sides: Sequence[PeriodicSides],
    mesh: MixedMesh,  # the mesh on the baseline
    points: np.ndarray | None = None,  # (n_points, 3), its moved nodes
) -> list[dict]:
    """Collect motion and gap of each pair for JSON, and the gap before if the mesh was moved."""
    return [_pair_numbers(each.markers, each.motion, each.gap, mesh.points, points) for each in sides]


def block_numbers(
    topology: Topology,
    baseline: Grid,  # the grid on the baseline
    grid: Grid | None = None,  # the moved grid
) -> list[dict]:
    """Collect the same for all periodic pairs of block sides, tied or found."""
    before, after = (None if each is None else each.to_vector().reshape(-1, 3) for each in (baseline, grid))
    assert before is not None
    numbers = [
        _pair_numbers(sides_of(topology, tied), tied.motion, partial(gap_between, topology, tied), before, after)
        for tied in topology.periodic
    ]
    for found in pair_gaps(topology, baseline, grid or baseline):
        sides = [
            ", ".join(describe(window, topology.shapes[window.block]) for window in windows)
            for windows in (found.pair.windows, found.pair.others)
        ]
        numbers.append({"markers": sides, "motion": str(found.pair.motion), "gap": found.gap})
        numbers[-1] |= {} if grid is None else {"gap_before": found.before}
    return numbers


def _pair_numbers(
    markers: Sequence[str],
    motion: object,
    gap: Callable[[np.ndarray], float],  # of nodes (n, 3)
    baseline: np.ndarray,  # (n, 3), nodes on the baseline (m)
    nodes: np.ndarray | None,  # (n, 3), moved nodes
) -> dict:
    """Collect the numbers of one pair."""
    at_rest = {"markers": list(markers), "motion": str(motion), "gap": gap(baseline)}
    return at_rest if nodes is None else at_rest | {"gap": gap(nodes), "gap_before": at_rest["gap"]}


def gap_lines(numbers: Sequence[dict], unit: str) -> list[str]:
    """Say how far copies of nodes are from their places."""
    return [
        f"copies of nodes of {' and '.join(each['markers'])}, a {each['motion']}, are off by up to "
        f"{each['gap']:.3g} {unit}" + (f", {each['gap_before']:.3g} before" if "gap_before" in each else "")
        for each in numbers
    ]


def split_lines(
    off: float,  # largest difference in the motion of wall nodes and their copies (m)
    size: float,  # size of the mesh (m)
    unit: str,
    where: str,  # the node, and its destination
) -> list[str]:
    """Say whether walls that end on both periodic sides were to move differently there."""
    if off <= SPLIT * size:
        return []
    return [
        f"walls end on both periodic sides, and the deformation differs there by up to {off:.3g} {unit}, at {where}; "
        f"deform both sides alike, or choose other walls by --design"
    ]
