"""What commands say of the periodic sides of a mesh or a grid: what lays them onto each other, and how well it does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ...core.background.periodic_sides import PeriodicSides
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.topology.periodic_ties import gap_between, sides_of
from ...grids.topology.topology import Topology

__all__ = ["gap_lines", "side_numbers", "split_lines", "tied_numbers"]

SPLIT = 1e-9
"""Part of the size of a mesh by which a deformation may differ on copies of nodes: round-off."""


def side_numbers(
    sides: Sequence[PeriodicSides],
    mesh: MixedMesh,  # the mesh on the baseline
    points: np.ndarray | None = None,  # (n_points, 3), its nodes where it was moved
) -> list[dict]:
    """Collect motion and gap of each pair for JSON, and the gap before where the mesh was moved."""
    return [_pair_numbers(each.markers, each.motion, each.gap, mesh.points, points) for each in sides]


def tied_numbers(
    topology: Topology,
    baseline: np.ndarray,  # (n_nodes, 3), the nodes on the baseline (m)
    nodes: np.ndarray | None = None,  # (n_nodes, 3), the nodes where the grid was moved
) -> list[dict]:
    """Collect the same of the sides of blocks that are tied."""
    return [
        _pair_numbers(sides_of(topology, tied), tied.motion, partial(gap_between, topology, tied), baseline, nodes)
        for tied in topology.periodic
    ]


def _pair_numbers(
    markers: Sequence[str],
    motion: object,
    gap: Callable[[np.ndarray], float],  # of nodes (n, 3)
    baseline: np.ndarray,  # (n, 3), nodes on the baseline (m)
    nodes: np.ndarray | None,  # (n, 3), nodes where they were moved
) -> dict:
    """Collect the numbers of one pair."""
    at_rest = {"markers": list(markers), "motion": str(motion), "gap": gap(baseline)}
    return at_rest if nodes is None else at_rest | {"gap": gap(nodes), "gap_before": at_rest["gap"]}


def gap_lines(numbers: Sequence[dict], unit: str) -> list[str]:
    """Say how far copies of nodes are from where they should be."""
    return [
        f"copies of nodes of {' and '.join(each['markers'])}, a {each['motion']}, are off by up to "
        f"{each['gap']:.3g} {unit}" + (f", {each['gap_before']:.3g} before" if "gap_before" in each else "")
        for each in numbers
    ]


def split_lines(
    off: float,  # how differently a deformation moves nodes of walls and their copies, at most (m)
    size: float,  # size of the mesh (m)
    unit: str,
    where: str,  # the node, and where it goes
) -> list[str]:
    """Say of walls that end on both periodic sides if they were asked to move differently there."""
    if off <= SPLIT * size:
        return []
    return [
        f"walls end on both periodic sides, and the deformation differs there by up to {off:.3g} {unit}, at {where}; "
        f"deform them alike there, or other walls by --design"
    ]
