"""Options and outputs of every flow: reference area and chord, the point of the moments, and the coefficients."""

from __future__ import annotations

import openmdao.api as om

from ..loads.section_loads import SECTION_LOADS

__all__ = ["COEFFICIENTS", "REFERENCES", "declare_coefficients", "declare_references"]

_DESCRIPTIONS = {
    "CL": "lift",
    "CD": "drag of the pressures on the walls",
    "CM": "moments about x, y and z of the grid",
    "CD_induced": "induced drag from the wake far downstream",
    "CM_bending": "moment that bends the wing up at its root",
    "span_load": "chord times lift coefficient of every strip, from the tip",
    **dict(
        zip(
            SECTION_LOADS,
            (
                "distance of the middle of every strip from span 0",
                "chord of every strip",
                "lift of every strip",
                "drag of the pressures of every strip",
                "moment of every strip about its quarter chord, nose up",
            ),
        )
    ),
}

COEFFICIENTS = {name: "m" if name in ("span_load", "strip_span", "strip_chord") else None for name in _DESCRIPTIONS}
"""Units of what every flow about a wing has as outputs, by name."""

REFERENCES = ("reference_area", "reference_chord", "moment_reference")
"""Options that a group around the forces hands on."""


def declare_references(options) -> None:
    """Declare the options `REFERENCES`."""
    options.declare("reference_area", default=None, desc="of what the grid shows, m**2")
    options.declare("reference_chord", default=1.0, desc="for moments, m")
    options.declare("moment_reference", default=(0.0, 0.0, 0.0), desc="point that moments are about, m")


def declare_coefficients(component: om.Component, n_strips: int) -> None:
    """Add the outputs `COEFFICIENTS` of a wing with so many strips."""
    for name, units in COEFFICIENTS.items():
        shape = 3 if name == "CM" else n_strips if name.startswith(("span", "strip")) else 1
        component.add_output(name, shape=shape, units=units, desc=_DESCRIPTIONS[name])
