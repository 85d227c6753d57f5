"""A fitted grid: the control mesh, the parameters of the nodes and everything needed to write the grid back."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...base.checks import as_finite_points
from ...base.display import Plottable
from ...errors import InputError
from ...grids.io.cgns import CgnsDialect
from ...grids.io.plane_grids import PlaneDialect
from ...grids.topology.boundary_surface import BoundarySurface
from ...grids.topology.grid import Grid, Patch
from ...grids.topology.node_numbering import NodeNumbering
from ...grids.topology.partition import Subdomain
from ...grids.topology.sharing import node_sharing
from ...grids.topology.topology import Topology
from ..evaluation.evaluator import Evaluator
from ..evaluation.family import IndexScaling, refine
from ..evaluation.transfer import NodeTransfer
from ..sliding.sliding_nodes import Slide
from ..splines.mesh import BSplineMesh
from ..walls.body_points import Body
from ..walls.embedded_points import EmbeddedPoints
from ..walls.grid_map import GridMap
from ..walls.residual_lengths import residual_lengths
from ..walls.wall_correction import WallCorrection
from .local_model import LocalModel
from .model import Model
from .model_file import arrays_of, checksum_of, document_of, read_model, write_model
from .records import FitReport, FitSettings, GridHeader
from .sliding_members import onto_surfaces


@dataclass(frozen=True, eq=False)
class FittedModel(Plottable, Model):
    """A multi-block grid as a B-spline mesh.

    Parameters
    ----------
    topology : Topology
        Blocks, segments and their connections, found once and unchanged by every change of shape.
    mesh : BSplineMesh
        One volume per segment.
    parameters : tuple of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    control_points : ndarray, shape (n_control_points, 3)
        Fitted control points (m).
    residual : ndarray, shape (n_nodes, 3), or None
        Baseline grid minus fitted points (m), if it is kept.
    header : GridHeader
        Names, patches, source and dialect of the grid.
    report : FitReport
        How good the fit is.
    settings : FitSettings
        Settings of the fit.
    candidate_weights : ndarray, shape (n_control_points, 6), or None
        Weight of each of `bspline_mdao.core.model.records.CANDIDATES` in each control point, found once and kept; None
        if all are least squares.

    Examples
    --------
    >>> import tempfile
    >>> from bspline_mdao import FittedModel, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((9, 9, 9, 9)), n_control=5)
    >>> stretched = model.regenerate(model.control_points * [1.0, 1.0, 1.1])  # the grid of other control points
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     model.save(f"{folder}/body.h5")
    ...     same = FittedModel.load(f"{folder}/body.h5")
    >>> bool((same.control_points == model.control_points).all())
    True
    """

    topology: Topology
    mesh: BSplineMesh
    parameters: tuple[np.ndarray, ...]
    control_points: np.ndarray
    residual: np.ndarray | None
    header: GridHeader
    report: FitReport
    settings: FitSettings = field(default_factory=FitSettings)
    candidate_weights: np.ndarray | None = None

    def __post_init__(self) -> None:
        self._check("control_points", self.mesh.n_control_points)
        if self.residual is not None:
            self._check("residual", self.topology.n_nodes)

    def _check(self, name: str, n_points: int) -> None:
        points = as_finite_points(getattr(self, name), n_points, f"{self.header.source}: {name.replace('_', ' ')}")
        object.__setattr__(self, name, points)

    def __repr__(self) -> str:
        n_blocks = len(self.topology.shapes)
        sizes = f"{n_blocks} block{'s' * (n_blocks != 1)}, {self.n_nodes:,} nodes"
        return f"FittedModel({sizes}, {self.mesh.n_control_points:,} control points, RMS {self.report.rms:.1e} m)"

    @property
    def ownership(self) -> None:
        """None: the model has all nodes of the grid."""

    @property
    def baseline(self) -> Grid:
        """See `regenerate`."""
        return self.regenerate()

    def part(self, subdomain: Subdomain) -> LocalModel:
        """Part of the model that one of several processes needs, see `local_model`."""
        return self.local_model(subdomain)

    @cached_property
    def residual_lengths(self) -> np.ndarray | None:
        """Length of the residual around every corner of the spans (m), shape (n_corners,); None if it does not turn."""
        # see `bspline_mdao.core.walls.residual_lengths`
        if self.residual is None or not self.settings.wall_layer:
            return None
        residuals = dict(enumerate(self.residual[part] for part in self.topology.layout.slices))
        return residual_lengths(self.topology, self.mesh, self.parameters, residuals)

    def evaluator(self) -> Evaluator:
        """Operator from the control points to the nodes of the grid, Eq. (3), made once and not pickled."""
        return self._evaluator

    @cached_property
    def _evaluator(self) -> Evaluator:
        return Evaluator.of_grid(self.topology, self.mesh, self.parameters)

    def grid_map(self) -> GridMap:
        """Map from the control points to the grid, residual and wall layer included, made once and not pickled."""
        return self._grid_map

    @cached_property
    def _grid_map(self) -> GridMap:
        places = self.topology, self.mesh, self.parameters, self.control_points
        residual = self.residual, self.residual_lengths
        return GridMap.of(*places, *residual, self.settings.wall_layer, self.evaluator())

    def parameters_of(self, numbering: NodeNumbering) -> list[np.ndarray]:
        """Parameters of the nodes that each segment evaluates, ``numbering.numbers``, each of shape (n_v, 3)."""
        return [x.reshape(-1, 3)[places] for x, places in zip(self.parameters, numbering.places)]

    def residual_at(self, rows: np.ndarray) -> np.ndarray | None:
        """Residual of nodes by their rows, shape (n, 3); None if the model has none."""
        return None if self.residual is None else self.residual[rows]

    def local_nodes(self, control_points: np.ndarray | None = None) -> np.ndarray:
        """All nodes of the grid (m), shape (n_nodes, 3), see `regenerate`."""
        return self.regenerate(control_points).to_vector().reshape(-1, 3)

    def corrected_map(self, rows: np.ndarray, whole: Model) -> tuple[GridMap, WallCorrection]:
        """Map to the grid for walls that are met exactly, and their correction; the model itself is the whole one."""
        grid_map = self.grid_map()
        return grid_map, WallCorrection.of(self.topology, grid_map.nodes, rows)

    def local_model(self, subdomain: Subdomain) -> LocalModel:
        """Part of the model that one of several processes needs.

        Parameters
        ----------
        subdomain : Subdomain
            Nodes of the process, from ``Partition.of(model.topology, n_ranks).subdomain(rank)`` or
            ``Subdomain.of_rows(...)``.

        Raises
        ------
        InputError
            If the subdomain belongs to another grid.
        """
        names = ("mesh", "control_points", "header", "report", "settings", "candidate_weights", "residual_lengths")
        others = {name: getattr(self, name) for name in names}
        flat = [x.reshape(-1, 3) for x in self.parameters]
        residual = None if self.residual is None else self.residual.__getitem__
        return LocalModel.of(
            subdomain, self.topology, lambda segment, places: flat[segment][places], residual, **others
        )

    def __getstate__(self) -> dict:
        return {name: value for name, value in self.__dict__.items() if name not in ("_evaluator", "_grid_map")}

    def regenerate(self, control_points: np.ndarray | None = None, slides: Sequence[Slide] = ()) -> Grid:
        """Grid from control points, see `bspline_mdao.core.walls.grid_map`.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3), optional
            Moved control points (m); the fitted ones by default.
        slides : sequence of Slide
            Patches that slide on non-planar surfaces, ``mesh.slides`` of the mesh that moved: their nodes stay on these
            surfaces.

        Returns
        -------
        Grid
            Nodes in metres; names, patches and dialect as in the fitted grid.

        Raises
        ------
        InputError
            If the control points have the wrong shape or are not finite.
        MovementError
            If the neighbourhood of a point is turned inside out.
        """
        if control_points is not None:
            what = f"{self.header.source}: control points"
            points = as_finite_points(control_points, self.mesh.n_control_points, what)
            return self.header.grid(self.topology.shapes, self.map_sliding(slides, self).at(points).nodes)
        nodes = self.evaluator().forward(self.control_points)
        return self.header.grid(self.topology.shapes, nodes if self.residual is None else nodes + self.residual)

    def wall_spacing(self) -> float:
        """Median height of the cells at the walls of the grid (m); `InputError` if there is no wall."""
        blocks, heights = self.regenerate().blocks, []
        for window in (face.window for face in self.topology.boundary if face.kind == "wall"):
            flat, part = window.shape.index(1), list(window.slices)
            part[flat] = slice(0, 2) if window.lo[flat] == 0 else slice(-2, None)
            edges = np.diff(blocks[window.block].nodes[tuple(part)], axis=flat)
            heights.append(np.linalg.norm(edges, axis=-1).ravel())
        if not heights:
            raise InputError(
                f"{self.header.source}: no patch is a wall, so it has no cell height; give the height in m"
            )
        return float(np.median(np.concatenate(heights)))

    def embed_points(self, points: np.ndarray, tolerance: float | None = None) -> EmbeddedPoints:
        """Embed points that were not fitted: volumes move them, the layer near walls, and inside a body its walls.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            The points on the baseline (m).
        tolerance : float, optional
            Distance (m) up to which a point counts as inside the volumes; 1e-9 of their size by default.

        Returns
        -------
        EmbeddedPoints

        Raises
        ------
        InputError
            If the points cannot be used, or one is outside all volumes and not inside the walls.
        """
        grid_map, walls = self.grid_map(), [face for face in self.topology.boundary if face.kind == "wall"]
        surface = BoundarySurface.of(self.topology, grid_map.nodes, walls) if walls else None
        body = None if surface is None else (Body(grid_map.nodes[surface.rows], surface.quads), surface.rows)
        return EmbeddedPoints.of(grid_map, self.mesh, self.control_points, points, tolerance, body)

    def member(self, factor: float, slides: Sequence[Slide] = ()) -> FittedModel:
        """Model of a finer or coarser member of the grid family, section II.E, with the same control points.

        The residual of the fit, the part of the grid that the splines miss, is interpolated in the index if it is kept,
        so a member of twice the cells contains the nodes of the grid. The layer at walls is made for the member's own
        nodes.

        Parameters
        ----------
        factor : float
            Cells per direction of the member divided by cells per direction of the grid.
        slides : sequence of Slide
            Patches that slide on non-planar surfaces, ``mesh.slides`` of a mesh of this model. If the model keeps its
            residual, nodes of the member are on these surfaces as well as the grid's nodes are. The member takes the
            same slides as this model.

        Returns
        -------
        FittedModel
            Patches and blanking are scaled; the report is the fitted grid's.

        Raises
        ------
        InputError
            If the factor is not a positive number.
        """
        member = refine(self.topology, self.mesh, self.parameters, factor)
        residual = self.residual
        if residual is not None:
            prolonged = NodeTransfer.of(self.topology, member.topology).prolong(residual)
            residual = prolonged[node_sharing(member.topology).source_rows()]  # blocks round shared nodes alike
        header = _scaled_header(self.header, IndexScaling.of(self.topology, factor))
        parameters = member.parameters
        finer = replace(self, topology=member.topology, parameters=parameters, residual=residual, header=header)
        if residual is None or not slides:
            return finer
        on_surfaces = onto_surfaces(self.topology, self.local_nodes(), member.topology, finer.local_nodes(), slides)
        return replace(finer, residual=residual + on_surfaces)

    def save(self, path: str | os.PathLike, compress: bool = True) -> None:
        """Write the model to one HDF5 file, see `bspline_mdao.core.model.model_file.write_model`."""
        write_model(self._fields(), path, compress)
        self._note_file(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> FittedModel:
        """Read a model from a file, see `bspline_mdao.core.model.model_file.read_model`."""
        model = read_model(path, cls._with_lengths)
        model._note_file(path)
        return model

    @classmethod
    def _with_lengths(cls, residual_lengths: np.ndarray | None, **fields_of_model: Any) -> FittedModel:
        """Model with known `residual_lengths`, which saves a tenth of the time to make its map."""
        model = cls(**fields_of_model)
        if residual_lengths is not None:
            model.__dict__["residual_lengths"] = residual_lengths
        return model

    def _fields(self) -> dict[str, Any]:
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**values, "residual_lengths": self.residual_lengths}

    def _note_file(self, path: str | os.PathLike) -> None:
        object.__setattr__(self, "_file", Path(path).absolute())

    @property
    def file(self) -> Path | None:
        """File that the model was last saved to or loaded from; None if neither."""
        return self.__dict__.get("_file")

    @cached_property
    def checksum(self) -> str:
        """Checksum of the whole model, an attribute of its file: case files identify their model by it."""
        values = self._fields()
        return checksum_of(document_of(**values), arrays_of(**values))


def family_member(
    model: FittedModel, factor: float, control_points: np.ndarray | None = None, slides: Sequence[Slide] = ()
) -> Grid:
    """Grid with ``factor`` times the cells per direction of a fitted model, see `FittedModel.member`.

    Parameters
    ----------
    model : FittedModel
        The model.
    factor : float
        Cells per direction of the member divided by cells per direction of the grid.
    control_points : ndarray, shape (n_control_points, 3), optional
        Moved control points (m); the fitted ones by default.
    slides : sequence of Slide
        Patches that slide on non-planar surfaces, ``mesh.slides`` of the mesh that moved: nodes of the member stay on
        these surfaces.

    Returns
    -------
    Grid
        Nodes in metres; patches and blanking are scaled.

    Raises
    ------
    InputError
        If the factor is not a positive number.

    Examples
    --------
    >>> from bspline_mdao import family_member, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> family_member(model, 2.0).shapes[0]  # twice the cells in each direction
    (9, 9, 9)
    """
    return model.member(factor, slides).regenerate(control_points, slides)


def _scaled_header(header: GridHeader, scaling: IndexScaling) -> GridHeader:
    """Header of a family member; a CGNS file is written back as a copy only if all blocks keep their nodes."""
    patches = tuple(_scaled_patch(patch, scaling) for patch in header.patches)
    iblanks = tuple(
        None if iblank is None else np.ascontiguousarray(iblank[np.ix_(*scaling.nearest(block))])
        for block, iblank in enumerate(header.iblanks)
    )
    is_same = all(len(p) == p[-1] + 1 for planes in scaling.planes for p in planes)
    return replace(
        header, patches=patches, iblanks=iblanks, dialect=header.dialect if is_same else _copied(header.dialect)
    )


def _copied(dialect: object | None) -> object | None:
    """Dialect of a grid with other nodes."""
    if isinstance(dialect, PlaneDialect):
        return replace(dialect, dialect=_copied(dialect.dialect))
    return None if isinstance(dialect, CgnsDialect) else dialect


def _scaled_patch(patch: Patch, scaling: IndexScaling) -> Patch:
    return replace(patch, windows=tuple(map(scaling.window, patch.windows)))
