"""The flow about the wing of a grid by a vortex lattice, with the variables of the Euler flow.

Theory: ``docs/theory/vortex_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector
from scipy.sparse import csr_array, diags_array, eye_array, kron

from ...core.measures.camber_surface import CamberSurface
from ...core.mesh.surface import SurfaceGrid
from ...core.model.model import nodes_at
from ...core.model.movable import Movable
from ...core.om.check_directions import check_along_directions
from ...core.om.component import SMOOTH_STEP, add_bar, difference_step, direction_in, fails_together
from ...core.om.model_option import Copied, declare_model
from ...core.om.surface_measure import SurfaceMeasure
from ...errors import InputError
from ...grids.cells.quads import area_vectors
from ...names import GRID, SURFACE
from ..loads.force_coefficients import ForceCoefficients
from ..loads.induced_drag import InducedDrag
from ..loads.panel_pressures import panel_pressures, panel_pressures_jvp, panel_pressures_vjp
from ..loads.span_strips import SpanStrips
from ..loads.stream import RADIAN
from ..loads.wing_coefficients import WingCoefficients
from .outputs import declare_outputs, documents_outputs
from .references import REFERENCES, declare_references, warn_of_area
from .vortex_lattice import LatticeStates

N_CHORD, N_SPAN = 5, 17
"""Nodes of a lattice along the chord and along the span."""


@documents_outputs("lattice")
class LatticeFlow(Copied, om.Group):
    """Lift, moments, induced drag and span load of a half wing by OpenAeroStruct's vortex lattice, in seconds.

    It has the variables of `EulerFlow`, so a study can start with this group and change one line later.

    ==================  ======  =============  =====  ==================================================================
    name                role    shape          units  meaning
    ==================  ======  =============  =====  ==================================================================
    ``grid``            input   (3 n)          m      nodes of the grid, xyz interleaved
    ``alpha``           input   (1,)           deg    angle of attack; 2 by default
    ``Mach_number``     input   (1,)                  Prandtl-Glauert below 1; 0.3 by default
    {outputs}
    ==================  ======  =============  =====  ==================================================================

    ``CD`` is computed from the forces on the bound vortices; optimise with ``CD_induced``. There are n_span - 1 strips,
    and (n_chord - 1, n_span - 1) panels.

    Options
    -------
    model : FittedModel, LocalModel or MeshModel
        The fitted grid about one half of a wing, the span 0 in the plane of symmetry, or the part of it that one of
        several processes needs by `Partition.of`; or an unstructured mesh about one, on one process.
    reference_area : float
        Of the half wing (m^2).
    reference_chord : float
        Chord for moments (m).
    moment_reference : tuple of float
        Reference point of moments, in the axes of the grid (m).
    n_chord, n_span : int
        Nodes of the lattice.
    patches : str or sequence of str, optional
        Patches of the wing, such as ``"wing*"``; all walls by default.
    axes : str
        Axes of the grid that point downstream, along the span and up.
    ends : tuple of float, optional
        Ends of the lattice along the span (m), see `CamberSurface.of`; by default it ends a quarter of a strip before
        the tip, which makes the drag of an elliptical load accurate to 2e-4.

    Raises
    ------
    InputError
        In ``setup``, if OpenAeroStruct is not installed, the wall has no camber surface, or the model belongs to
        another subdomain.
    om.AnalysisError
        In a run, if panels of the lattice are folded.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import LatticeFlow, fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> model = fit_grid(onera_m6_grid((9, 8, 7)))
    >>> problem = om.Problem(LatticeFlow(model=model, reference_area=0.75, n_span=7), reports=None)
    >>> _ = problem.setup()
    >>> problem.set_val("grid", model.regenerate().to_vector())
    >>> problem.set_val("alpha", 3.0, units="deg")
    >>> problem.run_model()
    >>> problem.get_val("CL").round(1)
    array([0.3])
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            reference_area: float | None = None,
            reference_chord: float = 1.0,
            moment_reference: Sequence[float] = (0.0, 0.0, 0.0),
            n_chord: int = 5,
            n_span: int = 17,
            patches: str | Sequence[str] | None = None,
            axes: str = "xzy",
            ends: Sequence[float] | None = None,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        declare_references(self.options)
        self.options.declare("n_chord", types=int, default=N_CHORD, lower=2, desc="nodes along the chord")
        self.options.declare("n_span", types=int, default=N_SPAN, lower=3, desc="nodes along the span")
        self.options.declare("patches", default=None, desc="patches of the wing by name or pattern")
        self.options.declare("axes", default="xzy", desc="axes downstream, along the span, up")
        self.options.declare("ends", default=None, desc="ends of the lattice along the span, m")

    @fails_together
    def setup(self) -> None:
        """Add the lattice, its solution, and its outputs."""
        _add_solution(self, self._add_camber(), {name: self.options[name] for name in REFERENCES})

    def _add_camber(self) -> CamberSurface:
        """Add the camber surface from the grid's own nodes, without an intermediate copy."""
        model = self.options["model"]
        surface = SurfaceGrid.of(model, self.options["patches"])
        settings = {name: self.options[name] for name in ("axes", "n_chord", "n_span", "ends")}
        camber = lattice_camber(surface, **settings)
        area, up = self.options["reference_area"], np.eye(3)["xyz".index(self.options["axes"][2])]
        if area and self.comm.size == 1:
            warn_of_area(self.pathname, area, area_vectors(surface.points[surface.quads]), up)
        self.add_subsystem("camber", UnfoldedLattice(measure=camber), promotes_outputs=["*"])
        rows = self._rows_here()
        places, n_nodes = _places(rows, surface.rows)
        entries = (3 * places[:, None] + np.arange(3)).ravel()
        self.promotes("camber", inputs=[(SURFACE, GRID)], src_indices=entries, src_shape=(3 * n_nodes,))
        if self.comm.size == 1:
            nodes = model.node_map
            self.set_input_defaults(GRID, val=nodes.nodes[: nodes.n_asked].ravel(), units="m")
        elif model.ownership is None:  # a subdomain of several only knows its own
            self.set_input_defaults(GRID, val=nodes_at(model, np.concatenate(rows)).ravel(), units="m")
        return camber

    def _rows_here(self) -> list[np.ndarray]:
        """Rows of the nodes of ``grid`` on each process, in order."""
        model, n_ranks = self.options["model"], self.comm.size
        if n_ranks == 1 and model.ownership is None:
            return [np.arange(model.n_nodes)]
        partition = model.partition(n_ranks)
        if not model.fits(partition.subdomain(self.comm.rank)):
            raise InputError(
                f"{self.msginfo}: the model is of another subdomain than those that Partition.of(model.topology, "
                f"{n_ranks}) gives this process; make it with that"
            )
        return [partition.subdomain(rank).rows for rank in range(n_ranks)]


