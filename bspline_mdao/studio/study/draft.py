"""The draft of a study of a grid: what can be guessed of it, with the reasons in comments."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec

import numpy as np

from ...core.measures.area import ProjectedArea
from ...core.measures.volume import EnclosedVolume
from ...core.mesh.boundary import wall_patches
from ...core.mesh.frame import Frame, surface_frame
from ...core.mesh.surface import SurfaceGrid
from ...errors import InputError
from ...flow.om.lattice_flow import lattice_camber, lattice_lift
from ...flow.om.mach_range import EULER, LATTICE
from ...grids.cells.grid_quality import GridQuality
from ...grids.topology.grid import Grid
from ...grids.topology.topology import Topology

__all__ = ["study_draft"]

ALPHA, MACH = 3.0, 0.3
"""Angle of attack (deg) and Mach number of a draft."""

CORNER = 0.05
"""What the worst corner keeps where the grid has as much."""

THIN = 0.5
"""Height of a wing by its chord and span at most; what is higher is another body."""

_ALIGNED = 0.99
"""Cosine of the angle to a coordinate axis up to which a direction counts as that axis."""


def study_draft(
    name: str,  # name of the grid, or of the model, as the study is to have it
    patches: str | None,  # patches file as the study is to have it
    grid: Grid,  # the grid
    topology: Topology,  # its topology
) -> str:  # TOML
    """Write the draft of a study."""
    body = _Body(grid, topology)
    lines = [
        f"# A study of {name}: run it by 'bspline-mdao optimize THIS_FILE -o out'.",
        "# Everything below is a guess or a default: go through it, above all where it says so.",
        "",
        "[grid]",
        f"file = {json.dumps(name)}",
        *([f"patches = {json.dumps(patches)}"] if patches else []),
        f"# design = {json.dumps(list(wall_patches(topology)))}  # the walls; name some of them to design these alone",
        "",
        *(_wing(body) if body.is_wing else _shape(body)),
        *_cells(body),
        "[driver]",
        'optimizer = "LD_SLSQP"  # of NLopt; SLSQP is that of SciPy',
        "tolerance = 1e-6",
        "max_iterations = 50",
    ]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False)
class _Body:
    """What a draft has to know of the walls of a grid."""

    grid: Grid
    topology: Topology

    @cached_property
    def nodes(self) -> np.ndarray:
        return self.grid.to_vector().reshape(-1, 3)

    @cached_property
    def surface(self) -> SurfaceGrid:
        return SurfaceGrid.of_nodes(self.topology, self.nodes)

    @cached_property
    def frame(self) -> Frame:
        return surface_frame(self.surface.points, self.surface.planes)

    @cached_property
    def axes(self) -> str | None:
        """Axes downstream, along the span, up; None where these are no coordinate axes."""
        stream, normal, span = self.frame.axes
        directions = np.array([stream, span, normal])
        if np.abs(directions).max(axis=1).min() < _ALIGNED:
            return None
        return "".join("xyz"[axis] for axis in np.abs(directions).argmax(axis=1))

    @cached_property
    def why_no_wing(self) -> str:
        """Why a vortex lattice does not suit; empty where it does."""
        if self.axes is None:
            return "stream and span are not along coordinate axes"
        planes = [plane for plane in self.surface.planes if abs(plane.normal @ self.frame.axes[2]) > _ALIGNED]
        if len(planes) != 1 or abs(planes[0].offset) > 1e-6 * self.surface.size:
            return "the walls do not end on one plane of symmetry through the origin"
        try:
            lattice_camber(self.surface, self.axes)
        except InputError as error:
            return str(error)
        return ""

    @property
    def is_wing(self) -> bool:
        """Whether the walls are thin like a wing, and some flow can be had about them."""
        height = np.ptp(self.surface.points @ self.frame.axes[1])
        is_thin = height < THIN * min(self.frame.chord, self.frame.span)
        return bool(is_thin) and (not self.why_no_wing or self.is_closed)

    @cached_property
    def is_closed(self) -> bool:
        """Whether every boundary face is of a kind that the Euler equations know, and a wing's directions are clear."""
        kinds = {face.kind for face in self.topology.boundary}
        return self.axes is not None and kinds <= {"wall", "symmetry", "farfield"} and "farfield" in kinds

    @cached_property
    def area(self) -> float:
        return float(ProjectedArea.of(self.surface).evaluate(self.surface.points)[0])

    @cached_property
    def elliptical_lift(self) -> float:
        """Lift coefficient at `ALPHA` of an elliptical load, to two digits."""
        aspect = 2.0 * self.frame.span**2 / self.area
        return float(f"{2.0 * np.pi * np.radians(ALPHA) / (1.0 + 2.0 / aspect):.2g}")

    @cached_property
    def lattice_lift(self) -> float | None:
        """Lift coefficient at `ALPHA` by the vortex lattice; None where OpenAeroStruct is not there."""
        if self.axes is None or not find_spec("openaerostruct"):
            return None
        return float(f"{lattice_lift(lattice_camber(self.surface, self.axes), self.area, ALPHA, MACH):.6g}")

    @cached_property
    def corner(self) -> float:
        """Bound of the corners of the grid as it is."""
        quality = GridQuality.of_baseline(self.grid)
        return float(quality.evaluate(self.nodes, ("corner_ks",)).aggregates["corner_ks"])

    @cached_property
    def why_no_volume(self) -> str:
        """Why the walls enclose no volume; empty where they do."""
        try:
            EnclosedVolume.of(self.surface, relative=True)
        except InputError as error:
            return str(error)
        return ""


