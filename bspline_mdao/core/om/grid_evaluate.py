"""The grid that belongs to a set of control points, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from openmdao.vectors.vector import Vector
from scipy.sparse import identity, kron

from ...base.numerics.processes import summed
from ...errors import InputError
from ...grids.topology.partition import Partition, Subdomain
from ...names import CONTROL_POINTS, GRID, SURFACE
from ..evaluation.node_map import NodeState
from ..mesh.boundary import require_mesh_of
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid
from ..model.movable import ControlPointMap, Movable
from ..sliding.sliding_nodes import Slide
from .check_directions import check_along_directions
from .checked_along_edges import check_along_edges, lines_among
from .component import (
    LINEAR_STEP,
    LastState,
    SparseComponent,
    add_product,
    as_node_numbers,
    fails_together,
    failures_as_analysis_errors,
    finite_points,
)
from .model_option import declare_model
from .subdomains import declare_partition, part_of_model


class GridEvaluate(SparseComponent):
    """Regenerate the grid from the control points, Eq. (3), ``x = layer(A b + T(b) r)``.

    A holds the basis values at the parameters and knots of the model. The residual r of the fit turns with its
    surroundings, and nodes near walls follow them as a rigid body, see `bspline_mdao.core.walls.grid_map`. What turns
    with what, and what is near which wall, is that of the model. Of a model without ``wall_layer`` the grid is
    ``A b + r``, and the component is linear (`is_linear`).

    ==================  ======  ====================  =====  =======================================================
    name                role    shape                 units  meaning
    ==================  ======  ====================  =====  =======================================================
    ``control_points``  input   (3 n_control_points)  m      control points, each shared one once, xyz interleaved
    ``surface``         input   (3 n)                 m      where the nodes of a ``surface``, or those of ``numbers``,
                                                             are asked to be
    ``grid``            output  (3 n_nodes)           m      nodes, blocks in file order, each in C order of (i, j, k)
    ==================  ======  ====================  =====  =======================================================

    On several processes ``grid`` is distributed: each evaluates the nodes of its `Subdomain`, with the bits of one
    process. Forwards no message is sent; in reverse one sum of all processes, of the size of the inputs. With a
    ``surface`` every process sees the nodes of the whole grid in ``setup``, and needs the whole model for that.

    Options
    -------
    model : FittedModel, LocalModel or MeshModel
        The fitted grid, or what this process needs of it; or a mesh without structure, whose nodes are ``grid``.
    partition : Partition or Subdomain, optional
        Which nodes each process holds; by default `Partition.of` deals out the blocks. A `Subdomain` is this process's.
    surface : SurfaceGrid, optional
        Surface whose nodes are to be exactly where ``surface`` says. What control points miss of them fades over the
        blocks, see :doc:`/theory/asked_walls`.
    numbers : sequence of int, optional
        Which of its nodes, each once; all by default.
    mesh : MovingMesh, optional
        Control mesh that moved: where patches of it slide on surfaces that are not planes, see `moving_mesh`, their
        nodes stay on these, see :doc:`/theory/sliding`.
    assembled : bool
        Declare A as a sparse matrix instead of applying it matrix-free, for solvers that want a matrix. It takes many
        times the memory and the time, and the map has to be linear, without a ``surface`` or patches that slide on one.

    Raises
    ------
    InputError
        In ``setup``, if a matrix is asked of a map that is not linear, or with a ``surface``; if the surface is of
        another model, or ``numbers`` are not those of its nodes, each once; if the partition does not fit the model or
        the number of processes.
    om.AnalysisError
        In a run, if a control point is not finite, or if the surroundings of a point are turned inside out.

    Examples
    --------
    >>> import numpy as np
    >>> import openmdao.api as om
    >>> from bspline_mdao import GridEvaluate, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", GridEvaluate(model=model), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("control_points", model.control_points.ravel())
    >>> problem.run_model()
    >>> bool(np.allclose(problem.get_val("grid"), model.regenerate().to_vector()))
    True
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            partition: Partition | Subdomain | None = None,
            surface: SurfaceGrid | None = None,
            numbers: Sequence[int] | np.ndarray | None = None,
            mesh: MovingMesh | None = None,
            assembled: bool = False,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self, desc="the fitted grid, or a subdomain of it")
        declare_partition(self)
        self.options.declare("surface", default=None, recordable=False, desc="surface whose nodes are given")
        self.options.declare("numbers", default=None, recordable=False, desc="which of its nodes are given")
        types = (MovingMesh, type(None))
        self.options.declare("mesh", types=types, default=None, recordable=False, desc="control mesh that moved")
        self.options.declare("assembled", types=bool, default=False, desc="declare the sparse Jacobian")

    @property
    def is_linear(self) -> bool:
        """Whether the outputs depend linearly (affinely, with a residual) on the inputs."""
        return self.options["model"].is_linear and not self._slides

    @fails_together
    def setup(self) -> None:
        """Declare the variables, of the sizes of the model."""
        model, surface = part_of_model(self), self.options["surface"]
        if self.options["mesh"] is not None:
            require_mesh_of(self.options["model"], self.options["mesh"], f"{self.msginfo}: the mesh")
        self._last = LastState()
        if self.options["assembled"] and (surface is not None or self._slides):
            raise InputError(
                f"{self.msginfo}: assembled=True does not go with a surface, given or slid on; leave one out"
            )
        if self.options["assembled"] and not self.is_linear:
            raise InputError(
                f"{self.msginfo}: assembled=True needs a linear map; fit the grid with wall_layer=False, or leave "
                f"assembled out"
            )
        self.matrix_free = not self.options["assembled"]
        self.add_input(CONTROL_POINTS, val=model.control_points.ravel(), units="m")
        self._map = self._map_of(model)
        if surface is not None and SURFACE in self._map.inputs:
            self.add_input(SURFACE, val=surface.points[self._numbers(surface)].ravel(), units="m")
            check_along_edges(self, SURFACE, lines_among(self._numbers(surface), surface.lines), digits=300.0)
        self.add_output(GRID, shape=3 * self._map.n_asked, units="m", distributed=self.comm.size > 1)
        if self.is_linear:
            check_along_directions(self, LINEAR_STEP)
        else:
            check_along_edges(self, CONTROL_POINTS, model.control_lines)

    @fails_together
    def setup_partials(self) -> None:
        """Declare the Jacobian once and for all where it is wanted as a matrix."""
        if self.options["assembled"]:  # a matrix-free one stays undeclared: OpenMDAO would allocate it, and it is dense
            grid_map: Any = self._map  # a linear one, which has an evaluator
            matrix = grid_map.evaluator.matrix()[: grid_map.n_asked]
            jacobian = kron(matrix, identity(3), format="coo")
            self.declare_sparse(GRID, CONTROL_POINTS, jacobian.row, jacobian.col, jacobian.data)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Evaluate the volumes at the nodes, and let nodes follow walls."""
        state = self._state_at(inputs)
        outputs[GRID] = state.nodes[: self._map.n_asked].ravel()
        if self.under_complex_step:
            change = state.jvp(*(inputs[name].imag.reshape(-1, 3) for name in self._map.inputs))
            outputs[GRID] += 1j * change[: self._map.n_asked].ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose at the inputs."""
        if self.options["assembled"]:
            super().compute_jacvec_product(inputs, d_inputs, d_outputs, mode)
            return
        state, grid_map = self._state_at(inputs), self._map
        names = [name for name in grid_map.inputs if name in d_inputs]

        def jvp(*directions: np.ndarray) -> np.ndarray:
            return state.jvp(**dict(zip(names, directions)))[: grid_map.n_asked]

        def vjp(bar: np.ndarray) -> list[np.ndarray | None]:
            bars = state.vjp(grid_map.padded(bar), names)
            return [summed(self.comm, bars[name]) for name in names]

        add_product(inputs, d_inputs, d_outputs, mode, jvp=jvp, vjp=vjp, of=GRID, wrt=names)

    def _map_of(self, model: Movable) -> ControlPointMap:
        """Map to the nodes of this process, which meets walls that are given."""
        surface, whole = self.options["surface"], self.options["model"]
        if surface is None:
            return model.map_sliding(self._slides, whole)
        return model.map_meeting(surface.rows[self._numbers(surface)], whole, self._slides)

    @property
    def _slides(self) -> tuple[Slide, ...]:
        """Patches that slide on surfaces that are not planes."""
        mesh = self.options["mesh"]
        return () if mesh is None else mesh.slides

    def _numbers(self, surface: SurfaceGrid) -> np.ndarray:
        """Numbers of the nodes of the surface that are given."""
        numbers = as_node_numbers(self.options["numbers"], surface.n_points, "numbers", self.msginfo)
        if surface.rows.max() >= self.options["model"].n_nodes:
            raise InputError(f"{self.msginfo}: the surface is of another model; make it of this one")
        if len(np.unique(numbers)) < len(numbers):
            raise InputError(f"{self.msginfo}: 'numbers' has a node twice; give each once")
        return numbers

    def _state_at(self, inputs: Vector) -> NodeState:
        with failures_as_analysis_errors(self):
            points = [finite_points(inputs[name], name, self.msginfo).real for name in self._map.inputs]
            return self._last.at(points, self._map.at)
