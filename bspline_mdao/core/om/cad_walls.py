"""Wall nodes placed by the moved faces of a CAD file, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from openmdao.vectors.vector import Vector

from ...base.checks import require_list
from ...errors import InputError
from ...names import ALL_NAMES, SURFACE
from ..design.cad_variables import CadVariable, require_one_tie
from .check_directions import check_along_directions
from .component import LINEAR_STEP, SparseComponent, fails_together, finite_values


class CadWalls(SparseComponent):
    """Put the walls exactly on the CAD faces they are tied to, as design variables move those faces.

    Give its ``surface`` to a `GridMovement` of the same nodes, ``surface=tied.surface``: wall nodes match to the last
    bit, and control points follow them. The component is linear.

    =====================  ======  ===========  =====  ==============================================================
    name                   role    shape        units  meaning
    =====================  ======  ===========  =====  ==============================================================
    name of each variable  input   (n_values,)  its    values of each of ``variables``; zero on the baseline
    ``surface``            output  (3 n)        m      nodes of ``tied.surface``, xyz interleaved
    =====================  ======  ===========  =====  ==============================================================

    Options
    -------
    variables : sequence of CadVariable
        `CadPoints` and `CadShapes` of one `TiedSurface`. Their moves add up.

    Raises
    ------
    InputError
        In ``setup``, if there is no variable, if a name occurs twice or is taken, or if the variables are of different
        walls.
    om.AnalysisError
        In a run, if a value is not finite.

    Examples
    --------
    >>> from bspline_mdao import GridMovement
    >>> from bspline_mdao.design import CadPoints, CadWalls
    >>> walls = CadWalls(variables=[CadPoints("shape", tied, direction="y")])  # doctest: +SKIP
    >>> _ = problem.model.add_subsystem("walls", walls, promotes=["*"])  # doctest: +SKIP
    >>> movement = GridMovement(model=tied.model, surface=tied.surface)  # doctest: +SKIP
    >>> _ = problem.model.add_subsystem("grid", movement, promotes=["*"])  # doctest: +SKIP
    """

    is_linear = True
    """Whether the outputs depend linearly (affinely) on the inputs."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            variables: Sequence[CadVariable],
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("variables", recordable=False, desc="what moves the faces of a CAD file")

    @fails_together
    def setup(self) -> None:
        """Declare the variables."""
        members = ("name", "units", "tied", "of_nodes", "initial")
        self._variables = require_list(self.options["variables"], "variable of a CAD file", members, self.msginfo)
        require_one_tie(self._variables, self.msginfo)
        names = [variable.name for variable in self._variables]
        taken = [name for n, name in enumerate(names) if name in (*ALL_NAMES, *names[:n])]
        if taken:
            raise InputError(f"{self.msginfo}: a variable is called '{taken[0]}', which is taken; choose another name")
        tied = self._variables[0].tied
        self._at_rest = tied.surface.points.ravel()
        self.add_output(SURFACE, val=self._at_rest, units="m")
        for variable in self._variables:
            self.add_input(variable.name, val=variable.initial, units=variable.units)
        check_along_directions(self, LINEAR_STEP)

    @fails_together
    def setup_partials(self) -> None:
        """Declare the constant derivatives."""
        for variable in self._variables:
            found = variable.of_nodes.tocoo()
            self.declare_sparse(SURFACE, variable.name, found.row, found.col, found.data)

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Add the moves."""
        moves = [v.of_nodes @ finite_values(inputs[v.name], v.name, self.msginfo) for v in self._variables]
        outputs[SURFACE] = self._at_rest + np.sum(moves, axis=0)
