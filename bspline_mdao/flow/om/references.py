"""Options of every flow: reference area and chord, and reference point of moments."""

from __future__ import annotations

from openmdao.utils.options_dictionary import OptionsDictionary

__all__ = ["REFERENCES", "declare_references"]

REFERENCES = ("reference_area", "reference_chord", "moment_reference")
"""Options that a group around the forces passes on."""


def declare_references(options: OptionsDictionary) -> None:
    """Declare the options `REFERENCES`."""
    options.declare("reference_area", default=None, desc="of what the grid shows, m**2")
    options.declare("reference_chord", default=1.0, desc="for moments, m")
    options.declare("moment_reference", default=(0.0, 0.0, 0.0), desc="point that moments are about, m")
