"""The outputs of flows: the table that components, builders, error estimates, studies, reports and pages read.

To add a functional, add its row to `FUNCTIONALS` and its computation, with derivatives, to the kernels: in
`.loads.wing_coefficients` for functions of the forces on a wing, in any flow, in `.euler.forces` for functions of the
states of all cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["FUNCTIONALS", "OF_SECTION", "Functional", "numbers", "of_flow"]

FlowKind = Literal["euler", "lattice"]
"""`EulerFlow`, or `LatticeFlow`."""

EULER: tuple[FlowKind, ...] = ("euler",)
LATTICE: tuple[FlowKind, ...] = ("lattice",)


@dataclass(frozen=True)
class Functional:
    """An output of a flow. Scalar ones have error estimates, and are objectives of studies."""

    kind: Literal["lift", "drag", "moment", "load", "pressure"]
    meaning: str  # for the documentation of the outputs
    kernel: str  # key in `KERNELS` of its computation; the flow itself has its pressures
    # number of values: one, one for each axis of the grid, strip of the wing, face of a wall, or panel
    extent: Literal["number", "axes", "strips", "faces", "panels"] = "number"
    units: str | None = None
    flows: tuple[FlowKind, ...] = EULER + LATTICE  # flows that have it
    of_wings: bool = False  # whether it has no meaning for a section, whose flow has no trailing vortices

    @property
    def is_number(self) -> bool:
        """Whether it is a scalar, so that it has an adjoint and hence an error estimate."""
        return self.extent == "number"


FUNCTIONALS = {
    "CL": Functional("lift", "lift of the pressures", "forces"),
    "CD": Functional("drag", "drag of the pressures", "forces"),
    "CD_induced": Functional("drag", "induced drag from the wake far downstream", "wake", of_wings=True),
    "CD_entropy": Functional("drag", "drag of the entropy that leaves through the far field", "entropy", flows=EULER),
    "CM": Functional(
        "moment",
        'moments about the axes x, y and z of the grid through the reference point; with ``axes="xzy"`` a positive '
        "third one turns the nose down",
        "forces",
        "axes",
    ),
    "CM_bending": Functional(
        "moment",
        "moment that bends the wing up at its plane of symmetry, about an axis downstream through span 0 at the height "
        "of the moment reference; the sum for both halves of a whole wing",
        "bending",
        of_wings=True,
    ),
    "span_load": Functional(
        "load", "chord times lift coefficient of every strip of the wing, from the tip", "wake", "strips", "m"
    ),
    "strip_span": Functional("load", "distance of the middle of every strip from span 0", "sections", "strips", "m"),
    "strip_chord": Functional("load", "its chord, from leading to trailing edge", "sections", "strips", "m"),
    "strip_cl": Functional(
        "load",
        "its lift, by its chord and width; ``strip_chord`` times ``strip_cl`` is ``span_load``",
        "sections",
        "strips",
    ),
    "strip_cd": Functional("load", "its drag of the pressures, by its chord and width", "sections", "strips"),
    "strip_cm": Functional("load", "its moment about the quarter chord, positive nose up", "sections", "strips"),
    "Cp": Functional("pressure", "pressure coefficients on the wall faces", "pressure", "faces", flows=EULER),
    "delta_Cp": Functional(
        "pressure",
        "pressure coefficient below less that above every panel, see `panel_pressures`",
        "pressure",
        "panels",
        flows=LATTICE,
    ),
}
"""The available functionals, by name."""


OF_SECTION = "CL, CD and CM are section coefficients, cl, cd and cm: per unit of span"
"""Remark on these for walls that are the same from one plane of symmetry to another."""


def of_flow(flow: FlowKind) -> dict[str, Functional]:
    """The functionals of one flow."""
    return {name: functional for name, functional in FUNCTIONALS.items() if flow in functional.flows}


def numbers(flow: FlowKind, *kinds: str, is_section: bool = False) -> tuple[str, ...]:
    """Names of the scalar functionals of one flow, optionally only of given kinds, and those that a section has."""
    found = [(name, each) for name, each in of_flow(flow).items() if not (is_section and each.of_wings)]
    return tuple(name for name, each in found if each.is_number and (not kinds or each.kind in kinds))
