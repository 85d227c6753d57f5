"""The chain from a baseline grid and design variables to the moved grid and its quality, as an OpenMDAO group."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import openmdao.api as om

from ...base.checks import require_list
from ...errors import InputError
from ...grids.topology.partition import Partition, Subdomain
from ...names import ALL_NAMES, SURFACE, SURFACE_CONTROL_POINTS
from ..design.parametrization import Parametrization
from ..measures.measure import MEMBERS, Measure
from ..mesh.boundary import moving_mesh, require_mesh_of
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid
from ..model.movable import Movable
from ..movement.comoving import ComovingFrame
from ..movement.default_mover import default_mover
from ..movement.mover import Mover
from ..movement.shared import AUTO, WAYS
from .component import fails_together
from .control_mesh_move import ControlMeshMove, mesh_of
from .fit import Fit
from .grid_evaluate import GridEvaluate
from .live_grid_evaluate import LiveGridEvaluate
from .model_option import Copied, declare_model
from .quality import Quality
from .subdomains import declare_partition, subdomain_of
from .surface_control import SurfaceControl
from .surface_control_fit import SurfaceControlFit
from .surface_evaluate import SurfaceEvaluate
from .surface_measure import SurfaceMeasure


class GridMovement(Copied, om.Group):
    """Fit, design, move, evaluate and check: the usual chain in one group, with the names of `bspline_mdao.names`.

    ==================  ================================================================  ============================
    subsystem           component                                                         is there
    ==================  ================================================================  ============================
    fit                 `Fit`: ``grid_initial`` -> ``control_points_initial``             with ``fit``
    control             `SurfaceControl`: variables -> ``surface_control_points``         with a ``parametrization``
    evaluate_surface    `SurfaceEvaluate`: -> ``surface``, of the first measure           with ``measures`` alone
    evaluate_surface_2  the same for the next surface that is measured, and so on; what   with ``measures`` of several
                        they give is not promoted                                         surfaces
    fit_surface         `SurfaceControlFit`: ``surface`` -> ``surface_control_points``    with ``surface``
    ``measure_...``     `SurfaceMeasure`: ``surface`` -> the measure, by its name         one for each of ``measures``
    move                `ControlMeshMove`: -> ``control_points``                          always
    evaluate            `GridEvaluate`, or `LiveGridEvaluate`: -> ``grid``                always
    quality             `Quality`: ``grid`` -> its outputs                                with ``quality``, or with
                                                                                          ``require_valid`` for that
    ==================  ================================================================  ============================

    All inputs start at the model's values, so the first run gives the baseline grid. Without a parametrization
    ``surface_control_points`` is an input. With a ``surface``, its nodes are the input: control points are fitted to
    them, and the grid's wall matches them exactly. With both, as in `DesignSurface.of_nodes`, design variables move
    these nodes.

    Options
    -------
    model : FittedModel, LocalModel or MeshModel
        The fitted grid; or one process's part of it, which has no fit and takes no given surface nodes; or an
        unstructured mesh, which has no fit either.
    parametrization : Parametrization, optional
        Design variables of the surface and the linear constraints among its control points.
    measures : sequence of Measure
        Measures of one `SurfaceGrid` or several, such as wing thickness and fuselage volume.
    mover : Mover, optional
        Moves the control mesh of the model; by default `Rotations`, or the lattice of an unstructured mesh, on the mesh
        of the parametrization or with all walls as the design surface.
    surface : SurfaceGrid, optional
        Surface whose nodes are given: ``surface`` is an input.
    numbers : sequence of int, optional
        Which of these nodes are given; all by default.
    require_valid : bool
        Refuse designs that invert grid cells which were valid on the baseline, whether or not quality bounds are set,
        see `Quality`. A partition made of rows has no known cells, so nothing is refused. A tangled control mesh is no
        reason to refuse, see `ControlMeshMove`.
    comoving : bool
        Move everything fixed, such as the far field, with the rigid part of the surface's motion, see `ComovingFrame`.
    certify : bool
        Refuse designs that make more spline elements provably invalid than on the baseline, also between control
        points, see `bspline_mdao.certify`.
    processes : {"auto", "first", "all"}
        Which of several processes move the control mesh, see `ControlMeshMove`.
    fit : bool, optional
        Fit the control points to ``grid_initial``. Without a fit, ``control_points_initial`` is an input. By default
        they are fitted whenever possible on one process, and only with ``live`` on several, where ``grid_initial`` is
        distributed and OpenMDAO requires such an input to be connected.
    partition : Partition or Subdomain, optional
        Which grid nodes each process has, see `GridEvaluate`; by default blocks are distributed.
    live : bool
        The grid changes upstream: differentiate through parameters and knots as well, see `Fit`.
    quality : bool or sequence of str
        Measure the cells of the grid; a sequence names the bounds that are outputs, see `Quality`.

    Raises
    ------
    InputError
        In ``setup``, if the mover or the parametrization belongs to another model, if they have different design
        surfaces, if the model does not say what moves, if ``live`` is set without ``fit``, or if a ``surface`` is
        combined with a parametrization, with ``live``, or with measures of another surface.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import DesignSurface, GridMovement, fit_grid
    >>> from bspline_mdao.design import Twist
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> wing = DesignSurface.of(fit_grid(flat_plate_grid((5, 5, 5))))
    >>> shape = wing.parametrization([Twist("twist", wing.axis, stations=2)])
    >>> problem = om.Problem(GridMovement(model=wing.model, parametrization=shape, fit=False), reports=None)
    >>> _ = problem.setup()
    >>> problem.set_val("twist", [0.0, -3.0], units="deg")
    >>> problem.run_model()
    >>> problem.get_val("grid").shape, problem.get_val("quality_pnorm").shape
    ((4500,), (1,))
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            parametrization: Parametrization | None = None,
            measures: Sequence[Measure] = (),
            mover: Mover | None = None,
            surface: SurfaceGrid | None = None,
            numbers: Sequence[int] | np.ndarray | None = None,
            require_valid: bool = True,
            comoving: bool = False,
            certify: bool = False,
            processes: Literal["auto", "first", "all"] = "auto",
            fit: bool | None = None,
            partition: Partition | Subdomain | None = None,
            live: bool = False,
            quality: bool | Sequence[str] = True,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        types = (Parametrization, type(None))
        self.options.declare("parametrization", types=types, default=None, recordable=False, desc="design variables")
        self.options.declare("measures", default=(), recordable=False, desc="what is measured of the surface")
        self.options.declare("mover", default=None, recordable=False, desc="moves the control mesh of the model")
        self.options.declare("surface", default=None, recordable=False, desc="surface whose nodes are given")
        self.options.declare("numbers", default=None, recordable=False, desc="which of its nodes are given")
        self.options.declare("require_valid", types=bool, default=True, desc="refuse inverted cells of the grid")
        self.options.declare("comoving", types=bool, default=False, desc="move outer boundaries with the surface")
        self.options.declare("certify", types=bool, default=False, desc="refuse splines that are proved invalid")
        self.options.declare("processes", values=WAYS, default=AUTO, desc="which of several processes move")
        desc = "fit the control points to the baseline grid"
        self.options.declare("fit", types=(bool, type(None)), default=None, desc=desc)
        declare_partition(self)
        self.options.declare("live", types=bool, default=False, desc="differentiate through parameters and knots")
        self.options.declare("quality", default=True, desc="measure the cells of the grid, or which bounds of them")

    @fails_together
    def setup(self) -> None:
        """Add the components in the order of the chain."""
        model, is_live, mover = self.options["model"], self.options["live"], self._mover()
        surface = self.options["surface"]
        is_fitted = self.options["fit"]
        if is_fitted is None:
            is_fitted = is_live or (self.comm.size == 1 and not model.why_no_fit and not self._moves_nodes)
        is_local = model.ownership is not None
        if model.why_no_fit and (is_fitted or (is_local and surface is not None)):
            raise InputError(
                f"{self.msginfo}: {model.why_no_fit}; leave out 'fit', 'live' and 'surface', or give the whole model"
            )
        if is_live and not is_fitted:
            raise InputError(f"{self.msginfo}: live=True needs fit=True; there is no grid to follow")
        if surface is not None:
            self._require_alone(surface)
        if is_fitted:
            self._add("fit", Fit(model=model, live=is_live))
        asked = {"surface": surface, "numbers": self.options["numbers"]} if surface is not None else {}
        if self.options["parametrization"] is not None:
            self._add_control(self.options["parametrization"])
        if surface is not None:
            self._add("fit_surface", SurfaceControlFit(model=model, mesh=mover.mesh, **asked))
        if self.options["measures"]:
            self._add_measures(mover.mesh)
        certified = model if self.options["certify"] else None
        self._add("move", ControlMeshMove(mover=mover, certified=certified, processes=self.options["processes"]))
        common = {"model": model, "partition": self.options["partition"]}
        live = {"model": model, "mesh": mover.mesh}
        evaluate = LiveGridEvaluate(**live) if is_live else GridEvaluate(**common, **asked, mesh=mover.mesh)
        self._add("evaluate", evaluate)
        quality, is_judged = (
            self.options["quality"],
            self.options["require_valid"] and model.has_cells(subdomain_of(self)),
        )
        if quality or is_judged:
            bounds: dict[str, Any] = {} if quality is True else {"aggregates": quality or ()}
            self._add("quality", Quality(**common, **bounds, require_valid=is_judged))

    def _require_alone(self, surface: SurfaceGrid) -> None:
        """Refuse options that conflict with given surface nodes."""
        parametrization, by_nodes = self.options["parametrization"], self._moves_nodes
        if parametrization is not None and not (
            by_nodes and np.array_equal(parametrization.mesh.points, surface.points)
        ):
            raise InputError(
                f"{self.msginfo}: both a parametrization and the nodes of a surface would move the surface; give one, "
                f"or both of DesignSurface.of_nodes(model)"
            )
        if by_nodes and (self.options["fit"] or self.options["numbers"] is not None):
            name = "fit" if self.options["fit"] else "numbers"
            raise InputError(
                f"{self.msginfo}: variables move all nodes of the surface from where they are; leave out '{name}'"
            )
        if self.options["live"]:
            raise InputError(f"{self.msginfo}: live=True does not follow nodes of a surface; leave one out")
        if self.options["measures"] and self.options["numbers"] is not None:
            raise InputError(f"{self.msginfo}: measures need all nodes of the surface; leave out 'numbers'")

    @property
    def _moves_nodes(self) -> bool:
        """Whether the variables move surface nodes, see `DesignSurface.of_nodes`."""
        parametrization = self.options["parametrization"]
        return self.options["surface"] is not None and parametrization is not None and not parametrization.mesh.blocks

    def _add_control(self, parametrization: Parametrization) -> None:
        """Move surface control points by the variables, or surface nodes, which are then the given surface."""
        if not self._moves_nodes:
            self._add("control", SurfaceControl(parametrization=parametrization))
            return
        inputs = [variable.name for variable in parametrization.variables]
        outputs = [(SURFACE_CONTROL_POINTS, SURFACE), *parametrization.hinges]
        control = SurfaceControl(parametrization=parametrization)
        self.add_subsystem("control", control, promotes_inputs=inputs, promotes_outputs=outputs)

    def _add(self, name: str, component: om.ExplicitComponent) -> None:
        self.add_subsystem(name, component, promotes=["*"])

    def _add_measures(self, mesh: MovingMesh) -> None:
        """Regenerate the surface and measure it."""
        measures = require_list(self.options["measures"], "measure", MEMBERS, self.msginfo)
        self._require_names([measure.name for measure in measures])
        surfaces = list({id(measure.surface): measure.surface for measure in measures}.values())
        common: dict[str, Any] = {"model": self.options["model"], "mesh": mesh}
        if self.options["surface"] is None:
            self._add("evaluate_surface", SurfaceEvaluate(**common, surface=surfaces[0]))
        elif len(surfaces) > 1 or self.options["surface"] is not surfaces[0]:
            raise InputError(f"{self.msginfo}: the measures are of another surface than the nodes; make them with it")
        for number, surface in enumerate(surfaces[1:], start=2):
            self.add_subsystem(
                f"evaluate_surface_{number}",
                SurfaceEvaluate(**common, surface=surface),
                promotes_inputs=[SURFACE_CONTROL_POINTS],
            )
        for measure in measures:
            number = next(n for n, surface in enumerate(surfaces, start=1) if surface is measure.surface)
            name, component = f"measure_{measure.name}", SurfaceMeasure(measure=measure)
            if number == 1:
                self._add(name, component)
            else:
                self.add_subsystem(name, component, promotes_outputs=[measure.name])
                self.connect(f"evaluate_surface_{number}.{SURFACE}", f"{name}.{SURFACE}")

    def _require_names(self, names: list[str]) -> None:
        """Refuse names of measures that are taken."""
        parametrization = self.options["parametrization"]
        variables = [] if parametrization is None else [variable.name for variable in parametrization.variables]
        twice = [name for n, name in enumerate(names) if name in names[:n] or name in variables or name in ALL_NAMES]
        if twice:
            raise InputError(
                f"{self.msginfo}: the name '{twice[0]}' of a measure is taken; give it another one with name=..."
            )

    def _mover(self) -> Mover:
        """The user's mover, or rotations, in a frame that follows the surface if requested."""
        mover, model = self._mover_of_options(), self.options["model"]
        if self.options["comoving"] and not model.carries_all:
            raise InputError(
                f"{self.msginfo}: comoving=True moves the outer boundary, and the outer boundary of {model.source} "
                f"stays; leave it out"
            )
        return ComovingFrame(mover) if self.options["comoving"] else mover

    def _mover_of_options(self) -> Mover:
        """The user's mover, or rotations."""
        model, mover, parametrization = (self.options[name] for name in ("model", "mover", "parametrization"))
        if self._moves_nodes:
            parametrization, patches = None, sorted(set(self.options["surface"].patches))
            mover = mover or default_mover(model, moving_mesh(model, patches))
        if mover is None and parametrization is None:
            return default_mover(model, moving_mesh(model))
        whose = "parametrization" if mover is None else "mover"
        mesh = parametrization.mesh if mover is None else mesh_of(mover, self.msginfo)
        require_mesh_of(model, mesh, f"{self.msginfo}: the {whose}'s mesh")
        mover = mover or default_mover(model, mesh)
        if parametrization is not None and not np.array_equal(mesh.surface_ids, parametrization.mesh.surface_ids):
            raise InputError(
                f"{self.msginfo}: the mover and the parametrization have different design surfaces; "
                f"make both with the same moving_mesh(model)"
            )
        return mover
