"""Variables that a shape is changed by, one slider for each: deformations by name, as ``move --deform`` has them."""

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
"""Deformations by an angle, of which 0 deg does nothing."""

FACTORS = {"stretch", "chord", "thickness", "radius", "axial"}
"""Deformations by a factor, of which 1 does nothing."""

_TRIED = 1e-3
"""Part of its range that a variable is tried with before it gets a slider."""


@dataclass(frozen=True)
class Slider:
    """One variable and its range."""

    name: str  # of the deformation
    label: str  # what it says on the page
    low: float
    high: float
    neutral: float  # value that changes nothing
    unit: str = ""  # deg or m, or none
    place: str = ""  # what follows the value in the words: ``@0.7,length=0.2``

    @property
    def step(self) -> float:
        """What the slider moves by: a power of ten, by which its range has 60 steps or more."""
        return 10.0 ** math.floor(math.log10((self.high - self.low) / 60.0))

    def words(self, value: float) -> str:
        """Say a value as ``move --deform`` has it."""
        return f"{self.name}={value:.10g}{self.unit}{self.place}"


OF_WINGS = (
    Slider("thickness", "thickness", 0.6, 1.6, 1.0),
    Slider("chord", "chord", 0.7, 1.4, 1.0),
    Slider("twist", "twist at the tip", -12.0, 12.0, 0.0, "deg"),
    Slider("sweep", "sweep", -20.0, 20.0, 0.0, "deg"),
    Slider("dihedral", "dihedral", -20.0, 20.0, 0.0, "deg"),
    Slider("stretch", "span", 0.7, 1.5, 1.0),
)
"""Sliders of a wing, in the order in which deformations are done."""

OF_SECTIONS = (*OF_WINGS[:2], Slider("pitch", "pitch", -10.0, 10.0, 0.0, "deg"))
"""Sliders of a section, which is the same all along the span."""


def sliders_of(model: FittedModel, mesh: MovingMesh, is_section: bool, asked: Sequence[str] = ()) -> tuple[Slider, ...]:
    """Find the variables of a shape: those of a wing or a section that it can follow, and those that are asked for."""
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
    """Make a slider of one deformation, which is its end: to both sides of nothing, as far as it goes.

    Examples
    --------
    >>> slider = asked_slider("bend=60deg@0.7")
    >>> slider.low, slider.high, slider.words(12.5)
    (-60.0, 60.0, 'bend=12.5deg@0.7')
    """
    requests = parse_requests(text)
    if len(requests) != 1 or requests[0].name not in ANGLES | FACTORS:
        names = ", ".join(sorted(ANGLES | FACTORS))
        raise InputError(f"deformation '{text}': a slider is of one deformation by an angle or a factor: {names}")
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
    """Say values as ``move --deform`` has them; empty where all are neutral."""
    return "+".join(each.words(value) for each, value in zip(sliders, values) if value != each.neutral)
