"""Surfaces and fields of pictures, by the names that users type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .color_ranges import color_map_about_zero

__all__ = ["FIELD_STYLES", "MESH_STYLES", "SURFACES", "FieldStyle"]

SURFACES = {
    "walls": ("wall",),
    "symmetry": ("symmetry",),
    "farfield": ("farfield",),
    "boundary": ("wall", "symmetry", "farfield", "overset", "other"),
    "control mesh": ("control mesh",),
    "lattice": ("lattice",),
}
"""Names of surfaces, and the kinds of sheets they consist of."""


@dataclass(frozen=True)
class FieldStyle:
    """How a field is drawn: label, colours and surfaces."""

    field: str  # its name on sheets
    label: str  # on the colour bar
    colors: str  # colour map of matplotlib
    is_of_flow: bool = False  # whether it needs a problem that has been run
    surfaces: tuple[str, ...] = ("walls", "symmetry")  # what is coloured if no surface is named
    is_about_zero: bool = False  # whether zero is white; ``colors`` is unused then

    def color_map(self, limits: tuple[float, float]) -> Any:
        """Colour map of matplotlib, or its name, for a range."""
        return color_map_about_zero(limits) if self.is_about_zero else self.colors


FIELD_STYLES = {
    "quality": FieldStyle("Q", "orthogonality Q", "viridis"),
    "corner": FieldStyle("smallest_corner", "smallest corner", "viridis"),
    "wall height": FieldStyle("wall_height", "height of the first cell (m)", "viridis", surfaces=("walls",)),
    "block": FieldStyle("block", "block", "tab20"),
    "patch": FieldStyle("patch", "patch", "tab20", surfaces=("boundary",)),
    "Cp": FieldStyle("Cp", "pressure coefficient", "RdBu_r", True, is_about_zero=True),
    "Mach": FieldStyle("Mach", "Mach number", "turbo", True),
    "entropy": FieldStyle("entropy", "entropy", "magma", True),
    "delta_Cp": FieldStyle("delta_Cp", "pressure difference below - above", "viridis", True, ("lattice", "symmetry")),
    "total pressure loss": FieldStyle("total_pressure_loss", "loss of total pressure", "magma", True),
}
"""Fields that colour the surfaces."""

MESH_STYLES = {
    "quality": FieldStyle("angle", "non-orthogonality (deg)", "viridis_r"),
    "pyramid": FieldStyle("pyramid", "smallest pyramid relative to before", "viridis"),
    "wall height": FIELD_STYLES["wall height"],
    "displacement": FieldStyle("displacement", "displacement (m)", "magma_r"),
    "patch": FIELD_STYLES["patch"],
}
"""Fields of unstructured meshes."""
