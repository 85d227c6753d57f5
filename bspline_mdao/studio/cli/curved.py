"""Measures of curved hexahedra in commands: Jacobians, and their certificate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...grids.cells.bernstein import INVALID, UNDECIDED, VALID
from ...grids.cells.curved_grid import CurvedGrid
from .output import print_lines, print_table, print_title, print_warnings, written_json


@dataclass(frozen=True, eq=False)
class CurvedMeasures:
    """Curved elements, and the Jacobians of each."""

    grid: CurvedGrid  # the elements
    worst: np.ndarray  # (n,), smallest Jacobian of each, relative to its largest
    status: np.ndarray  # (n,), what is proved about it

    @classmethod
    def of(cls, grid: CurvedGrid) -> CurvedMeasures:
        """Measure all elements."""
        return cls(grid, grid.worst_jacobians(), grid.statuses())

    @property
    def is_inverted(self) -> np.ndarray:
        """Elements whose Jacobian is not positive everywhere, shape (n,)."""
        return (self.worst <= 0.0) | (self.status == INVALID)

    @property
    def n_inverted(self) -> int:
        """Number of these."""
        return int(self.is_inverted.sum())

    @property
    def at(self) -> int:
        """The worst element, an inverted one if there are any."""
        return int(np.argmin(np.where(self.is_inverted, self.worst - 2.0, self.worst)))

    def numbers(self) -> dict[str, Any]:
        """Collect the numbers of the elements for JSON."""
        return {
            "n_elements": len(self.grid.elements),
            "n_nodes": len(self.grid.nodes),
            "n_collapsed": int(self.grid.is_collapsed.sum()),
            "n_inverted": self.n_inverted,
            "n_undecided": int((self.status == UNDECIDED).sum()),
            "worst_jacobian": float(self.worst[self.at]),
        }

    def show(self, name: str, where: str, notes: tuple[str, ...] = ()) -> None:
        """Print the contents of a file and measures of its elements; ``where`` is the worst one, notes are warnings."""
        grid, numbers = self.grid, self.numbers()
        elements = counted(len(grid.elements), "curved hexahedron", "curved hexahedra")
        print_title(f"{name}: {elements} of degree {grid.degree}, {counted(len(grid.nodes), 'node')}")
        if grid.patches:
            print_table(["patch", "kind", "faces"], [(p.name, p.kind, f"{len(p.faces):,}") for p in grid.patches])
        print_lines([f"least Jacobian of an element, by its largest: {self.worst[self.at]:.3g}, {where}"])
        n_valid = int((self.status == VALID).sum())
        print_lines([f"proved valid everywhere: {n_valid:,} of {elements}; {numbers['n_undecided']:,} undecided"])
        found = list(notes)
        if numbers["n_collapsed"]:
            found.append(
                f"{numbers['n_collapsed']:,} elements have edges that have collapsed: they are hexahedra with a node "
                f"more than once"
            )
        if self.n_inverted:
            found.append(counted(self.n_inverted, "inverted element"))
        print_warnings(found)


def measure_curved(name: str, grid: CurvedGrid, json: Path | None, comm: Any) -> None:
    """Show measures of the curved elements of a file, and write the numbers."""
    with progress_bar() as progress:
        progress(0.3, "measuring")
        found = CurvedMeasures.of(grid)
    number = found.at + 1
    with written_json(json, {"grid": name, "degree": grid.degree, **found.numbers(), "worst_element": number}, comm):
        pass
    found.show(name, f"element {number:,}")
