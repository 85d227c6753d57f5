"""The warper component for MPhys: surface coordinates to volume coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ....base.numerics.processes import summed, together
from ....grids.topology.partition import Subdomain
from ....names import GRID, SURFACE
from ...fit.surface_fit import SurfaceMiss
from ...mesh.surface import SurfaceGrid
from ...model.movable import Movable
from ...movement.mover import Mover
from ..check_directions import check_along_directions
from ..component import LINEAR_STEP, CheckedOnProcesses, finite_points
from ..grid_movement import GridMovement
from ..model_option import Copied, declare_model
from .conventions import COORDINATES, COUPLING, VOLUME, X_AERO, X_JIG
from .distribution import nodes_of_rank
from .renamed import Renamed, Renaming
from .wiring import require_source_before

__all__ = ["VolumeWarper"]


INSIDE = (
    'the grid has to be moved inside the coupling: give the builder scenario="aerostructural", or let it return this '
    "group from get_coupling_group_subsystem instead of get_pre_coupling_subsystem"
)
"""What to do if the surface nodes come from a coupling that has not run yet."""


class VolumeWarper(Copied, om.Group):
    """Move the volume grid with the surface, like IDWarp for ADflow and DAFoam.

    The surface control points follow the nodes, the mover moves the control mesh, and the grid is regenerated with its
    wall nodes exactly where the solver has them.

    ===================  ======  ============  ==============================================================
    name                 role    shape         meaning
    ===================  ======  ============  ==============================================================
    ``x_aero``           input   (3 n_points)  surface nodes of the solver (m)
    ``x_aero0``          input   (3 n_points)  the same before an analysis; MPhys may connect it, nothing reads it
    ``aero_vol_coords``  output  (3 n_nodes)   volume nodes of the solver (m), under the name ``volume_name``
    ===================  ======  ============  ==============================================================

    On several processes ``x_aero`` and the volume nodes are distributed: each process has the nodes of its part of the
    solver, any number of them.

    Options
    -------
    model : FittedModel or MeshModel
        The fitted grid; or an unstructured mesh, on one process.
    mover : Mover, optional
        Moves its control mesh; by default as in `GridMovement`, with all walls as the design surface.
    surface : SurfaceGrid, optional
        The design surface; all walls by default.
    numbers : sequence of int, optional
        Surface node of each of the solver's surface points on this process, possibly none; by default all nodes in
        order, equally many on each process. A node given more than once, also by several processes, gets the mean.
    rows : sequence of int, optional
        Grid row of each of the solver's volume nodes on this process, see `bspline_mdao.grids.topology.sharing`; only
        these are evaluated. By default all rows, blocks in file order, each in C order of (i, j, k); several processes
        each have the rows assigned by `Partition.of`.
    volume_name : str
        What the solver calls the volume nodes: "aero_vol_coords" (DAFoam), "adflow_vol_coords" (ADflow).
    require_valid : bool
        Refuse surfaces that invert cells of the grid, see `GridMovement`; nothing is refused if ``rows`` are given.
    comoving : bool
        Move everything fixed with the rigid part of the surface's motion, see `GridMovement`.

    Raises
    ------
    InputError
        In ``setup``, if a number or a row does not exist, if the nodes do not determine the control points, or if the
        mover belongs to another model. In a run, if the surface nodes come from a component that runs later.

    Notes
    -----
    The grid matches every given node to round-off, whatever the surface: one from `SurfaceGeometry`, which gives the
    grid of `GridMovement`, or an elastic wing's, which control points do not match exactly. The remaining distance
    fades out over the blocks, see :doc:`/theory/asked_walls`; `miss` and the log at level INFO say how large it is, and
    where. Surface nodes that the solver does not give follow the control points.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> from bspline_mdao.mphys import VolumeWarper
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> problem = om.Problem(VolumeWarper(model=model), reports=None)
    >>> _ = problem.setup()
    >>> problem.set_val("x_aero", 1.1 * SurfaceGrid.of(model).points.ravel())
    >>> problem.run_model()
    >>> problem.get_val("aero_vol_coords").shape
    (2250,)
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            mover: Mover | None = None,
            surface: SurfaceGrid | None = None,
            numbers: Sequence[int] | np.ndarray | None = None,
            rows: Sequence[int] | np.ndarray | None = None,
            volume_name: str = "aero_vol_coords",
            require_valid: bool = True,
            comoving: bool = False,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        self.options.declare("mover", default=None, recordable=False, desc="moves the control mesh of the model")
        self.options.declare("surface", default=None, recordable=False, desc="the design surface")
        self.options.declare("numbers", default=None, recordable=False, desc="surface nodes that the solver has")
        self.options.declare("rows", default=None, recordable=False, desc="volume nodes that the solver has")
        self.options.declare("volume_name", default=VOLUME, types=str, desc="name of the volume nodes")
        self.options.declare("require_valid", types=bool, default=True, desc="refuse inverted cells of the grid")
        self.options.declare("comoving", types=bool, default=False, desc="move outer boundaries with the surface")

    def setup(self) -> None:
        """Add the components in the order of the chain."""
        model, comm = self.options["model"], self.comm
        surface = self.options["surface"] or SurfaceGrid.of(model)
        numbers = nodes_of_rank(self.options["numbers"], surface.n_points, "numbers", comm, self.msginfo)
        counts = summed(comm, np.bincount(numbers, minlength=surface.n_points))
        valid, given = self.options["require_valid"], np.flatnonzero(counts)
        options = {"model": model, "surface": surface, "numbers": given}
        options |= {name: self.options[name] for name in ("mover", "comoving")}
        subdomain = self._subdomain(model)
        movement = GridMovement(**options, partition=subdomain, require_valid=valid, fit=False, quality=False)
        given_nodes = _SolverSurface(surface=surface, numbers=numbers, counts=counts)
        self.add_subsystem("surface", given_nodes, promotes_inputs=[X_AERO], promotes_outputs=[SURFACE])
        self.promotes("surface", inputs=[X_JIG], **(_FIRST if comm.size > 1 else {}))
        self.add_subsystem("movement", movement, promotes_inputs=[SURFACE], promotes_outputs=[GRID])
        nodes = {"shape": 3 * (model.n_nodes if subdomain is None else subdomain.n_nodes), "distributed": comm.size > 1}
        handed = Renaming(GRID, self.options["volume_name"], {**nodes, "units": "m"}, {**nodes, "tags": COUPLING})
        self.add_subsystem("nodes", Renamed(pairs=[handed]), promotes=["*"])

    def _subdomain(self, model: Movable) -> Subdomain | None:
        """Nodes of the grid that this process evaluates, in the solver's order; None for all of them on one process."""
        rows, comm = self.options["rows"], self.comm
        if rows is not None:
            return Subdomain.of_rows(nodes_of_rank(rows, model.n_nodes, "rows", comm, self.msginfo), model.n_nodes)
        return None if comm.size == 1 else model.partition(comm.size).subdomain(comm.rank)

    @property
    def miss(self) -> SurfaceMiss | None:
        """Distances between the nodes and the control points' surface in the last run; None before any run."""
        return self.movement.fit_surface.miss


