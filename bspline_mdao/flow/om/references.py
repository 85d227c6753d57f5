"""Options of every flow: reference area and chord, and reference point of moments."""

from __future__ import annotations

import warnings

import numpy as np
from openmdao.utils.options_dictionary import OptionsDictionary

from ...errors import ReferenceWarning
from ..loads.force_coefficients import seen_areas

__all__ = ["REFERENCES", "declare_references", "warn_of_area"]

_AREA_FACTOR = 8.0
"""How far a reference area may be from the walls' as seen from above: square feet are 10.8 in a square metre."""

_BODY_FACTOR = 1000.0
"""The same for walls that may be no wing's: a slender missile's cross section is 20 times smaller than its side, the
walls of a wind tunnel are 100 times larger than the wing, and square inches are 1550 in a square metre."""

REFERENCES = ("reference_area", "reference_chord", "moment_reference")
"""Options that a group around the forces passes on."""


def declare_references(options: OptionsDictionary) -> None:
    """Declare the options `REFERENCES`."""
    options.declare("reference_area", default=None, desc="of what the grid shows, m**2")
    options.declare("reference_chord", default=1.0, desc="for moments, m")
    options.declare("moment_reference", default=(0.0, 0.0, 0.0), desc="point that moments are about, m")


def warn_of_area(
    path: str,  # what the options belong to, for the message
    area: float,  # reference area (m^2)
    areas: np.ndarray,  # (n, 3), area vectors of the faces of the walls (m^2)
    up: np.ndarray | None = None,  # (3,), direction up of a wing; None for a body of any shape
) -> None:
    """Warn of a reference area in another unit than the grid, or of axes that see no wall of a wing from above."""
    views = seen_areas(areas, np.eye(3) if up is None else up[None])
    seen, factor = float(views.max()), _BODY_FACTOR if up is None else _AREA_FACTOR
    whence = "from the side with the largest area" if up is None else "from above"
    if (seen or up is not None) and not seen / factor < area < factor * seen:
        warnings.warn(
            f"{path or 'flow'}: the reference area is {area:.4g} m^2, and the walls as seen {whence} have {seen:.3g} "
            f"m^2; check its unit, which is the grid's, and the axes",
            ReferenceWarning,
            stacklevel=2,
        )
