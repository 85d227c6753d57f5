"""Monotonic distributions of a design variable, as an OpenMDAO component."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from openmdao.vectors.vector import Vector

from ..measures.monotonic import neighbour_differences
from .check_directions import check_along_directions
from .component import LINEAR_STEP, SparseComponent, fails_together, finite_values


class Monotonic(SparseComponent):
    """Differences of neighbouring values of a variable, such as twist or chord at stations along the span.

    ``add_constraint(..., lower=0.0, linear=True)`` on the output keeps the variable rising, or falling with
    ``decreasing``. Connect or promote the input to the design variable.

    ==============================  ======  =======  =========  ====================================================
    name                            role    shape    units      meaning
    ==============================  ======  =======  =========  ====================================================
    the option ``variable``         input   (n,)     ``units``  values at n stations
    that and ``_differences``       output  (n - 1)  ``units``  each less the one before, or that less it
    ==============================  ======  =======  =========  ====================================================

    Options
    -------
    variable : str
        Name of the input.
    size : int
        Number of values n.
    units : str, optional
        Their units.
    decreasing : bool
        Subtract the next value from each: 0 or more where the variable falls.

    Raises
    ------
    InputError
        In ``setup``, if there are fewer than two values.
    om.AnalysisError
        In a run, if a value is not finite.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao.constraints import Monotonic
    >>> problem = om.Problem(reports=None)
    >>> component = Monotonic(variable="chord", size=3, decreasing=True)
    >>> monotonic = problem.model.add_subsystem("taper", component, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("chord", [1.0, 0.7, 0.6])
    >>> problem.run_model()
    >>> problem.get_val(monotonic.output).round(6)  # positive where values fall
    array([0.3, 0.1])
    """

    is_linear = True
    """Whether the outputs depend linearly (affinely) on the inputs."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            variable: str,
            size: int,
            units: str | None = None,
            decreasing: bool = False,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("variable", types=str, desc="name of the input")
        self.options.declare("size", types=int, desc="number of its values")
        self.options.declare("units", types=str, default=None, allow_none=True, desc="their units")
        self.options.declare("decreasing", types=bool, default=False, desc="whether falling values are positive")

    @property
    def output(self) -> str:
        """Name of the output."""
        return f"{self.options['variable']}_differences"

    @fails_together
    def setup(self) -> None:
        """Declare the variables."""
        size, units = self.options["size"], self.options["units"]
        self._differences = neighbour_differences(size, self.options["decreasing"])
        self.add_input(self.options["variable"], val=np.zeros(size), units=units)
        self.add_output(self.output, val=np.zeros(size - 1), units=units)
        check_along_directions(self, LINEAR_STEP)

    @fails_together
    def setup_partials(self) -> None:
        """Declare the constant Jacobian."""
        rows, cols, values = self._differences
        self.declare_sparse(self.output, self.options["variable"], rows, cols, values)

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Subtract neighbours."""
        name = self.options["variable"]
        outputs[self.output] = self._differences.apply(finite_values(inputs[name], name, self.msginfo))
