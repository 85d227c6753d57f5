"""The quality of the cells of a grid, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...base.numerics.processes import from_all, together
from ...errors import InputError
from ...grids.cells.aggregates import AGGREGATES
from ...grids.cells.grid_quality import GridQuality, GridValues
from ...grids.cells.pieces import Pieces
from ...grids.cells.report import QualityReport, inverted_cells, patches_of, report_quality
from ...grids.topology.partition import Partition, Subdomain
from ...names import GRID
from ..model.model import Model, nodes_at
from .checked_along_edges import check_along_edges, numbered_blocks
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
    """Measure the cells of a grid: smooth bounds for constraints, and on demand Q of every cell, Eq. (9).

    The bounds never exceed the smallest value, so that ``quality_ks >= 0.01`` keeps every cell above 0.01. Q cannot see
    a mirrored cell; ``corner_ks > 0`` or ``jacobian_ks > 0`` keeps every cell valid. At walls,
    ``height_low_ks >= 0.95`` and ``height_high_ks <= 1.05`` keep the heights of all first cells, and with them y+,
    within 5 % of the baseline's.

    ==================  ======  ===========  =====  ================================================================
    name                role    shape        units  meaning
    ==================  ======  ===========  =====  ================================================================
    ``grid``            input   (3 n_nodes)  m      nodes, blocks in file order, each in C order of (i, j, k)
    ``aggregates``      output  (1,) each           the smooth bounds asked for, by the names and meanings in
                                                    `bspline_mdao.grids.cells.aggregates.AGGREGATES`
    ``cell_quality``    output  (n_cells,)          Q of every cell: blocks in order, each in C order of its cells
    ==================  ======  ===========  =====  ================================================================

    On several processes ``grid`` and ``cell_quality`` are distributed: each has those of its subdomain of the grid. The
    aggregates and the report are those of the whole grid, the same on all of them.

    Options
    -------
    model : FittedModel or LocalModel
        The fitted grid. Its baseline decides which sign is right-handed and which corners have collapsed.
    partition : Partition or Subdomain, optional
        Blocks that each process holds; by default those of the model if it is a subdomain of one, or else
        ``Partition.of(model.topology, n_processes)``.
    aggregates : sequence of str
        Which bounds are outputs. Those of heights, which need patches of kind wall, are none by default.
    cells : bool
        Whether ``cell_quality`` is an output.
    rho : float
        Sharpness of the Kreisselmeier-Steinhauser bounds: they are below the minimum by at most ln(n) / rho.
    p : int
        Power of the p-norms.
    rho_height : float
        Sharpness of the bounds of heights: they are off by at most ln(n) / rho_height for n nodes on walls, 0.01 for
        22,000.
    n_bins : int
        Bins of the distribution in `report`.
    require_valid : bool
        Refuse grids with inverted cells that were valid on the baseline.

    Raises
    ------
    InputError
        In ``setup``, if an option cannot be used; in a run, under complex step.
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
            model: Model,
            partition: Partition | Subdomain | None = None,
            aggregates: Sequence[str] = ("quality_ks", "quality_pnorm", "corner_ks", "volume_ks"),
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
        default = tuple(name for name, aggregate in AGGREGATES.items() if aggregate.is_default)
        self.options.declare("aggregates", default=default, desc="bounds that are outputs")
        self.options.declare("cells", types=bool, default=False, desc="output Q of every cell")
        self.options.declare("rho", default=100.0, desc="sharpness of Kreisselmeier-Steinhauser bounds")
        self.options.declare("p", types=int, default=64, desc="power of p-norms")
        self.options.declare("rho_height", default=1000.0, desc="sharpness of the bounds of heights at walls")
        self.options.declare("n_bins", types=int, default=50, desc="bins of the distribution of Q")
        self.options.declare("require_valid", types=bool, default=False, desc="refuse inverted cells")

    def setup(self) -> None:
        """Declare the variables, of the sizes of the model."""
        pieces, nodes = self._baseline()
        settings = {name: self.options[name] for name in ("rho", "p", "rho_height")}
        self._quality = GridQuality.of_pieces(pieces, nodes, **settings)
        with together(self.comm):
            try:
                self._quality.require(self.options["aggregates"])
            except InputError as error:
                raise InputError(f"{self.msginfo}: {error}") from error
        is_distributed = self.comm.size > 1
        self.add_input(GRID, val=nodes.ravel(), units="m", distributed=is_distributed)
        for name in self.options["aggregates"]:
            self.add_output(name, desc=AGGREGATES[name].meaning)
        if self.options["cells"]:
            self.add_output(CELL_QUALITY, shape=self._quality.n_cells, distributed=is_distributed)
        sharpness = 10.0 * max(self.options["rho"], self.options["p"])  # bounds follow the worst of all corners
        if any(AGGREGATES[name].is_of_heights for name in self.options["aggregates"]):
            sharpness = max(sharpness, 10.0 * self.options["rho_height"])
        check_along_edges(self, GRID, numbered_blocks(piece.shape for piece in pieces.local), sharpness)

    def _baseline(self) -> tuple[Pieces, np.ndarray]:
        """Pieces of the grid that the processes hold, and the nodes (n, 3) of those of this one on the baseline."""
        model = self.options["model"]
        with together(self.comm):
            subdomain = subdomain_of(self)
            if subdomain is None:
                baseline = model.regenerate()
                return Pieces.of_grid(baseline), baseline.to_vector().reshape(-1, 3)
            windows = subdomain.windows
            if windows is None:
                raise InputError(
                    f"{self.msginfo}: a subdomain of rows has no cells; give the partition by "
                    f"Partition.of(model.topology, {self.comm.size})"
                )
            nodes = nodes_at(model, subdomain.rows)
        partition = Partition(subdomain.shapes_of_grid, tuple(from_all(self.comm, windows)))
        return Pieces(partition, model.header.names, model.header.patches, model.header.source, self.comm), nodes

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Measure the cells."""
        with failures_as_analysis_errors(self):
            refuse_complex_step(self)
            nodes = finite_points(inputs[GRID], GRID, self.msginfo)
        if self.options["require_valid"]:
            self._refuse_inverted(nodes)
        values = self._values(nodes)
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
            change = self._quality.jvp(nodes, d_inputs[GRID].reshape(-1, 3), values)
            for name in d_outputs:
                d_outputs[name] += change.q if name == CELL_QUALITY else change.aggregates[name]
        else:
            seeds = {name: d_outputs[name].item() for name in values.aggregates if name in d_outputs}
            q_bar = d_outputs[CELL_QUALITY] if CELL_QUALITY in d_outputs else None  # noqa: SIM401 - it has no `get`
            d_inputs[GRID] += self._quality.vjp(nodes, values, GridValues(seeds, q_bar)).ravel()

    def report(self) -> QualityReport:
        """Report on the grid that the input holds: extremes, distribution of Q, inverted cells, heights at walls.

        All processes call it.
        """
        return report_quality(self._quality, self.get_val(GRID).reshape(-1, 3), self.options["n_bins"])

    def _values(self, nodes: np.ndarray) -> GridValues:
        return self._quality.evaluate(nodes, self.options["aggregates"], self.options["cells"])

    def _refuse_inverted(self, nodes: np.ndarray) -> None:
        inverted = inverted_cells(self._quality, self._quality.cells_in_turn(nodes), newly=True)
        if inverted:
            adjacent = ", ".join(f"'{name}'" for name in patches_of(inverted))
            raise om.AnalysisError(
                f"{self.msginfo}: {inverted[0]} is inverted, with corner triple product {inverted[0].corner:.2g}; "
                f"{f'the worst of such cells lie on {adjacent}; ' if adjacent else ''}take a smaller step"
            )
