"""Control mesh deformation driven by the moved surface, as an OpenMDAO component."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...base.numerics.processes import on_first
from ...errors import InputError, MovementError
from ...names import (
    CONTROL_CORNER_KS,
    CONTROL_POINTS,
    CONTROL_POINTS_INITIAL,
    SURFACE_CONTROL_POINTS,
)
from ..mesh.moving_mesh import ElementCorners, MovingMesh
from ..model.certify import require_valid_splines
from ..model.movable import Movable
from ..movement.moved_together import goes_together, moved_together
from ..movement.mover import Movement, MovementReport, Mover, differentiable
from ..movement.shared import AUTO, WAYS, shared_mover
from .checked_along_edges import check_along_edges
from .component import (
    SAME,
    CheckedOnProcesses,
    add_product,
    as_analysis_errors,
    by_parts,
    direction_in,
    fails_together,
    failures_as_analysis_errors,
    finite_points,
    refuse_complex_step,
)

INPUTS = (CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS)
OUTPUTS = (CONTROL_POINTS, CONTROL_CORNER_KS)

Request = tuple[np.ndarray, ...]
"""Initial points and surface points after a move, (n_points, 3) and (n_surface, 3) (m)."""

_LOGGER = logging.getLogger(__name__)


class ControlMeshMove(CheckedOnProcesses, om.ExplicitComponent):
    """Move the control mesh with its surface, section III, with the exact derivative through all increments.

    The mover is an object of `bspline_mdao.core.movement`, or your own, see `bspline_mdao.core.movement.mover.Mover`.
    Surface control points move exactly to their given positions, points on symmetry planes slide in them, and fixed
    points stay.

    A control mesh may tangle while all grid cells stay valid, especially next to viscous walls. That is not an error: a
    warning is logged, and the constraint ``control_corner_ks > 0`` prevents tangling. `Quality` checks the grid cells.

    ==========================  ======  ====================  =====  ===============================================
    name                        role    shape                 units  meaning
    ==========================  ======  ====================  =====  ===============================================
    ``control_points_initial``  input   (3 n_control_points)  m      control points before the move, xyz interleaved
    ``surface_control_points``  input   (3 n_surface)         m      those on the design surface after the move, in
                                                                     the order of the mesh's ``surface_ids``
    ``control_points``          output  (3 n_control_points)  m      control points after the move
    ``control_corner_ks``       output  (1,)                         lower bound of the corner triple products of unit
                                                                     edges, over the elements of the control mesh that
                                                                     are valid on the baseline, see `Quality`
    ==========================  ======  ====================  =====  ===============================================

    Options
    -------
    mover : Mover
        Its mesh defines what moves and how; `bspline_mdao.movers.moving_mesh` makes the mesh from a fitted model.
        Factors are kept for derivatives unless the mover has ``keep_factors`` or the problem is set up with
        ``derivatives=False``.
    rho : float
        Sharpness of ``control_corner_ks``, which is below the smallest corner triple product of n elements by at most
        ln(8 n) / rho.
    certified : FittedModel, LocalModel or MeshModel, optional
        The mesh's model, to refuse moves that make more of its spline elements provably invalid, also between control
        points, see `bspline_mdao.certify`.
    processes : {"auto", "first", "all"}
        Which of several processes move the mesh; all get the same control points. "first": the first process solves for
        all and is the only one with a factor. "all": all processes share the rows of the system (elasticity and
        springs). "auto": the first process if the factors fit in half of its available memory, otherwise all, see
        `bspline_mdao.core.movement.shared`. `report` says which was used.

    Raises
    ------
    InputError
        In ``setup``, if the mover is invalid or rho is not positive; in a run, under complex step.
    om.AnalysisError
        In a run or a product, if a number is not finite, if the mover fails, or, with ``certified``, if the splines
        fold. A later run with valid inputs gives the same control mesh as if nothing had happened.

    Notes
    -----
    The control mesh is a function of the inputs only, whatever was evaluated before. The number of increments is a
    setting of the mover; changing it changes the function. `increments_for` finds a suitable number before a run.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import ControlMeshMove, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, moving_mesh
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> mover = LinearElasticity(moving_mesh(model))
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", ControlMeshMove(mover=mover), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> problem.get_val("control_points").size // 3, problem.get_val("control_corner_ks").shape
    (78, (1,))
    """

    way_of_check = SAME
    is_linear = False
    """False: the outputs also depend on the inputs through the stiffness."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            mover: Mover,
            rho: float = 100.0,
            certified: Movable | None = None,
            processes: Literal["auto", "first", "all"] = "auto",
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("mover", recordable=False, desc="moves the control mesh behind its surface")
        self.options.declare("rho", default=100.0, desc="sharpness of the bound of the control mesh's corners")
        types, desc = (Movable, type(None)), "the model, if its splines are to be certified"
        self.options.declare("certified", types=types, default=None, recordable=False, desc=desc)
        self.options.declare("processes", values=WAYS, default=AUTO, desc="which of several processes move")
        self._last: _Move | None = None
        self._start: Any = None
        self._shared: Any = None
        self._is_tangled = False
        self._noted: list[Request] | None = None
        self._ahead: list[tuple[Request, Movement | MovementError]] = []

    @property
    def report(self) -> MovementReport | None:
        """Report of the last move, increment by increment; None if there was none or it stopped half way."""
        return None if self._last is None else self._last.movement.report

    @fails_together
    def setup(self) -> None:
        """Declare the variables, of the sizes of the mover's mesh."""
        mesh = mesh_of(self.options["mover"], self.msginfo)
        self._mover = differentiable(self.options["mover"]) if self._use_derivatives else self.options["mover"]
        self._last = self._start = self._shared = None
        self._is_tangled, self._ahead = False, []
        try:
            self._corners = ElementCorners.of(mesh, self.options["rho"])
        except InputError as error:
            raise InputError(f"{self.msginfo}: {error}") from error
        self.add_input(CONTROL_POINTS_INITIAL, val=mesh.points.ravel(), units="m")
        self.add_input(SURFACE_CONTROL_POINTS, val=mesh.points[mesh.surface_ids].ravel(), units="m")
        self.add_output(CONTROL_POINTS, val=mesh.points.ravel(), units="m")
        self.add_output(CONTROL_CORNER_KS, desc="bound of the corner triple products of the control mesh")
        check_along_edges(self, CONTROL_POINTS_INITIAL, mesh.point_lines, self.options["rho"])
        # elements at walls are flat, and the movers' systems lose two digits
        lines, sharpness = mesh.surface_lines, 10.0 * self.options["rho"]
        check_along_edges(self, SURFACE_CONTROL_POINTS, lines, sharpness, digits=100.0)

    @property
    def moves_together(self) -> bool:
        """Whether moves known in advance take less time when made together."""
        return self.comm.size == 1 and goes_together(self._mover)

    @contextmanager
    def noting(self) -> Iterator[list[Request]]:
        """Note the moves that runs inside request, as initial points and surface, each (n, 3), and end the runs there.

        Raises
        ------
        om.AnalysisError
            In ``compute``, once a move is noted.
        """
        self._noted = []
        try:
            yield self._noted
        finally:
            self._noted = None

    def move_ahead(self, requests: Sequence[Request]) -> None:
        """Make several moves together before runs request them.

        Each move serves one run; unused moves are discarded in the next call.

        Parameters
        ----------
        requests : sequence of (ndarray, ndarray)
            From `noting`. Moves with initial points other than the first's are made by their own runs.
        """
        self._ahead = []
        alike = [request for request in requests if np.array_equal(request[0], requests[0][0])]
        if len(alike) > 1:
            initial, surfaces = alike[0][0], [surface for _, surface in alike]
            movements = moved_together(self._mover, initial, surfaces, **self._options_at(initial))
            self._ahead = list(zip(alike, movements))

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Move the control mesh, unless it was already moved for these inputs."""
        if self._noted is not None:
            self._noted.append(tuple(inputs[name].reshape(-1, 3).copy() for name in INPUTS))
            raise om.AnalysisError(f"{self.msginfo}: the move is noted")
        last = self._move_at(inputs)
        outputs[CONTROL_POINTS] = last.movement.points.ravel()
        outputs[CONTROL_CORNER_KS] = last.corners.value(last.movement.points)

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose at the inputs."""
        if not any(name in d_outputs for name in OUTPUTS) or not any(name in d_inputs for name in INPUTS):
            return
        last = self._move_at(inputs)
        with as_analysis_errors(self):
            if mode == "fwd":
                directions = (direction_in(d_inputs, inputs, name) for name in INPUTS)
                last.add_change(d_outputs, by_parts(last.movement.jvp, *directions))
            else:
                bar = {CONTROL_POINTS: last.points_bar(d_outputs)}
                jvp, vjp = last.movement.jvp, last.movement.vjp
                add_product(inputs, d_inputs, bar, mode, jvp=jvp, vjp=vjp, of=CONTROL_POINTS, wrt=INPUTS)

    def _move_at(self, inputs: Vector) -> _Move:
        """Return the move for these inputs, reusing the last one if it fits."""
        with failures_as_analysis_errors(self):
            refuse_complex_step(self)
            initial, surface = (finite_points(inputs[name], name, self.msginfo) for name in INPUTS)
        with as_analysis_errors(self):  # what follows is collective: what one process raises, all raise
            last = self._last
            is_there = on_first(self.comm, lambda: last is not None and last.is_for(initial, surface))
            if last is None or not is_there:
                self._last = last = None  # its factors make room for those of the next
                movement = self._move(initial, surface)
                self._start = getattr(movement, "start", None)
                self._last = last = _Move(initial.copy(), surface.copy(), movement, self._corners)
            if self.options["certified"] is not None and not is_there:
                self._last = None  # a refused design is moved again if requested again
                require_valid_splines(self.options["certified"], last.movement.points)
                self._last = last
        self._warn(last.movement.report)
        return last

    def _move(self, initial: np.ndarray, surface: np.ndarray) -> Movement:
        """Move on the processes chosen for it, unless the move was made ahead."""
        for n, (request, movement) in enumerate(self._ahead):
            if np.array_equal(request[0], initial) and np.array_equal(request[1], surface):
                del self._ahead[n]
                if isinstance(movement, MovementError):
                    raise movement
                return movement
        if self._shared is None:
            self._shared = shared_mover(self._mover, self.comm, self.options["processes"])
        return self._shared.move(initial, surface, **self._options_at(initial))

    def _options_at(self, initial: np.ndarray) -> dict:
        """Options of a move: the factor at its initial points if available."""
        if self._start is not None and not np.array_equal(self._start.points, initial):
            self._start = None  # its memory serves the next one
        return {} if self._start is None else {"start": self._start}

    def _warn(self, report: MovementReport) -> None:
        """Warn of a control mesh or lattice that tangles, if the previous design's did not."""
        was_tangled, tangling = self._is_tangled, report.tangling
        self._is_tangled = bool(tangling)
        if tangling and not was_tangled and self.comm.rank == 0:
            _LOGGER.warning(
                "%s: the %s tangles: %s; designs are judged by the cells of the grid, and '%s' > 0 as a constraint "
                "keeps it from that",
                self.msginfo,
                "lattice" if self._mover.mesh.markers else "control mesh",
                tangling,
                CONTROL_CORNER_KS,
            )


