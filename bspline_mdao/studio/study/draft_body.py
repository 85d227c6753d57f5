"""Properties of walls for the draft of a study: by the kind of their grid, and from their shape."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from importlib.util import find_spec

import numpy as np

from ...base.checks import axes_text
from ...core.background.mesh_model import MeshModel
from ...core.measures.area import ProjectedArea
from ...core.measures.blunt_end import why_backwards
from ...core.measures.section_thickness import SectionThickness
from ...core.measures.volume import EnclosedVolume
from ...core.mesh.boundary import wall_patches
from ...core.mesh.frame import Frame, surface_frame
from ...core.mesh.surface import SurfaceGrid
from ...errors import InputError
from ...flow.om.lattice_flow import lattice_camber, lattice_lift
from ...flow.om.mach_range import EULER
from ...grids.cells.grid_quality import GridQuality
from ...grids.cells.mixed_quality import MixedQuality
from ...grids.topology.grid import Grid
from ...grids.topology.topology import Topology

__all__ = ["ALPHA", "MACH", "SECTION_LIFT", "Body", "GridBody", "MeshBody"]

ALPHA, MACH = 3.0, 0.3
"""Angle of attack (deg) and Mach number of a draft."""

SECTION_LIFT, KORN, BEYOND = 0.5, 0.87, 0.05
"""Lift coefficient of the draft of a section, and distance of its Mach number beyond the drag rise by Korn's relation
for NACA sections, 0.87 less thickness over chord and a tenth of the lift, so there is a shock to reduce
(W. H. Mason, AIAA Paper 90-3262, 1990)."""

THIN = 0.5
"""Largest height of a wing relative to its chord and span; higher bodies are no wings."""

_ALIGNED = 0.99
"""Cosine of the angle to a coordinate axis within which a direction counts as that axis."""

_IN_PLANE = 1e-6
"""Distance from the plane of symmetry, in sizes of the walls, within which a wing starts there."""


class Body(ABC):
    """Walls of a grid, of any kind."""

    walls: tuple[str, ...]  # names of all walls
    design: tuple[str, ...]  # names of the walls to design
    moves_points: bool  # whether control points of the surface are few, and good variables as they are
    aggregate: str  # bound of the cells

    @property
    @abstractmethod
    def surface(self) -> SurfaceGrid:
        """The walls to design."""

    @property
    @abstractmethod
    def measured(self) -> SurfaceGrid:
        """The walls whose volume is measured."""

    @property
    @abstractmethod
    def is_section(self) -> bool:
        """Whether it is a section: between two planes of symmetry, the same in both."""

    @property
    @abstractmethod
    def worst(self) -> float:
        """Bound of the cells of the grid as it is."""

    @property
    @abstractmethod
    def why_no_euler(self) -> str:
        """Why the Euler equations are not suitable; empty if they are."""

    @cached_property
    def frame(self) -> Frame:
        """Directions of the walls."""
        return surface_frame(self.surface.points, self.surface.planes)

    @cached_property
    def axes(self) -> str | None:
        """Axes downstream, along the span, up; None if these are no coordinate axes."""
        stream, normal, span = self.frame.axes
        directions = np.array([stream, span, normal])
        if np.abs(directions).max(axis=1).min() < _ALIGNED:
            return None
        return axes_text(directions)

    @cached_property
    def why_backwards(self) -> str:
        """Why the grid seems to lie the other way round; empty if it does not."""
        return why_backwards(self.surface.points, self.surface.quads, self.frame)

    @cached_property
    def plane_off(self) -> float:
        """Where along the span the only plane of symmetry is; 0 if flows accept it, or there is none or several."""
        planes = [plane for plane in self.surface.planes if abs(plane.normal @ self.frame.axes[2]) > _ALIGNED]
        if self.is_section or len(planes) != 1 or abs(planes[0].offset) <= _IN_PLANE * self.surface.size:
            return 0.0
        return float(planes[0].offset * planes[0].normal[np.abs(planes[0].normal).argmax()])

    @cached_property
    def why_no_lattice(self) -> str:
        """Why a vortex lattice is not suitable; empty if it is."""
        if self.is_section:
            return "a section has no span"
        if self.axes is None:
            return "stream and span are not along coordinate axes"
        planes = [plane for plane in self.surface.planes if abs(plane.normal @ self.frame.axes[2]) > _ALIGNED]
        near = _IN_PLANE * self.surface.size
        if len(planes) != 1 or abs(planes[0].offset) > near:
            return "the walls do not end on one plane of symmetry through the origin"
        if np.abs(self.surface.points @ planes[0].normal).min() > near:
            return "the wing does not begin in the plane of symmetry"
        try:
            lattice_camber(self.surface, self.axes)
        except InputError as error:
            return str(error)
        return ""

    @property
    def is_thin(self) -> bool:
        """Whether the walls are thin like a wing."""
        return is_thin(self.surface)

    @property
    def is_wing(self) -> bool:
        """Whether the walls are thin like a wing, and some flow is available about them."""
        return self.is_thin and not self.is_section and not (self.why_no_lattice and self.why_no_euler)

    @property
    def drag_rise(self) -> float:
        """Mach number just beyond the drag rise of a section, at `SECTION_LIFT`."""
        height = float(np.ptp(self.surface.points @ self.frame.axes[1])) / self.frame.chord
        return float(np.clip(round(KORN - height - 0.1 * SECTION_LIFT + BEYOND, 2), MACH, EULER.highest))

    @cached_property
    def area(self) -> float:
        """Planform area (m^2)."""
        return float(ProjectedArea.of(self.surface).evaluate(self.surface.points)[0])

    @cached_property
    def thickness(self) -> float:
        """Smooth bound of the largest thickness of a section over its chord."""
        return float(SectionThickness.at(self.surface).evaluate(self.surface.points)[0])

    @cached_property
    def elliptical_lift(self) -> float:
        """Lift coefficient at `ALPHA` of an elliptical load, to two digits."""
        aspect = 2.0 * self.frame.span**2 / self.area
        return float(f"{2.0 * np.pi * np.radians(ALPHA) / (1.0 + 2.0 / aspect):.2g}")

    @property
    def lacks_lattice(self) -> bool:
        """Whether its flow is the vortex lattice, and OpenAeroStruct is not installed."""
        return self.is_wing and not self.why_no_lattice and self.lattice_lift is None

    @cached_property
    def lattice_lift(self) -> float | None:
        """Lift coefficient at `ALPHA` by the vortex lattice; None without OpenAeroStruct."""
        if self.axes is None or not find_spec("openaerostruct"):
            return None
        return float(f"{lattice_lift(lattice_camber(self.surface, self.axes), self.area, ALPHA, MACH):.6g}")

    @cached_property
    def why_no_volume(self) -> str:
        """Why the walls enclose no volume; empty if they do."""
        try:
            EnclosedVolume.of(self.measured, relative=True)
        except InputError as error:
            return str(error)
        return ""


class GridBody(Body):
    """Walls of a grid of blocks."""

    moves_points, aggregate = True, "corner_ks"

    def __init__(self, grid: Grid, topology: Topology):
        self.grid, self.topology = grid, topology
        self.walls = self.design = wall_patches(topology)

    @cached_property
    def nodes(self) -> np.ndarray:
        """Nodes of the grid (m), shape (n, 3)."""
        return self.grid.to_vector().reshape(-1, 3)

    @cached_property
    def surface(self) -> SurfaceGrid:
        """The walls."""
        return SurfaceGrid.of_nodes(self.topology, self.nodes)

    @property
    def measured(self) -> SurfaceGrid:
        """The walls."""
        return self.surface

    @property
    def is_section(self) -> bool:
        """Whether the walls are an airfoil."""
        return self.surface.is_section

    @cached_property
    def worst(self) -> float:
        """Bound of the corners of the grid as it is."""
        quality = GridQuality.of_baseline(self.grid)
        return float(quality.evaluate(self.nodes, (self.aggregate,)).aggregates[self.aggregate])

    @cached_property
    def why_no_euler(self) -> str:
        """Why not, if the Euler equations do not know a kind of boundary face, or a wing's directions are unclear."""
        kinds = {face.kind for face in self.topology.boundary}
        if self.axes is None:
            return "stream and span are not along coordinate axes"
        if not kinds <= {"wall", "symmetry", "farfield"} or "farfield" not in kinds:
            return "other boundaries are not symmetry and farfield alone"
        return ""