def _wing(body: _Body) -> Iterator[str]:
    """Variables, flow, objective and lift of a wing."""
    yield "[variables.twist]  # degrees at stations from root to tip, nose up"
    yield "stations = 3  # few: with more the twist waves, for gains that are not there in another flow model"
    yield "values = [2, 3]  # the root stays: turning all of the wing is what the angle of attack does"
    yield "lower = -6.0"
    yield "upper = 6.0"
    yield ""
    if not body.why_no_wing:
        yield "[variables.alpha]  # angle of attack, degrees: it keeps the lift"
        yield f"lower = {ALPHA - 6.0}"
        yield f"upper = {ALPHA + 6.0}"
        yield ""
    yield "# [variables.chord]  # factors; sweep, dihedral, span, taper, camber, thickness, control_points and lattice"
    yield "# stations = 3       # are there as well"
    yield "# lower = 0.7"
    yield "# upper = 1.3"
    yield ""
    yield "[flow]"
    if body.why_no_wing:
        yield f'kind = "euler"  # guessed: no vortex lattice, for {_line(body.why_no_wing)}'
        yield "trim = true  # the angle of attack is solved for, so that all designs have one lift"
        yield f"CL_target = {body.elliptical_lift}  # set yours: this is about the lift at {ALPHA:g} degrees"
    else:
        yield 'kind = "lattice"  # guessed: one half of a wing; "euler" for the Euler equations on the grid, with'
        yield "# trim = true and CL_target in the place of alpha, [variables.alpha] and [constraints.CL]"
        yield f"alpha = {ALPHA}  # angle of attack of the baseline, degrees: set yours, and its lift below"
    known = EULER if body.why_no_wing else LATTICE
    yield f"Mach_number = {MACH}  # set yours; {known.lowest:g} to {known.highest:g} were compared with others"
    yield f'axes = "{body.axes}"  # downstream, along the span, up: guessed from the box of the walls'
    yield f"# reference_area = {body.area:.6g}  # planform area of the walls in units of the grid, taken by default"
    yield ""
    yield "# [conditions.cruise]  # one such table for each of several flight conditions; the objective is their mean"
    yield f"# Mach_number = {MACH}"
    yield "# weight = 2.0"
    yield ""
    yield "[objective]"
    yield 'of = "CD_induced"  # CD of the pressures holds the errors of the grid as well'
    yield ""
    if not body.why_no_wing:
        yield "[constraints.CL]"
        if body.lattice_lift is None:
            yield f"equals = {body.elliptical_lift}  # set yours: about the lift of the baseline"
        else:
            yield f"equals = {body.lattice_lift}  # the lift of the baseline, so that both are comparable"
        yield ""
    if not body.why_no_volume:
        yield "# [constraints.volume]  # by that of the baseline"
        yield "# lower = 1.0"
        yield ""


def _shape(body: _Body) -> Iterator[str]:
    """Variables, objective and volume of a body that is no wing."""
    yield "# No [flow] was drafted: the walls are no wing, or other boundaries are not symmetry and farfield alone."
    yield "# The wetted area is the objective."
    yield "[variables.shape]"
    yield 'kind = "control_points"'
    yield 'direction = "normal"'
    size = float(f"{0.01 * body.surface.size:.1g}")
    yield f"lower = {-size}  # a hundredth of the size of the walls"
    yield f"upper = {size}"
    yield ""
    yield "[objective]"
    yield 'of = "surface_area"'
    yield ""
    if body.why_no_volume:
        yield f"# no constraint on the volume: {_line(body.why_no_volume)}"
        yield "[constraints.planform_area]  # by that of the baseline"
    else:
        yield "[constraints.volume]  # by that of the baseline"
    yield "lower = 1.0"
    yield ""


def _cells(body: _Body) -> Iterator[str]:
    """Constraint of the cells, which the baseline satisfies."""
    if body.corner <= 0.0:
        yield f"# no constraint on the cells: corner_ks of the grid as it is is {body.corner:.2g}, folded or nearly so"
    else:
        lower = CORNER if body.corner > 2.0 * CORNER else float(f"{0.5 * body.corner:.1g}")
        yield f"[constraints.corner_ks]  # no cell may fold: {body.corner:.2g} on the grid as it is"
        yield f"lower = {lower}"
    yield ""


def _line(text: str) -> str:
    """Text of a message as part of a comment."""
    return " ".join(text.split()).removeprefix("camber surface: ")
