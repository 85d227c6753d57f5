"""The chain from a baseline grid and a moved surface to the moved grid and its quality, as an OpenMDAO group."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ..errors import InputError
from ..model import FittedModel
from ..movement.boundary import moving_mesh
from ..movement.elasticity import LinearElasticity
from ..movement.mover import Mover
from .control_mesh_move import ControlMeshMove, mesh_of
from .fit import Fit
from .grid_evaluate import GridEvaluate
from .live_grid_evaluate import LiveGridEvaluate
from .quality import Quality


class GridMovement(om.Group):
    """Fit, move, evaluate, judge: the ordinary chain in one subsystem, under the names of `bspline_mdao.names`.

    ==========  ====================================================================  =================================
    subsystem   component                                                             is there
    ==========  ====================================================================  =================================
    fit         `Fit`: ``grid_initial`` -> ``control_points_initial``                 unless ``fit=False``
    move        `ControlMeshMove`: ``surface_control_points`` -> ``control_points``   always
    evaluate    `GridEvaluate`, or `LiveGridEvaluate`: -> ``grid``                    always
    quality     `Quality`: ``grid`` -> its outputs                                    unless ``quality=False``
    ==========  ====================================================================  =================================

    All inputs start at the values of the model, so that the first run gives the baseline grid.

    Options
    -------
    model : FittedModel
        The fitted grid.
    mover : Mover, optional
        Moves the control mesh of the model; by default linear elasticity, with all walls as the design surface.
    require_valid : bool
        Refuse a tangled control mesh, see `ControlMeshMove`.
    fit : bool
        Fit the control points to ``grid_initial``. Without it, ``control_points_initial`` is an input.
    live : bool
        The grid changes upstream: differentiate through parameters and knots as well, see `Fit`.
    quality : bool
        Measure the cells of the grid.

    Raises
    ------
    InputError
        In ``setup``, if the mover is that of another model, if the model does not say what moves, or if ``live`` is
        asked for without ``fit``.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("model", types=FittedModel, recordable=False, desc="the fitted grid")
        self.options.declare("mover", default=None, recordable=False, desc="moves the control mesh of the model")
        self.options.declare("require_valid", types=bool, default=True, desc="refuse a tangled control mesh")
        self.options.declare("fit", types=bool, default=True, desc="fit the control points to the baseline grid")
        self.options.declare("live", types=bool, default=False, desc="differentiate through parameters and knots")
        self.options.declare("quality", types=bool, default=True, desc="measure the cells of the grid")

    def setup(self):
        """Add the components in the order of the chain."""
        model, is_live = self.options["model"], self.options["live"]
        if is_live and not self.options["fit"]:
            raise InputError(f"{self.msginfo}: live=True needs fit=True; there is no grid to follow")
        if self.options["fit"]:
            self.add_subsystem("fit", Fit(model=model, live=is_live), promotes=["*"])
        move = ControlMeshMove(mover=self._mover(), require_valid=self.options["require_valid"])
        self.add_subsystem("move", move, promotes=["*"])
        evaluate = LiveGridEvaluate if is_live else GridEvaluate
        self.add_subsystem("evaluate", evaluate(model=model), promotes=["*"])
        if self.options["quality"]:
            self.add_subsystem("quality", Quality(model=model), promotes=["*"])

    def _mover(self) -> Mover:
        """The user's mover, or elasticity."""
        model, mover = self.options["model"], self.options["mover"]
        if mover is None:
            return LinearElasticity(moving_mesh(model))
        blocks, ids = mesh_of(mover, self.msginfo).blocks, model.mesh.control_ids
        if len(blocks) != len(ids) or not all(map(np.array_equal, blocks, ids)):
            raise InputError(
                f"{self.msginfo}: the mover's mesh is not the control mesh of {model.header.source}; "
                f"make it with moving_mesh(model)"
            )
        return mover
