"""The quality of the cells of a grid, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...base.numerics.processes import together
from ...errors import InputError
from ...grids.cells.aggregates import AGGREGATES
from ...grids.cells.cell_judge import CellJudge
from ...grids.cells.grid_quality import GridValues
from ...grids.topology.partition import Partition, Subdomain
from ...names import GRID
from ..model.movable import Movable
from .checked_along_edges import check_along_edges
from .component import (
    CheckedOnProcesses,
    failures_as_analysis_errors,
    finite_points,
    refuse_complex_step,
)
from .model_option import declare_model
from .subdomains import declare_partition, subdomain_of

CELL_QUALITY = "cell_quality"


class Quality(CheckedOnProcesses, om.ExplicitComponent):
    """Measure the cells of a grid: smooth bounds for constraints, and optionally Q of every cell, Eq. (9).

    The bounds never exceed the smallest value, so ``quality_ks >= 0.01`` keeps every cell above 0.01. Q cannot detect a
    mirrored cell; ``corner_ks > 0`` or ``jacobian_ks > 0`` keeps every cell valid. At walls, ``height_low_ks >= 0.95``
    and ``height_high_ks <= 1.05`` keep all first cell heights, and with them y+, within 5 % of the baseline.

    ==================  ======  ===========  =====  ================================================================
    name                role    shape        units  meaning
    ==================  ======  ===========  =====  ================================================================
    ``grid``            input   (3 n_nodes)  m      nodes, blocks in file order, each in C order of (i, j, k)
    ``aggregates``      output  (1,) each           the requested smooth bounds, names and meanings as in
                                                    `bspline_mdao.grids.cells.aggregates.AGGREGATES`
    ``cell_quality``    output  (n_cells,)          Q of every cell: blocks in order, each in C order of its cells
    ==================  ======  ===========  =====  ================================================================

    On several processes ``grid`` and ``cell_quality`` are distributed: each process has its subdomain's part. The
    aggregates and the report cover the whole grid and are the same on all processes.

    Options
    -------
    model : FittedModel, LocalModel or MeshModel
        The fitted grid, or the mesh. Its baseline determines which sign is right-handed and which corners are
        collapsed.
    partition : Partition or Subdomain, optional
        Blocks of each process; by default the model's own if it is a subdomain of a partition, otherwise
        ``Partition.of(model.topology, n_processes)``.
    aggregates : sequence of str, optional
        Which bounds are outputs. Height bounds, which need walls, are not among the defaults. Cells of mixed kinds have
        ``volume_ks``, of the pyramids from cell centres to faces, and the height bounds.
    cells : bool
        Whether ``cell_quality`` is an output.
    rho : float
        Sharpness of the Kreisselmeier-Steinhauser bounds: they are below the minimum by at most ln(n) / rho.
    p : int
        Power of the p-norms.
    rho_height : float
        Sharpness of the height bounds: their error is at most ln(n) / rho_height for n wall nodes, 0.01 for 22,000.
    n_bins : int
        Bins of the distribution in `report`.
    require_valid : bool
        Refuse grids with inverted cells which were valid on the baseline.

    Raises
    ------
    InputError
        In ``setup``, if an option is invalid; in a run, under complex step.
    om.AnalysisError
        In a run, if a node is not finite; with ``require_valid``, if a cell is inverted.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import Quality, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> problem = om.Problem(reports=None)
    >>> quality = problem.model.add_subsystem("quality", Quality(model=model), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> quality.report().n_inverted
    0
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            partition: Partition | Subdomain | None = None,
            aggregates: Sequence[str] | None = None,
            cells: bool = False,
            rho: float = 100.0,
            p: int = 64,
            rho_height: float = 1000.0,
            n_bins: int = 50,
            require_valid: bool = False,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        declare_partition(self)
        self.options.declare(
            "aggregates", default=None, desc="bounds that are outputs; those that are usual by default"
        )
        self.options.declare("cells", types=bool, default=False, desc="output Q of every cell")
        self.options.declare("rho", default=100.0, desc="sharpness of Kreisselmeier-Steinhauser bounds")
        self.options.declare("p", types=int, default=64, desc="power of p-norms")
        self.options.declare("rho_height", default=1000.0, desc="sharpness of the bounds of heights at walls")
        self.options.declare("n_bins", types=int, default=50, desc="bins of the distribution of Q")
        self.options.declare("require_valid", types=bool, default=False, desc="refuse inverted cells")

    def setup(self) -> None:
        """Declare the variables in the model's sizes."""
        self._judge = self._made_judge()
        self._names = self._asked(self._judge)
        is_distributed = self.comm.size > 1
        self.add_input(GRID, val=self._judge.baseline.ravel(), units="m", distributed=is_distributed)
        for name in self._names:
            self.add_output(name, desc=AGGREGATES[name].meaning)
        if self.options["cells"]:
            self.add_output(CELL_QUALITY, shape=self._judge.n_cells, distributed=is_distributed)
        sharpness = 10.0 * max(self.options["rho"], self.options["p"])  # bounds follow the worst corner
        if any(AGGREGATES[name].is_of_heights for name in self._names):
            sharpness = max(sharpness, 10.0 * self.options["rho_height"])
        check_along_edges(self, GRID, self._judge.lines, sharpness)

    def _made_judge(self) -> CellJudge:
        """Make the judge of the cells; if one process refuses, all refuse."""
        settings = {name: self.options[name] for name in ("rho", "p", "rho_height")}
        with together(self.comm):
            subdomain = subdomain_of(self)
        try:
            judge = self.options["model"].judge(subdomain, self.comm, **settings)
            with together(self.comm):
                judge.require(self._asked(judge), self.options["cells"])
        except InputError as error:
            raise InputError(f"{self.msginfo}: {error}") from error
        return judge

    def _asked(self, judge: CellJudge) -> tuple[str, ...]:
        """Names of the aggregates that are outputs."""
        if self.options["aggregates"] is not None:
            return tuple(self.options["aggregates"])
        return tuple(name for name in judge.aggregates if AGGREGATES[name].is_default)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Measure the cells."""
        with failures_as_analysis_errors(self):
            refuse_complex_step(self)
            nodes = finite_points(inputs[GRID], GRID, self.msginfo)
        values = self._values(nodes)
        if self.options["require_valid"] and not (values.min_corner is not None and values.min_corner > 0.0):
            self._refuse_inverted(nodes)
        for name, value in values.aggregates.items():
            outputs[name] = value
        if values.q is not None:
            outputs[CELL_QUALITY] = values.q

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if GRID not in d_inputs:
            return
        refuse_complex_step(self)
        nodes = inputs[GRID].reshape(-1, 3)
        values = self._values(nodes)
        if mode == "fwd":
            change = self._judge.jvp(nodes, d_inputs[GRID].reshape(-1, 3), values)
            for name in d_outputs:
                d_outputs[name] += change.q if name == CELL_QUALITY else change.aggregates[name]
        else:
            seeds = {name: d_outputs[name].item() for name in values.aggregates if name in d_outputs}
            q_bar = d_outputs[CELL_QUALITY] if CELL_QUALITY in d_outputs else None  # noqa: SIM401 - it has no `get`
            d_inputs[GRID] += self._judge.vjp(nodes, values, GridValues(seeds, q_bar)).ravel()

    def report(self) -> Any:
        """Report on the grid in the input: extremes, distribution of Q, inverted cells, heights at walls.

        All processes must call it. Cells without a Q have no distribution, see `MixedReport`.
        """
        return self._judge.report(self.get_val(GRID).reshape(-1, 3), self.options["n_bins"])

    def _values(self, nodes: np.ndarray) -> GridValues:
        return self._judge.evaluate(nodes, self._names, self.options["cells"])

    def _refuse_inverted(self, nodes: np.ndarray) -> None:
        what = self._judge.newly_inverted(nodes)
        if what:
            raise om.AnalysisError(f"{self.msginfo}: {what}; take a smaller step")
