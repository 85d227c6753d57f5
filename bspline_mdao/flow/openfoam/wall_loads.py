"""Loads on walls, summed here over the faces of a case: pressure and friction as OpenFOAM wrote them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array, eye_array

from ...base.display import OneLine
from ...errors import InputError, SolverError
from ...grids.cells.polygons import polygon_geometry
from ...grids.io.meshes.foam_lists import FoamFile
from ...grids.io.meshes.polymesh import patches_of
from ..loads.force_coefficients import ForceCoefficients
from .case_fields import WrittenField
from .flow_case import FreeStream

__all__ = ["CaseWalls", "WallLoads", "wall_loads"]


@dataclass(frozen=True, eq=False)
class CaseWalls(OneLine):
    """Faces of some patches of a case."""

    patches: dict[str, slice]  # range of each patch among them, by name
    corners: np.ndarray  # int (n_corners,), points of the faces in sequence
    sizes: np.ndarray  # int (n_faces,), number of corners of each
    cells: np.ndarray  # int (n_faces,), cells behind them
    n_cells: int  # cells of the case
    points: np.ndarray  # (n_points, 3), points of the case (m)

    @classmethod
    def of(
        cls,
        folder: Path,  # the ``polyMesh``
        names: Sequence[str],  # the patches
    ) -> CaseWalls:
        """Read them from a mesh; `InputError` if it has no such patch."""
        corners, sizes = FoamFile.read(folder, "faces").faces()
        owner = FoamFile.read(folder, "owner").labels()
        ranges = {
            name: (first, first + n) for name, _, first, n in patches_of(FoamFile.read(folder, "boundary"), len(sizes))
        }
        missing = [name for name in names if name not in ranges]
        if missing:
            raise InputError(f"{folder}: no patch is '{missing[0]}'; its patches are {', '.join(ranges)}")
        places = [np.arange(*ranges[name]) for name in names]
        ends = np.cumsum([0, *map(len, places)])
        rows = np.concatenate(places) if places else np.zeros(0, dtype=int)
        starts = np.cumsum(sizes) - sizes
        within = [np.arange(starts[row], starts[row] + sizes[row]) for row in rows]
        return cls(
            patches={name: slice(start, stop) for name, start, stop in zip(names, ends, ends[1:])},
            corners=corners[np.concatenate(within)] if within else np.zeros(0, dtype=int),
            sizes=sizes[rows],
            cells=owner[rows],
            n_cells=int(owner.max()) + 1,
            points=FoamFile.read(folder, "points").points().values,
        )

    @property
    def n_faces(self) -> int:
        """Faces of all of the patches."""
        return len(self.sizes)

    def geometry(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres (m) and area vectors (m^2) of the faces, each of shape (n_faces, 3)."""
        return polygon_geometry(self.points, self.corners, np.cumsum([0, *self.sizes]))

    def values(self, field: WrittenField) -> np.ndarray:
        """Values of a field on the faces, shape (n_faces,), or (n_faces, 3) for a vector."""
        parts = [field.on_patch(name, self.cells[part], self.n_cells) for name, part in self.patches.items()]
        values = np.concatenate(parts)
        if not np.isfinite(values).all():
            raise SolverError(f"{field.path}: is not finite on walls; the flow diverged: take a smaller step")
        return values


@dataclass(frozen=True, eq=False)
class WallLoads(OneLine):
    """Coefficients of a flow, and pressure and friction on its walls."""

    # CL, CD: lift and drag
    CL: float
    CD: float
    CM: np.ndarray  # (3,), moments about the axes x, y and z of the grid
    Cp: np.ndarray  # (n_faces,), pressure coefficients
    Cf: np.ndarray  # (n_faces, 3), friction on the wall, as a vector, divided by the dynamic pressure


def wall_loads(
    walls: CaseWalls,
    folder: Path,  # time of the fields: ``p``, and ``wallShearStress`` if it was written
    stream: FreeStream,
    alpha: float,  # angle of attack (rad)
    axes: np.ndarray,  # (3, 3), rows are the directions downstream, along the span, and up
    references: tuple[float, float, Sequence[float]],  # area (m^2), chord (m) and reference point of moments (m)
) -> WallLoads:
    """Sum pressure and friction over the faces of walls."""
    centres, areas = walls.geometry()
    Cp = (walls.values(WrittenField.read(folder, "p")) - stream.pressure) / stream.dynamic_pressure
    Cf = np.zeros((walls.n_faces, 3))
    if (folder / "wallShearStress").is_file():  # stress of the wall on the flow
        Cf -= walls.values(WrittenField.read(folder, "wallShearStress")) / stream.dynamic_pressure
    forces = Cp[:, None] * areas + Cf * np.linalg.norm(areas, axis=1)[:, None]
    coefficients = ForceCoefficients(csr_array(eye_array(walls.n_faces)), axes, *references)
    found = coefficients.evaluate(forces, centres, alpha)
    return WallLoads(float(found["CL"]), float(found["CD"]), found["CM"], Cp, Cf)
