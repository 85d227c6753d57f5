"""Forces from the pressures on walls, as SU2 sums them: each node has the part of its faces that is closest to it.

On the first run they show whether SU2's forces are for the intended walls, reference values and axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .frame import Su2Frame
from .mesh_text import MeshToFly
from .tables import NodeTable

__all__ = ["WallPressures"]

SLACK, SLACK_VISCOUS = 1e-3, 0.1
"""Relative difference allowed between SU2's force and the force of the pressures: without friction from the cutting of
non-planar faces, with friction from its contribution to the lift."""


@dataclass(frozen=True, eq=False)
class WallPressures(OneLine):
    """Faces of the walls."""

    quads: np.ndarray  # (n, 4) of int, nodes of the mesh around the normal into the fluid; triangles repeat the last
    n_stored: int  # nodes of the file; higher numbers are copies in the second plane
    height: float  # between the planes of a two-dimensional mesh; 1 in three dimensions

    @classmethod
    def of(cls, flown: MeshToFly) -> WallPressures:
        """Take the walls of a mesh."""
        mesh, across = flown.mesh, flown.across
        quads = np.concatenate([mesh.into_fluid((mesh.markers or {})[name]) for name in flown.walls])
        height = 1.0 if across is None else float(np.ptp(mesh.points[:, across]))
        return cls(quads, mesh.n_stored, height)

    @property
    def nodes(self) -> np.ndarray:
        """Nodes of the file on the walls, ascending."""
        return np.unique(self.quads % self.n_stored)

    def force(
        self,
        points: np.ndarray,  # (n_points, 3), nodes of the mesh (m)
        pressures: np.ndarray,  # (n_stored,), pressure coefficients
    ) -> np.ndarray:  # (3,), m^2
        """Sum the pressures on the walls."""
        corners, at = points[self.quads], pressures[self.quads % self.n_stored]
        is_triangle = self.quads[:, 2] == self.quads[:, 3]
        quads = _nodal_areas(corners[~is_triangle]), at[~is_triangle]
        triangles = _nodal_areas(corners[is_triangle, :3]), at[is_triangle, :3]
        return -sum(np.einsum("fc,fcx->x", p, area) for area, p in (quads, triangles)) / self.height

    def check(
        self,
        points: np.ndarray,  # (n_points, 3), nodes of the mesh (m)
        surface: NodeTable,  # SU2's values on the walls
        values: dict[str, float],  # SU2's forces
        frame: Su2Frame,
        alpha: float,  # deg
        area: float,  # m^2
        is_viscous: bool,
        what: str,  # for messages
    ) -> None:
        """Compare SU2's forces with each other and with its pressures."""
        forces = np.array([values[f"CF{axis}"] for axis in "xyz"[: frame.n_axes]])
        weights, _ = frame.lift_and_drag(alpha)
        stated, size = np.array([values["CD"], values["CL"]]), max(float(np.linalg.norm(forces)), 1e-6)
        if not np.allclose(weights @ forces, stated, rtol=0.0, atol=1e-6 * size):
            raise InputError(
                f"{what}: SU2's CD and CL are {stated}, but {weights @ forces} by its forces along its axes and the "
                f"angle of attack; check AOA and SIDESLIP_ANGLE of the configuration"
            )
        pressures = np.full(self.n_stored, np.nan)
        pressures[surface.nodes] = surface.column("Pressure_Coefficient")
        if np.isnan(pressures[self.nodes]).any():
            raise InputError(f"{what}: SU2 gives no pressures on some of the walls; check the markers")
        found = weights @ frame.rows @ self.force(points, pressures) / area
        off, lift_off = np.abs(found - stated), abs(found[1] - stated[1])
        if (lift_off > SLACK_VISCOUS * size) if is_viscous else (off > SLACK * size).any():
            raise InputError(
                f"{what}: SU2's CD and CL are {stated}, but {found} by its pressures on the walls; check "
                f"MARKER_MONITORING, to the reference area and to axes"
            )


def _nodal_areas(corners: np.ndarray) -> np.ndarray:
    """Area vectors of the parts of faces at their corners, shape (n, n_corners, 3)."""
    middle = corners.mean(axis=1, keepdims=True)
    after = 0.5 * (corners + np.roll(corners, -1, axis=1))
    before = np.roll(after, 1, axis=1)
    return 0.5 * np.cross(middle - corners, before - after)
