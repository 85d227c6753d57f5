"""Options and outputs of every flow: reference area and chord, the point of the moments, and the coefficients."""

from __future__ import annotations

import openmdao.api as om

from ...flow.section_loads import SECTION_LOADS

__all__ = ["COEFFICIENTS", "REFERENCES", "declare_coefficients", "declare_references"]

COEFFICIENTS = {
    "CL": None,
    "CD": None,
    "CM": None,
    "CD_induced": None,
    "CM_bending": None,
    "span_load": "m",
    **{name: "m" if name in ("strip_span", "strip_chord") else None for name in SECTION_LOADS},
}
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
        component.add_output(name, shape=shape, units=units)
