"""OpenFOAM as the aerodynamic solver of MPhys' scenarios."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import openmdao.api as om

from ....core.mesh.surface import SurfaceGrid
from ....core.model.movable import Movable
from ....core.movement.mover import Mover
from ..openfoam_flow import OpenFoamFlow
from .builders import FlowBuilder

__all__ = ["OpenFoamBuilder"]

SOUND = 340.294
"""Speed of sound in the standard atmosphere at sea level (m/s)."""

RESULTS = dict.fromkeys(("CL", "CD", "CM", "Cp", "Cf", "y_plus", "n_iterations"))
"""Outputs of `OpenFoamFlow`; none has a unit."""


class OpenFoamBuilder(FlowBuilder):
    """A solver of OpenFOAM as the aerodynamic solver of scenarios, each in a folder of its own.

    MPhys provides Mach numbers: the speed of an incompressible case is the Mach number times 340.294 m/s. Derivatives
    are as in `OpenFoamFlow`: none by default.

    Parameters
    ----------
    model : FittedModel or MeshModel
        The fitted grid, or an unstructured mesh.
    folder : path-like
        Folder for the cases, each in a subfolder with the name of its scenario.
    surface : SurfaceGrid, optional
        The design surface; all walls by default.
    mover : Mover, optional
        Moves the control mesh; by default the one of `GridMovement`.
    require_valid : bool
        Whether to refuse surfaces that invert cells of the grid.
    comoving : bool
        Whether everything fixed, such as the far field, follows the rigid part of the surface's motion.
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.
    **options
        Options of `OpenFoamFlow`, such as ``case`` and ``reference_area``.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import infinite_wing_grid, naca_section
    >>> from bspline_mdao.mphys import OpenFoamBuilder
    >>> model = fit_grid(infinite_wing_grid(naca_section(0.12), (17, 9)))
    >>> builder = OpenFoamBuilder(model, "section_cases", reference_area=1.0)  # options of OpenFoamFlow
    >>> builder.get_ndof()
    3
    """

    def __init__(
        self,
        model: Movable,
        folder: str | os.PathLike[str],
        *,
        surface: SurfaceGrid | None = None,
        mover: Mover | None = None,
        require_valid: bool = True,
        comoving: bool = False,
        generation: int | None = None,
        **options: Any,
    ):
        self._folder, self._options = Path(folder), options
        super().__init__(
            model,
            self._flow_of(None),
            surface=surface,
            results=RESULTS,
            generation=generation,
            mover=mover,
            require_valid=require_valid,
            comoving=comoving,
        )

    def _flow_of(self, scenario_name: str | None) -> Callable[[], om.Group]:
        """Maker of the flow of a scenario, in its folder."""

        def flow() -> om.Group:
            solver = OpenFoamFlow(model=self._model, folder=self._folder / (scenario_name or "flow"), **self._options)
            group = om.Group()
            case = self._options.get("case")
            if case is not None and case.speed_name == "speed":
                speed = om.ExecComp(f"speed = {SOUND} * Mach_number", speed={"units": "m/s"}, Mach_number={"val": 0.1})
                group.add_subsystem("speed", speed, promotes=["*"])
            group.add_subsystem("solver", solver, promotes=["*"])
            return group

        return flow