def mesh_of(mover: Mover, pathname: str) -> MovingMesh:
    """Mesh of a mover; `InputError` if it is not a mover."""
    mesh = getattr(mover, "mesh", None)
    if mesh is None or not callable(getattr(mover, "move", None)):
        raise InputError(f"{pathname}: {mover!r} is no mover; give an object with mesh and move")
    return mesh


@dataclass(frozen=True, eq=False)
class _Move:
    """A movement, the inputs that it was made for, and the bound of the corners of its control mesh."""

    initial: np.ndarray
    surface: np.ndarray
    movement: Movement
    corners: ElementCorners

    @cached_property
    def gradient(self) -> np.ndarray:
        """Derivative of the bound with respect to the moved points, shape (n_points, 3)."""
        return self.corners.gradient(self.movement.points)

    def is_for(self, initial: np.ndarray, surface: np.ndarray) -> bool:
        return np.array_equal(initial, self.initial) and np.array_equal(surface, self.surface)

    def add_change(self, d_outputs: Vector, d_points: np.ndarray) -> None:
        """Add the changes of the outputs due to a change of the moved points, shape (n_points, 3)."""
        if CONTROL_POINTS in d_outputs:
            d_outputs[CONTROL_POINTS] += d_points.ravel()
        if CONTROL_CORNER_KS in d_outputs:
            d_outputs[CONTROL_CORNER_KS] += (self.gradient * d_points).sum()

    def points_bar(self, d_outputs: Vector) -> np.ndarray:
        """Derivative with respect to the moved points, flat, from the derivatives with respect to the outputs."""
        bar = d_outputs[CONTROL_POINTS] if CONTROL_POINTS in d_outputs else np.zeros(self.movement.points.size)
        if CONTROL_CORNER_KS in d_outputs and d_outputs[CONTROL_CORNER_KS].any():
            bar = bar + d_outputs[CONTROL_CORNER_KS] * self.gradient.ravel()
        return bar
