"""The control mesh behind its moved surface, as an OpenMDAO component."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openmdao.api as om

from ..errors import InputError
from ..movement.mesh import MovingMesh
from ..movement.mover import Movement, MovementReport, Mover, differentiable
from ..names import CONTROL_POINTS, CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS
from .jacobian import (
    add_bar,
    check_along_directions,
    difference_step,
    direction_in,
    failures_as_analysis_errors,
    finite_points,
    refuse_complex_step,
)

INPUTS = (CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS)


class ControlMeshMove(om.ExplicitComponent):
    """Move the control mesh behind its surface, section III, with the exact derivative through all increments.

    The mover is an object: one of `bspline_mdao.movement`, or the user's own, see `bspline_mdao.movement.mover.Mover`.
    Surface control points end where they are asked for, those on symmetry planes slide in them, held ones stay.

    ==========================  ======  ====================  =====  ===============================================
    name                        role    shape                 units  meaning
    ==========================  ======  ====================  =====  ===============================================
    ``control_points_initial``  input   (3 n_control_points)  m      control points before the move, xyz interleaved
    ``surface_control_points``  input   (3 n_surface)         m      those on the design surface after the move, in
                                                                     the order of the mesh's ``surface_ids``
    ``control_points``          output  (3 n_control_points)  m      control points after the move
    ==========================  ======  ====================  =====  ===============================================

    Options
    -------
    mover : Mover
        Its mesh says what is moved and what each point may do; `bspline_mdao.moving_mesh` makes it from a fitted model.
        Factors are kept for derivatives where the mover does not say otherwise (``keep_factors``), but not in a problem
        that is set up with ``derivatives=False``.
    require_valid : bool
        Refuse a control mesh with elements that are inverted now and were not on the baseline.

    Raises
    ------
    InputError
        In ``setup``, if the mover is none; in a run, under complex step.
    om.AnalysisError
        In a run or a product, if a number is not finite, if the mover cannot go on, or if the control mesh tangles.
        Inputs that can be followed give the same control mesh afterwards as if nothing had happened.
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("mover", recordable=False, desc="moves the control mesh behind its surface")
        self.options.declare("require_valid", types=bool, default=True, desc="refuse a tangled control mesh")
        self._last: _Move | None = None

    @property
    def report(self) -> MovementReport | None:
        """What the last move did, increment by increment; None where there was none, or where it stopped half way."""
        return self._last and self._last.movement.report

    def setup(self):
        """Declare the variables, of the sizes of the mover's mesh."""
        mesh = mesh_of(self.options["mover"], self.msginfo)
        self._mover = differentiable(self.options["mover"]) if self._use_derivatives else self.options["mover"]
        self._last = None
        self.add_input(CONTROL_POINTS_INITIAL, val=mesh.points.ravel(), units="m")
        self.add_input(SURFACE_CONTROL_POINTS, val=mesh.points[mesh.surface_ids].ravel(), units="m")
        self.add_output(CONTROL_POINTS, val=mesh.points.ravel(), units="m")
        check_along_directions(self, difference_step(mesh.points[ids] for ids in mesh.blocks))

    def compute(self, inputs, outputs):
        """Make the move."""
        outputs[CONTROL_POINTS] = self._movement_at(inputs).points.ravel()

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        """Apply the Jacobian or its transpose at the inputs."""
        if CONTROL_POINTS not in d_outputs:
            return
        movement = self._movement_at(inputs)
        with failures_as_analysis_errors(self):
            if mode == "fwd":
                directions = (direction_in(d_inputs, inputs, name) for name in INPUTS)
                d_outputs[CONTROL_POINTS] += movement.jvp(*directions).ravel()
            else:
                initial_bar, surface_bar = movement.vjp(d_outputs[CONTROL_POINTS].reshape(-1, 3))
                add_bar(d_inputs, CONTROL_POINTS_INITIAL, initial_bar)
                add_bar(d_inputs, SURFACE_CONTROL_POINTS, surface_bar)

    def _movement_at(self, inputs) -> Movement:
        """Movement for these inputs: the last one if it was made for them."""
        refuse_complex_step(self)
        initial, surface = (finite_points(inputs[name], name, self.msginfo) for name in INPUTS)
        with failures_as_analysis_errors(self):
            if self._last is None or not self._last.is_for(initial, surface):
                self._last = None  # its factors make room for those of the next
                self._last = _Move.of(self._mover, initial.copy(), surface.copy())
            if self.options["require_valid"]:
                self._last.movement.report.require_valid()
        return self._last.movement


def mesh_of(mover: Mover, pathname: str) -> MovingMesh:
    """Give the mesh of a mover, or raise `InputError` where it is none."""
    mesh = getattr(mover, "mesh", None)
    if mesh is None or not callable(getattr(mover, "move", None)):
        raise InputError(f"{pathname}: {mover!r} is no mover; give an object with mesh and move")
    return mesh


@dataclass(frozen=True, eq=False)
class _Move:
    """A movement and the inputs that it was made for."""

    initial: np.ndarray
    surface: np.ndarray
    movement: Movement

    @classmethod
    def of(cls, mover: Mover, initial: np.ndarray, surface: np.ndarray) -> _Move:
        return cls(initial, surface, mover.move(initial, surface))

    def is_for(self, initial: np.ndarray, surface: np.ndarray) -> bool:
        return np.array_equal(initial, self.initial) and np.array_equal(surface, self.surface)
