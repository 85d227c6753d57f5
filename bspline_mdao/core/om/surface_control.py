"""Surface control points from design variables, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from openmdao.jacobians.jacobian import Jacobian
from openmdao.vectors.vector import Vector
from scipy.sparse import csr_array

from ...names import CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS
from ..design.parametrization import Parametrization, SurfacePartials
from .check_directions import check_along_directions
from .component import (
    SMOOTH_STEP,
    SparseComponent,
    SparsePattern,
    fails_together,
    finite_points,
    finite_values,
    refuse_complex_step,
)


class SurfaceControl(SparseComponent):
    """Move the surface control points by design variables: free-form, planform, or your own.

    The variables of a `Parametrization` are inputs under their names, and move nothing at their initial values. Linear
    constraints among the control points are eliminated, so all values of the variables satisfy them.

    ==========================  ======  ====================  =====  ===============================================
    name                        role    shape                 units  meaning
    ==========================  ======  ====================  =====  ===============================================
    name of each variable       input   (n_values)            its    its values
    ``control_points_initial``  input   (3 n_control_points)  m      control points before the move, xyz interleaved
    ``surface_control_points``  output  (3 n_surface)         m      those on the design surface after the move, in
                                                                     the order of the mesh's ``surface_ids``
    name of each hinge          output  (6,)                  m      both points of a `Hinge` that has a name
    ==========================  ======  ====================  =====  ===============================================

    Options
    -------
    parametrization : Parametrization
        The variables and the linear constraints.

    Raises
    ------
    om.AnalysisError
        In a run, if a value or a control point is not finite.
    InputError
        For partial derivatives under complex step.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import DesignSurface, SurfaceControl, fit_grid
    >>> from bspline_mdao.design import Twist
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((5, 5, 5))))
    >>> shape = wing.parametrization([Twist("twist", wing.axis, stations=2)])
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", SurfaceControl(parametrization=shape), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> problem.get_val("surface_control_points").size == 3 * wing.mesh.surface_ids.size
    True
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            parametrization: Parametrization,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare(
            "parametrization", types=Parametrization, recordable=False, desc="variables and constraints"
        )

    @fails_together
    def setup(self) -> None:
        """Declare the variables in the sizes of the parametrization."""
        parametrization = self.options["parametrization"]
        mesh = parametrization.mesh
        for variable in parametrization.variables:
            self.add_input(variable.name, val=parametrization.initial[variable.name], units=variable.units)
        self.add_input(CONTROL_POINTS_INITIAL, val=mesh.points.ravel(), units="m")
        self.add_output(SURFACE_CONTROL_POINTS, val=mesh.points[mesh.surface_ids].ravel(), units="m")
        for name, rows in parametrization.hinges.items():
            self.add_output(name, val=parametrization.layout.points[rows].ravel(), units="m")
        check_along_directions(self, SMOOTH_STEP)

    @fails_together
    def setup_partials(self) -> None:
        """Declare the entries that may differ from zero."""
        pattern, ids = self.options["parametrization"].pattern, self.options["parametrization"].mesh.surface_ids
        columns = (3 * ids[:, None] + [0, 1, 2]).ravel()
        self._sparse = {key: SparsePattern.of(matrix) for key, matrix in _parts(pattern) if matrix.nnz}
        for (of, wrt), sparse in self._sparse.items():
            cols = columns[sparse.cols] if wrt == CONTROL_POINTS_INITIAL else sparse.cols
            self.declare_sparse(of, wrt, sparse.rows, cols)

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Move the points."""
        parametrization, at = self.options["parametrization"], self._at(inputs)
        outputs[SURFACE_CONTROL_POINTS] = parametrization.apply(*at).ravel()
        for name, points in parametrization.hinge_points(*at).items() if parametrization.hinges else ():
            outputs[name] = points.ravel()

    @fails_together
    def compute_partials(self, inputs: Vector, partials: Jacobian) -> None:
        """Differentiate the move."""
        refuse_complex_step(self)
        found = self.options["parametrization"].partials(*self._at(inputs))
        for key, matrix in _parts(found):
            if key in self._sparse:
                partials[key] = self._sparse[key].data(matrix, f"{self.msginfo}: '{key[1]}'")

    def _at(self, inputs: Vector) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Surface control points of the baseline and the values of all variables."""
        parametrization = self.options["parametrization"]
        initial = finite_points(inputs[CONTROL_POINTS_INITIAL], CONTROL_POINTS_INITIAL, self.msginfo)
        names = [variable.name for variable in parametrization.variables]
        values = {name: finite_values(inputs[name], name, self.msginfo) for name in names}
        return initial[parametrization.mesh.surface_ids], values


def _parts(partials: SurfacePartials) -> Iterator[tuple[tuple[str, str], csr_array]]:
    """Matrices of the surface and of hinges by output and input names."""
    for of, found in {SURFACE_CONTROL_POINTS: partials, **partials.hinges}.items():
        for wrt, matrix in {CONTROL_POINTS_INITIAL: found.initial, **found.values}.items():
            yield (of, wrt), matrix
