"""Variables that change a shape, one slider each: deformations by name, as in ``move --deform``."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from ...core.design.named_deformations import parse_deformation, parse_requests
from ...core.mesh.moving_mesh import MovingMesh
from ...core.model.fitted_model import FittedModel
from ...errors import InputError

__all__ = ["Slider", "asked_slider", "sliders_of", "words_of"]

ANGLES = {"twist", "sweep", "dihedral", "pitch", "bend", "rotate"}
"""Deformations by an angle; 0 deg has no effect."""

FACTORS = {"stretch", "chord", "thickness", "radius", "axial"}
"""Deformations by a factor; 1 has no effect."""

_TRIED = 1e-3
"""Fraction of its range at which a variable is tried before it gets a slider."""


@dataclass(frozen=True)
class Slider:
    """One variable and its range."""

    name: str  # of the deformation
    label: str  # label on the page
    low: float
    high: float
    neutral: float  # value that changes nothing
    unit: str = ""  # deg or m, or none
    place: str = ""  # what follows the value in the words: ``@0.7,length=0.2``

    @property
    def step(self) -> float:
        """Step of the slider: a power of ten that divides its range into 60 steps or more."""
        return 10.0 ** math.floor(math.log10((self.high - self.low) / 60.0))

    def words(self, value: float) -> str:
        """Write a value in the words of ``move --deform``."""
        return f"{self.name}={value:.10g}{self.unit}{self.place}"


OF_WINGS = (
    Slider("thickness", "thickness", 0.6, 1.6, 1.0),
    Slider("chord", "chord", 0.7, 1.4, 1.0),
    Slider("twist", "twist at the tip", -12.0, 12.0, 0.0, "deg"),
    Slider("sweep", "sweep", -20.0, 20.0, 0.0, "deg"),
    Slider("dihedral", "dihedral", -20.0, 20.0, 0.0, "deg"),
    Slider("stretch", "span", 0.7, 1.5, 1.0),
)
"""Sliders of a wing, in the order in which deformations are applied."""

OF_SECTIONS = (*OF_WINGS[:2], Slider("pitch", "pitch", -10.0, 10.0, 0.0, "deg"))
"""Sliders of a section that is the same along the span."""


def sliders_of(model: FittedModel, mesh: MovingMesh, is_section: bool, asked: Sequence[str] = ()) -> tuple[Slider, ...]:
    """Find the variables of a shape: those a wing or a section can follow, and the requested ones."""
    usual = OF_SECTIONS if is_section else OF_WINGS
    return (*(each for each in usual if _is_followed(each, model, mesh)), *(asked_slider(text) for text in asked))


def _is_followed(slider: Slider, model: FittedModel, mesh: MovingMesh) -> bool:
    """Whether the surface can be deformed so: it has a span, and stays in its planes of symmetry."""
    value = slider.neutral + _TRIED * (slider.high - slider.low)
    try:
        parse_deformation(slider.words(value), model, mesh).apply(model.control_points[mesh.surface_ids])
    except InputError:
        return False
    return True


def asked_slider(text: str) -> Slider:
    """Make a slider of one deformation, which is its end; the range goes as far to the other side of no effect.

    Examples
    --------
    >>> slider = asked_slider("bend=60deg@0.7")
    >>> slider.low, slider.high, slider.words(12.5)
    (-60.0, 60.0, 'bend=12.5deg@0.7')
    """
    requests = parse_requests(text)
    if len(requests) != 1 or requests[0].name not in ANGLES | FACTORS:
        names = ", ".join(sorted(ANGLES | FACTORS))
        raise InputError(f"deformation '{text}': a slider takes one deformation by an angle or a factor: {names}")
    name, place = requests[0].name, text[text.index(requests[0].value) + len(requests[0].value) :].strip()
    label = f"{name} {place.lstrip('@')}".strip()
    if name in ANGLES:
        end = abs(float(re.sub("(deg)$", "", _degrees(requests[0].value, text))))
        if not end:
            raise InputError(f"deformation '{text}': no angle to go to; give the end of the slider")
        return Slider(name, label, -end, end, 0.0, "deg", place)
    end = requests[0].number(low=0.0)
    if end == 1.0:
        raise InputError(f"deformation '{text}': the factor 1 does nothing; give the end of the slider")
    return Slider(name, label, min(end, 1.0 / end), max(end, 1.0 / end), 1.0, "", place)


def _degrees(value: str, text: str) -> str:
    if value.endswith("rad"):
        raise InputError(f"deformation '{text}': give the angle in degrees")
    return value


def words_of(sliders: Sequence[Slider], values: Sequence[float]) -> str:
    """Write values in the words of ``move --deform``; empty if all are neutral."""
    return "+".join(each.words(value) for each, value in zip(sliders, values) if value != each.neutral)
