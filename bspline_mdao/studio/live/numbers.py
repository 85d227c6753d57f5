"""Numbers of a shape besides its cells: thickness of sections, and lift by a vortex lattice if it is a wing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import openmdao.api as om

from ...base.display import OneLine
from ...core.measures.section_thickness import SectionThickness
from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...flow.om.lattice_flow import LatticeLift, lattice_camber
from ..study.draft_body import ALPHA, MACH, GridBody

__all__ = ["STATIONS", "Lift", "Thickness"]

STATIONS = (0.2, 0.5, 0.8)
"""Fractions of the span at which sections are measured."""


@dataclass(frozen=True, eq=False)
class Thickness(OneLine):
    """Largest thickness-to-chord ratio of some sections."""

    names: tuple[str, ...]  # of the sections
    rows: np.ndarray  # int (n,), rows of the nodes of the wall
    measure: SectionThickness | None  # None if nothing can be measured
    why_not: str = ""  # why

    @classmethod
    def of(cls, surface: SurfaceGrid) -> Thickness:
        """Measure a wing at `STATIONS`, a section in its middle."""
        stations: Sequence[float] | None = None if surface.is_section else STATIONS
        names = ("section",) if stations is None else tuple(f"{100.0 * part:.0f} % of the span" for part in stations)
        try:
            return cls(names, surface.rows, SectionThickness.at(surface, stations))
        except InputError as error:
            return cls((), surface.rows, None, str(error))

    def at(self, nodes: np.ndarray) -> np.ndarray:
        """Thickness-to-chord ratios with the nodes of the grid (m), shape (n_nodes, 3)."""
        return np.zeros(0) if self.measure is None else self.measure.evaluate(nodes[self.rows])


@dataclass(frozen=True, eq=False)
class Lift(OneLine):
    """Lift coefficient of a half wing at one flow condition, by the area of its baseline."""

    rows: np.ndarray  # int (n,), rows of the nodes of the walls
    lattice: LatticeLift | None  # None if the walls are no wing, or OpenAeroStruct is missing
    why_not: str = ""  # why
    alpha: float = ALPHA  # angle of attack (deg)
    mach: float = MACH

    @classmethod
    def of(cls, model: FittedModel) -> Lift:
        """Fit a lattice to the walls of a model."""
        try:
            body = GridBody(model.regenerate(), model.topology)
            why_not = body.why_no_lattice or ("" if body.is_thin else "the walls are not thin")
            if not why_not and not find_spec("openaerostruct"):
                why_not = 'it needs OpenAeroStruct: pip install "bspline_mdao[vlm]"'
            if why_not:
                return cls(np.zeros(0, dtype=int), None, why_not)
            camber = lattice_camber(body.surface, body.axes or "")
            return cls(body.surface.rows, LatticeLift(camber, body.area, ALPHA, MACH))
        except InputError as error:
            return cls(np.zeros(0, dtype=int), None, str(error))

    def at(self, nodes: np.ndarray) -> float | None:
        """Lift coefficient with the nodes of the grid (m), shape (n_nodes, 3); None without a lattice."""
        if self.lattice is None:
            return None
        try:
            return self.lattice.at(nodes[self.rows])
        except om.AnalysisError:  # the lattice is folded
            return None
