"""Cells of a moved unstructured mesh in commands, and the heights at its walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.text import counted
from ...grids.cells.mesh_heights import height_quantiles
from ...grids.cells.mixed_cells import CellQuality, MixedMesh
from ...grids.cells.wall_heights import KEPT
from .output import measure_of_cells, print_lines, print_table

__all__ = ["MovedCells"]

MOST_NUMBERED = 100
"""Largest number of newly inverted cells to write as JSON."""


@dataclass(frozen=True, eq=False)
class MovedCells:
    """Cells before and after a move, and the heights at walls relative to the heights before."""

    mesh: MixedMesh
    before: CellQuality
    after: CellQuality
    ratios: np.ndarray  # (m,); empty without walls

    @classmethod
    def of(cls, mesh: MixedMesh, nodes: np.ndarray, ratios: np.ndarray) -> MovedCells:
        """Measure the cells of a mesh with its nodes moved, shape (n, 3)."""
        return cls(mesh, mesh.quality(), mesh.quality(nodes), ratios)

    @property
    def newly_inverted(self) -> np.ndarray:
        """Numbers of the cells that are inverted now and were not before."""
        return np.flatnonzero(self.after.is_inverted & ~self.before.is_inverted)

    @property
    def worst(self) -> int:
        """Number of the newly inverted cell with the smallest volume."""
        new = self.newly_inverted
        return int(new[np.argmin(self.after.volumes[new])])

    @property
    def size_of_worst(self) -> str:
        """Volume of the worst cell in words; its area in two dimensions."""
        what, unit = measure_of_cells(self.mesh)
        return f"{what} {self.after.volumes[self.worst] / self.mesh.width:.3g} {unit}"

    @property
    def _least(self) -> list[float]:
        """Smallest volume before and after; areas in two dimensions."""
        return [float(q.volumes.min(initial=np.inf)) / self.mesh.width for q in (self.before, self.after)]

    def numbers(self) -> dict:
        """Collect them for JSON."""
        return {
            "min_volume": dict(zip(("before", "after"), self._least)),
            "n_inverted": {"before": int(self.before.is_inverted.sum()), "after": int(self.after.is_inverted.sum())},
            "newly_inverted": self.newly_inverted[:MOST_NUMBERED].tolist(),
            "heights": height_quantiles(self.ratios),
        }

    def show(self) -> None:
        """Print the cells."""
        what, unit = measure_of_cells(self.mesh)
        rows = [
            (f"smallest {what} ({unit})", *self._least),
            ("inverted cells", int(self.before.is_inverted.sum()), int(self.after.is_inverted.sum())),
        ]
        print_table(["cells of the mesh", "before", "after"], rows)

    def show_heights(self) -> None:
        """Print the heights, if there are any."""
        quantiles = height_quantiles(self.ratios)
        if quantiles:
            print_lines(["heights of the first nodes at walls, relative to before:"])
            print_table(["min", "1 %", "median", "99 %", "max"], [tuple(f"{x:.3f}" for x in quantiles.values())])

    def warnings(self) -> list[str]:
        """List problems of the cells."""
        found = []
        if len(self.newly_inverted):
            found.append(counted(len(self.newly_inverted), "newly inverted cell"))
        quantiles = height_quantiles(self.ratios)
        if quantiles and not KEPT[0] <= quantiles["p01"] <= quantiles["p99"] <= KEPT[1]:
            found.append(
                f"the first nodes at walls are {quantiles['p01']:.3g} to {quantiles['p99']:.3g} times as high as "
                f"before (1 % to 99 %), and so is y+"
            )
        return found
