"""What commands say of the periodic sides of a mesh: what lays them onto each other, and how well it does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.background.periodic_sides import PeriodicSides
from ...grids.cells.mixed_cells import MixedMesh

__all__ = ["gap_lines", "side_numbers"]


def side_numbers(
    sides: Sequence[PeriodicSides],
    mesh: MixedMesh,  # the mesh on the baseline
    points: np.ndarray | None = None,  # (n_points, 3), its nodes where it was moved
) -> list[dict]:
    """Collect motion and gap of each pair for JSON, and the gap before where the mesh was moved."""
    now = mesh.points if points is None else points
    return [
        {
            "markers": list(each.markers),
            "motion": str(each.motion),
            "gap": each.gap(now),
            **({} if points is None else {"gap_before": each.gap(mesh.points)}),
        }
        for each in sides
    ]


def gap_lines(numbers: Sequence[dict], unit: str) -> list[str]:
    """Say how far copies of nodes are from where they should be."""
    return [
        f"copies of nodes of {' and '.join(each['markers'])}, a {each['motion']}, are off by up to "
        f"{each['gap']:.3g} {unit}" + (f", {each['gap_before']:.3g} before" if "gap_before" in each else "")
        for each in numbers
    ]