_FIRST = {"src_indices": [0], "flat_src_indices": True, "src_shape": (1,)}
"""One number of what MPhys connects and nothing reads: OpenMDAO leaves no distributed input unconnected."""


class _SolverSurface(CheckedOnProcesses, om.ExplicitComponent):
    """Take the surface nodes from a solver, each once, averaging nodes given more than once."""

    # The solver's nodes are distributed, the surface is the same on all processes: the sum of their parts.

    def initialize(self) -> None:
        self.options.declare("surface", types=SurfaceGrid, recordable=False)
        self.options.declare("numbers", recordable=False)
        self.options.declare("counts", recordable=False)

    def setup(self) -> None:
        numbers, counts = self.options["numbers"], self.options["counts"]
        points, given = self.options["surface"].points, np.flatnonzero(counts)
        self._places = np.searchsorted(given, numbers)
        self._weights, self._is_wired = 1.0 / counts[numbers][:, None], False
        nodes = {"val": points[numbers].ravel(), "distributed": self.comm.size > 1}
        self.add_input(X_AERO, **nodes, tags=COUPLING)
        self.add_input(X_JIG, **(nodes if self.comm.size == 1 else {}), tags=COORDINATES)
        self.add_output(SURFACE, val=points[given].ravel(), units="m")
        check_along_directions(self, LINEAR_STEP)

    def _means(self, nodes: np.ndarray) -> np.ndarray:
        means = np.zeros((self._get_var_meta(SURFACE, "size") // 3, 3), dtype=nodes.dtype)
        np.add.at(means, self._places, nodes * self._weights)
        return summed(self.comm, means)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        with together(self.comm):
            if not self._is_wired:
                require_source_before(self, X_AERO, INSIDE)
            nodes = finite_points(inputs[X_AERO], X_AERO, self.msginfo)
        self._is_wired = True
        outputs[SURFACE] = self._means(nodes).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        if SURFACE in d_outputs and X_AERO in d_inputs:
            if mode == "fwd":
                d_outputs[SURFACE] += self._means(d_inputs[X_AERO].reshape(-1, 3)).ravel()
            else:
                d_inputs[X_AERO] += (d_outputs[SURFACE].reshape(-1, 3)[self._places] * self._weights).ravel()