class MeshBody(Body):
    """Walls of an unstructured mesh: all of them, or the walls of the wing."""

    moves_points, aggregate = False, "volume_ks"
    why_no_euler = "Euler flow needs a grid of blocks"

    def __init__(self, model: MeshModel):
        self.model = model
        self.walls = model.walls.names
        self.design = self.walls if self.is_section else self._wing()

    @property
    def is_section(self) -> bool:
        """Whether its mesh is one layer of cells."""
        return any(line.is_tied for line in self.model.lattice.lines)

    def _wing(self) -> tuple[str, ...]:
        """The largest thin wall, and its neighbours: thin ones, and small ones such as its tip; otherwise all walls."""
        # Hubs and casings of sectors, which end on both periodic sides, stay if there is another wall.
        surfaces = {name: SurfaceGrid.of(self.model, name) for name in self.walls}
        inner = {name: surface for name, surface in surfaces.items() if not self._is_between_sides(surface)}
        surfaces = inner or surfaces
        thin = {name: surface for name, surface in surfaces.items() if is_thin(surface)}
        if not thin:
            return tuple(surfaces)
        wing = [max(thin, key=lambda name: thin[name].size)]
        for name in wing:  # it grows
            wing += [other for other in surfaces if other not in wing and self._is_neighbour(surfaces, name, other)]
        return tuple(name for name in self.walls if name in wing)

    def _is_between_sides(self, surface: SurfaceGrid) -> bool:
        """Whether a wall ends on both sides of a periodic pair."""
        return any(np.isin(sides.pairs, surface.rows).any(axis=0).all() for sides in self.model.periodic)

    @staticmethod
    def _is_neighbour(surfaces: Mapping[str, SurfaceGrid], name: str, other: str) -> bool:
        """Whether another wall adjoins a wall of the wing, and is thin too, or no higher than that."""
        wing, wall = surfaces[name], surfaces[other]
        up = surface_frame(wing.points, wing.planes).axes[1]
        is_low = np.ptp(wall.points @ up) <= np.ptp(wing.points @ up)
        return bool((is_thin(wall) or is_low) and np.isin(wall.rows, wing.rows).any())

    @cached_property
    def surface(self) -> SurfaceGrid:
        """The walls to design."""
        return SurfaceGrid.of(self.model, self.design)

    @cached_property
    def measured(self) -> SurfaceGrid:
        """All walls: a wing alone is open at its junctions."""
        return SurfaceGrid.of(self.model)

    @cached_property
    def worst(self) -> float:
        """Bound of the cells of the mesh as it is."""
        quality = MixedQuality.of(self.model.mesh, self.model.walls.faces)
        return float(quality.evaluate(self.model.mesh.points, (self.aggregate,)).aggregates[self.aggregate])


def is_thin(surface: SurfaceGrid) -> bool:
    """Whether a surface is thin like a wing."""
    frame = surface_frame(surface.points, surface.planes)
    return bool(np.ptp(surface.points @ frame.axes[1]) < THIN * min(frame.chord, frame.span))