class UnfoldedLattice(SurfaceMeasure):
    """The camber surface of a wing, as a lattice without folded panels."""

    # Variables and options are as in `SurfaceMeasure`, with a `CamberSurface` as the measure.

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Compute the lattice and check its panels."""
        super().compute(inputs, outputs)
        measure = self.options["measure"]
        folded = folded_panels(outputs[measure.name].real)
        if folded.any():
            i, j = np.argwhere(folded)[0] + 1
            raise om.AnalysisError(
                f"{self.msginfo}: {np.count_nonzero(folded)} of {folded.size} panels of the lattice are folded, the "
                f"first in row {i} from the leading edge and column {j} from the tip; take a smaller step, or "
                f"check the axes if this is the baseline"
            )


def lattice_camber(
    surface: SurfaceGrid,
    axes: str,
    n_chord: int = N_CHORD,
    n_span: int = N_SPAN,
    ends: tuple[float, float] | None = None,
) -> CamberSurface:
    """The lattice that a `LatticeFlow` with these options fits to walls."""
    if ends is None:  # the root, and a place a quarter of a strip before the tip
        span = np.abs(surface.points[:, "xyz".find(axes[1:2])])
        ends = float(span.min()), float(span.min() + np.ptp(span) * (n_span - 1) / (n_span - 0.75))
    return CamberSurface.of(surface, n_chord, n_span, axes=axes, ends=ends)


def lattice_lift(
    camber: CamberSurface,  # the lattice
    reference_area: float,  # of the half wing (m^2)
    alpha: float,  # alpha, mach: angle of attack (deg) and Mach number
    mach: float,
) -> float:
    """Lift coefficient of a lattice, as in `LatticeFlow`."""
    return LatticeLift(camber, reference_area, alpha, mach).at(camber.surface.points)


class LatticeLift:
    """Lift coefficient of a lattice for many shapes of its walls, as in `LatticeFlow`."""

    def __init__(self, camber: CamberSurface, reference_area: float, alpha: float, mach: float) -> None:
        self.camber, self.area, self._problem = camber, reference_area, om.Problem(reports=None)
        _add_solution(self._problem.model, camber, {"reference_area": reference_area})
        at_rest = camber.evaluate(camber.surface.points)
        self._problem.model.set_input_defaults("camber_surface", val=at_rest, units="m")
        self._problem.setup(derivatives=False)
        self._problem.set_val("alpha", alpha, units="deg")
        self._problem.set_val("Mach_number", mach)

    def at(self, points: np.ndarray) -> float:
        """Lift coefficient with nodes of the walls at points (m), shape (n, 3); `AnalysisError` if panels fold."""
        lattice = self.camber.evaluate(points)
        if folded_panels(lattice).any():
            raise om.AnalysisError("panels of the lattice are folded; take a smaller step")
        self._problem.set_val("camber_surface", lattice, units="m")
        self._problem.run_model()
        return self._problem.get_val("CL").item()


def _add_solution(group: om.Group, camber: CamberSurface, references: Mapping[str, Any]) -> None:
    """Add the solution on a lattice, and its outputs, to a group that has ``camber_surface``."""
    n_chord, n_span, _ = camber.shape
    group.add_subsystem("stream", _unit_stream())
    inputs = ["camber_surface", "alpha", "Mach_number"]
    group.add_subsystem("lattice", LatticeStates(n_chord=n_chord, n_span=n_span), promotes_inputs=inputs)
    group.add_subsystem(
        "forces",
        LatticeForces(camber=camber, **references),
        promotes_inputs=["camber_surface", "alpha"],
        promotes_outputs=["*"],
    )
    group.connect("stream.velocity", "lattice.velocity")
    group.connect("stream.density", "lattice.density")
    group.connect("lattice.panel_forces", "forces.panel_forces")
    group.set_input_defaults("alpha", val=2.0, units="deg")
    group.set_input_defaults("Mach_number", val=0.3)


def folded_panels(
    lattice: np.ndarray,  # (n_chord, n_span, 3), nodes (m)
) -> np.ndarray:  # (n_chord - 1, n_span - 1) of bool
    """Find panels with a corner that points the other way than the panel, or than one of its neighbours."""
    chordwise, spanwise = np.diff(lattice, axis=0), np.diff(lattice, axis=1)
    normals = np.cross(lattice[1:, 1:] - lattice[:-1, :-1], lattice[:-1, 1:] - lattice[1:, :-1])
    folded = np.zeros(normals.shape[:2], dtype=bool)
    for a in (chordwise[:, :-1], chordwise[:, 1:]):
        for b in (spanwise[:-1], spanwise[1:]):
            folded |= np.sum(np.cross(a, b) * normals, axis=2) < 0.0
    folded[1:] |= np.sum(normals[:-1] * normals[1:], axis=2) < 0.0
    folded[:, 1:] |= np.sum(normals[:, :-1] * normals[:, 1:], axis=2) < 0.0
    return folded


def _unit_stream() -> om.IndepVarComp:
    """Speed and density for a dynamic pressure of 1 Pa."""
    stream = om.IndepVarComp()
    stream.add_output("velocity", val=1.0, units="m/s")
    stream.add_output("density", val=2.0, units="kg/m**3")
    return stream


def _places(of_ranks: Sequence[np.ndarray], rows: np.ndarray) -> tuple[np.ndarray, int]:
    """Places of nodes among the nodes of all processes in order, and their number."""
    places, start = np.empty_like(rows), 0
    for rows_here in of_ranks:
        order = np.argsort(rows_here, kind="stable")
        at = np.searchsorted(rows_here, rows, sorter=order)
        is_here = np.zeros(len(rows), dtype=bool)
        is_here[at < len(rows_here)] = rows_here[order[at[at < len(rows_here)]]] == rows[at < len(rows_here)]
        places[is_here] = start + order[at[is_here]]
        start += len(rows_here)
    return places, start


@documents_outputs("lattice")
class LatticeForces(Copied, om.ExplicitComponent):
    """Lift, drag, moments and span load from the forces on the panels.

    ==================  ======  ============================  =====  ===================================================
    name                role    shape                         units  meaning
    ==================  ======  ============================  =====  ===================================================
    ``panel_forces``    input   (n_chord - 1, n_span - 1, 3)  N      at a dynamic pressure of 1 Pa
    ``camber_surface``  input   (n_chord, n_span, 3)          m      the lattice
    ``alpha``           input   (1,)                          deg    angle of attack
    {outputs}
    ==================  ======  ============================  =====  ===================================================

    Options
    -------
    camber : CamberSurface
        The lattice on the baseline.
    reference_area, reference_chord : float
        Of the half wing (m^2), and for moments (m).
    moment_reference : array_like, shape (3,)
        Reference point of moments, in the axes of the grid (m).
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("camber", types=CamberSurface, recordable=False, desc="the lattice on the baseline")
        declare_references(self.options)

    @fails_together
    def setup(self) -> None:
        """Declare the variables."""
        camber = self.options["camber"]
        n_chord, n_span, _ = camber.shape
        nodes = camber.evaluate(camber.surface.points)
        check_along_directions(self, SMOOTH_STEP, is_complex=True)
        check_along_directions(self, difference_step(nodes), "camber_surface", is_complex=True)
        self.add_input("panel_forces", shape=(n_chord - 1, n_span - 1, 3), units="N")
        self.add_input("camber_surface", val=nodes, units="m")
        self.add_input("alpha", units="deg")
        declare_outputs(self, "lattice", {"strips": n_span - 1, "panels": (n_chord - 1, n_span - 1)})
        self._wing = self._coefficients()

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Sum the forces on the panels."""
        for name, value in self._wing.evaluate(*self._arguments(inputs)).items():
            outputs[name] = value
        outputs["delta_Cp"] = panel_pressures(*(inputs[name] for name in _VECTORS))

    @fails_together
    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if mode == "fwd":
            self._forward(inputs, d_inputs, d_outputs)
        else:
            self._reverse(inputs, d_inputs, d_outputs)

    def _forward(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector) -> None:
        forces, nodes = (direction_in(d_inputs, inputs, name) @ self._axes for name in _VECTORS)
        d_alpha = RADIAN * d_inputs["alpha"].item() if "alpha" in d_inputs else 0.0
        found = self._wing.jvp(*self._arguments(inputs), forces, nodes, d_alpha)
        if "delta_Cp" in d_outputs:
            at = [inputs[name] for name in _VECTORS]
            along = (np.reshape(direction_in(d_inputs, inputs, name), x.shape) for name, x in zip(_VECTORS, at))
            found["delta_Cp"] = panel_pressures_jvp(*at, *along)
        for name in d_outputs:
            d_outputs[name] += found[name]

    def _reverse(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector) -> None:
        bars = {name: d_outputs[name] for name in d_outputs if name != "delta_Cp"}
        *vector_bars, alpha_bar = self._wing.vjp(*self._arguments(inputs), bars)
        for name, bar in zip(_VECTORS, vector_bars):
            add_bar(d_inputs, name, bar @ self._axes.T)
        if "alpha" in d_inputs:
            d_inputs["alpha"] += RADIAN * alpha_bar
        if "delta_Cp" in d_outputs:
            forces, nodes = (inputs[name] for name in _VECTORS)
            for name, bar in zip(_VECTORS, panel_pressures_vjp(forces, nodes, d_outputs["delta_Cp"])):
                add_bar(d_inputs, name, bar)

    @property
    def _axes(self) -> np.ndarray:
        return self.options["camber"].axes

    def _arguments(self, inputs: Vector) -> tuple[np.ndarray, np.ndarray, float]:
        """Forces, nodes and angle (rad), in the axes of the grid."""
        forces, nodes = (inputs[name].reshape(-1, 3) @ self._axes for name in _VECTORS)
        return forces, nodes, RADIAN * inputs["alpha"][0]

    def _coefficients(self) -> WingCoefficients:
        """Make the kernel that sums the forces."""
        camber, references = self.options["camber"], (self.options[name] for name in REFERENCES)
        induced = InducedDrag.of_vortices(_strips(camber.shape, self._axes))
        coefficients = ForceCoefficients(_bound(camber.shape), self._axes, *references)
        nodes = camber.evaluate(camber.surface.points).reshape(-1, 3) @ self._axes
        return WingCoefficients.of(coefficients, induced, nodes)


_VECTORS = ("panel_forces", "camber_surface")
"""Inputs that are vectors."""


def _strips(shape: tuple[int, int, int], axes: np.ndarray) -> SpanStrips:
    """Rows of panels along the chord, from the tip, and the last and first row of nodes."""
    n_chord, n_span, _ = shape
    face_weights = kron(np.ones((1, n_chord - 1)), eye_array(n_span - 1), format="csr")
    trailing = eye_array(n_span, n_chord * n_span, k=(n_chord - 1) * n_span, format="csr")
    leading = eye_array(n_span, n_chord * n_span, format="csr")
    return SpanStrips(csr_array(face_weights), csr_array(trailing), csr_array(leading), axes, is_symmetric=True)


def _bound(shape: tuple[int, int, int]) -> csr_array:
    """Weights of the nodes for the centres of the bound vortices, at a quarter of the chord of every panel."""
    along, across = (
        diags_array([first, second], offsets=[0, 1], shape=(n - 1, n))
        for n, first, second in ((shape[0], 0.75, 0.25), (shape[1], 0.5, 0.5))
    )
    return csr_array(kron(along, across, format="csr"))
