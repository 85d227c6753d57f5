"""A fitted grid: the control mesh, the parameters of the nodes and everything needed to write the grid back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..checks import as_array
from ..errors import InputError
from ..evaluation.evaluator import Evaluator
from ..evaluation.family import refine
from ..evaluation.index_scaling import IndexScaling
from ..io.cgns import CgnsDialect
from ..splines.mesh import BSplineMesh
from ..topology.grid import Block, Grid, Patch
from ..topology.topology import Topology
from ..walls.grid_map import GridMap
from ..walls.riders import Riders
from .report import FitReport


@dataclass(frozen=True, eq=False)
class GridHeader:
    """What a grid is besides its nodes.

    Parameters
    ----------
    names : tuple of str
        Names of the blocks.
    patches : tuple of Patch
        Declared patches.
    source : str
        Where the grid came from.
    dialect : object or None
        How its file was written.
    iblanks : tuple of (ndarray or None)
        Blanking of every block.
    """

    names: tuple[str, ...]
    patches: tuple[Patch, ...] = ()
    source: str = "grid"
    dialect: object | None = None
    iblanks: tuple[np.ndarray | None, ...] = ()

    @classmethod
    def of(cls, grid: Grid) -> GridHeader:
        """Take the header of a grid."""
        names, iblanks = tuple(b.name for b in grid.blocks), tuple(b.iblank for b in grid.blocks)
        return cls(names, grid.patches, grid.source, grid.dialect, iblanks)

    def grid(self, shapes, nodes: np.ndarray) -> Grid:
        """Grid with these nodes, shape (n_nodes, 3), in blocks of these shapes."""
        blocks, start = [], 0
        for name, iblank, shape in zip(self.names, self.iblanks, shapes):
            stop = start + int(np.prod(shape))
            blocks.append(Block(nodes[start:stop].reshape(*shape, 3), name, iblank))
            start = stop
        return Grid(tuple(blocks), self.patches, self.source, self.dialect)


def checked_points(points, n_points: int, what: str) -> np.ndarray:
    """Points as an array of shape (n_points, 3) of finite numbers.

    Raises
    ------
    InputError
        If they are something else; ``what`` they are begins the message.
    """
    array = as_array(points, what)
    if array.shape != (n_points, 3):
        raise InputError(f"{what} of shape {array.shape}; give shape ({n_points}, 3)")
    is_bad = ~np.isfinite(array).all(axis=1)
    if is_bad.any():
        number = int(np.argmax(is_bad))
        raise InputError(f"{what}: number {number + 1} of {n_points} is {array[number]}, not finite; correct it")
    return array


@dataclass(frozen=True)
class FitSettings:
    """How a model was fitted, as far as its derivatives need to know.

    Parameters
    ----------
    knots : str
        ``"curved"``, ``"constant"``, or ``"given"`` for the user's own.
    corrections : int
        Cycles of parameter correction.
    parametrization : str
        Of the nodes, before correction: one of `bspline_mdao.fit.parameters.EXPONENTS`, or ``"given"`` for the user's.
    method : str
        One of `bspline_mdao.fit.fitting.METHODS`; what came of it are the shares of the model.
    wall_layer : bool
        Whether nodes near walls follow them as a rigid body and the residual turns with its surroundings.
    """

    knots: str = "curved"
    corrections: int = 0
    parametrization: str = "chord_length"
    method: str = "valid"
    wall_layer: bool = True


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A multi-block grid as a B-spline mesh.

    Parameters
    ----------
    topology : Topology
        Blocks, segments and how they hang together, found once and kept through every change of shape.
    mesh : BSplineMesh
        One volume per segment.
    parameters : tuple of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    control_points : ndarray, shape (n_control_points, 3)
        Fitted control points (m).
    residual : ndarray, shape (n_nodes, 3), or None
        Baseline grid minus fitted points (m), where it is carried.
    header : GridHeader
        Names, patches, source and dialect of the grid.
    report : FitReport
        How good the fit is.
    settings : FitSettings
        How it was made.
    shares : ndarray, shape (n_control_points, 6), or None
        Share in each control point of each of `bspline_mdao.model.report.CANDIDATES`, found once and kept;
        None where all are least squares.
    """

    topology: Topology
    mesh: BSplineMesh
    parameters: tuple[np.ndarray, ...]
    control_points: np.ndarray
    residual: np.ndarray | None
    header: GridHeader
    report: FitReport
    settings: FitSettings = FitSettings()
    shares: np.ndarray | None = None

    def __post_init__(self):
        self._check("control_points", self.mesh.n_control_points)
        if self.residual is not None:
            self._check("residual", self.topology.n_nodes)

    def _check(self, name: str, n_points: int) -> None:
        points = checked_points(getattr(self, name), n_points, f"{self.header.source}: {name.replace('_', ' ')}")
        object.__setattr__(self, name, points)

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks of the grid."""
        return self.topology.n_nodes

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
        places = self.topology, self.mesh, self.parameters
        return GridMap.of(*places, self.control_points, self.residual, self.settings.wall_layer, self.evaluator())

    def __getstate__(self) -> dict:
        return {name: value for name, value in self.__dict__.items() if name not in ("_evaluator", "_grid_map")}

    def regenerate(self, control_points: np.ndarray | None = None) -> Grid:
        """Grid of given control points, see `bspline_mdao.walls.grid_map`.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3), optional
            Moved control points (m); the fitted ones by default.

        Returns
        -------
        Grid
            Nodes in metres; names, patches and dialect are those of the fitted grid.

        Raises
        ------
        InputError
            If the control points are of another shape, or not finite.
        MovementError
            If the surroundings of a point are turned inside out.
        """
        if control_points is not None:
            what = f"{self.header.source}: control points"
            points = checked_points(control_points, self.mesh.n_control_points, what)
            return self.header.grid(self.topology.shapes, self.grid_map().at(points).nodes)
        nodes = self.evaluator().forward(self.control_points)
        return self.header.grid(self.topology.shapes, nodes if self.residual is None else nodes + self.residual)

    def riders(self, points: np.ndarray, tolerance: float | None = None) -> Riders:
        """Let points that were not fitted ride along, those near walls in the layer there.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            The points on the baseline (m).
        tolerance : float, optional
            Distance (m) up to which a point counts as inside the volumes; 1e-9 of their size by default.

        Returns
        -------
        Riders

        Raises
        ------
        InputError
            If the points cannot be used, or one is outside all volumes.
        """
        return Riders.of(self.grid_map(), self.mesh, self.control_points, points, tolerance)

    def member(self, factor: float) -> FittedModel:
        """Model of a finer or coarser member of the grid family, section II.E, with the same control points.

        The residual of the fit belongs to the nodes of the fitted grid and is not carried over; the layer at walls is
        that of the member's own nodes.

        Parameters
        ----------
        factor : float
            Cells per direction of the member, by those of the grid.

        Returns
        -------
        FittedModel
            Patches and blanking are scaled; the report is that of the fitted grid.

        Raises
        ------
        InputError
            If the factor is not a positive number.
        """
        member = refine(self.topology, self.mesh, self.parameters, factor)
        header = _scaled_header(self.header, IndexScaling.of(self.topology, factor))
        return replace(self, topology=member.topology, parameters=member.parameters, residual=None, header=header)

    def save(self, path, compress: bool = True) -> None:
        """Write the model to one HDF5 file, see `bspline_mdao.model.model_file.write_model`."""
        from .model_file import write_model

        write_model(self, path, compress)

    @classmethod
    def load(cls, path) -> FittedModel:
        """Read a model from a file, see `bspline_mdao.model.model_file.read_model`."""
        from .model_file import read_model

        return read_model(path)


def family_member(model: FittedModel, factor: float, control_points: np.ndarray | None = None) -> Grid:
    """Grid of a fitted model with ``factor`` times the cells per direction, see `FittedModel.member`.

    Parameters
    ----------
    model : FittedModel
        The model.
    factor : float
        Cells per direction of the member, by those of the grid.
    control_points : ndarray, shape (n_control_points, 3), optional
        Moved control points (m); the fitted ones by default.

    Returns
    -------
    Grid
        Nodes in metres; patches and blanking are scaled.

    Raises
    ------
    InputError
        If the factor is not a positive number.
    """
    return model.member(factor).regenerate(control_points)


def _scaled_header(header: GridHeader, scaling: IndexScaling) -> GridHeader:
    """Header of a family member; a CGNS file is written back as a copy only where all blocks keep their nodes."""
    patches = tuple(_scaled_patch(patch, scaling) for patch in header.patches)
    iblanks = tuple(
        None if iblank is None else np.ascontiguousarray(iblank[np.ix_(*scaling.nearest(block))])
        for block, iblank in enumerate(header.iblanks)
    )
    is_same = all(len(p) == p[-1] + 1 for planes in scaling.planes for p in planes)
    dialect = header.dialect if is_same or not isinstance(header.dialect, CgnsDialect) else None
    return replace(header, patches=patches, iblanks=iblanks, dialect=dialect)


def _scaled_patch(patch: Patch, scaling: IndexScaling) -> Patch:
    return replace(patch, windows=tuple(map(scaling.window, patch.windows)))
