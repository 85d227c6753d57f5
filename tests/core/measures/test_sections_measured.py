"""Measures of a section are one number each, whatever lies across the span."""

import numpy as np
import pytest
from geometry_cases import naca_area, rectangular_wing, section_between_planes, turned
from parametrization_cases import section_model

from bspline_mdao.errors import InputError
from bspline_mdao.measures import (
    EnclosedVolume,
    LeadingEdgeRadius,
    SectionArea,
    SectionThickness,
    SurfaceGrid,
    Thickness,
    TrailingEdgeAngle,
)

LAYERS = {2: 2, 4: 3}
"""Planes of nodes and of control points across the span."""

MEASURES = {
    "area": lambda surface: SectionArea.of(surface),
    "radius": lambda surface: LeadingEdgeRadius.at(surface),
    "angle": lambda surface: TrailingEdgeAngle.at(surface),
    "t/c": lambda surface: SectionThickness.at(surface),
}


def surface(n_planes, **options):
    places = np.linspace(0.0, 1.3, n_planes) ** 2
    return SurfaceGrid.of(section_model(tuple(places), n_control=(21, 9, LAYERS[n_planes]), **options))


@pytest.mark.parametrize("of", MEASURES.values(), ids=MEASURES)
def test_a_section_has_one_number_whatever_lies_across_its_span(of):
    numbers = [of(surface(n)).evaluate(surface(n).points) for n in LAYERS]
    assert numbers[0].shape == (1,)
    np.testing.assert_allclose(numbers[0], numbers[1], rtol=1e-6)
    one = surface(2, axes=(0, 1, 2), chord=0.6)
    lengths = {"area": 2, "radius": 1}
    power = next((lengths[name] for name, each in MEASURES.items() if each is of and name in lengths), 0)
    np.testing.assert_allclose(of(one).evaluate(one.points), (0.6 / 1.7) ** power * numbers[0], rtol=1e-6)


@pytest.mark.parametrize("n", LAYERS)
def test_thickness_of_a_section_is_one_number_for_each_part_of_the_chord(n):
    section, parts = surface(n), [0.1, 0.35, 0.6]
    thickness = Thickness.of_sections(section, parts)
    assert (thickness.shape, thickness.units) == ((3,), "m")
    of_all = Thickness.of_sections(section, parts, stations=[0.2, 0.7])
    assert of_all.shape == (2, 3)
    np.testing.assert_allclose(of_all.evaluate(section.points), thickness.evaluate(section.points) * np.ones((2, 1)))
    grown = Thickness.of_sections(section, parts, relative=True).evaluate(section.points * [1.0, 1.0, 1.2])
    np.testing.assert_allclose(grown, 1.2, rtol=1e-3)
    assert Thickness.grid(section, 4).shape == (1, 4)


def test_numbers_of_a_section_are_those_of_its_formula():
    section = turned(section_between_planes(n_chord=161, n_span=3, chord=2.0, span=0.7))
    assert section.is_section
    np.testing.assert_allclose(SectionArea.of(section).evaluate(section.points), 4.0 * naca_area(), rtol=1e-3)
    x = np.array([0.2, 0.5, 0.8])
    upper = 0.6 * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - x * 0.1036))))
    across = Thickness.of_sections(section, x).evaluate(section.points)
    np.testing.assert_allclose(across, 4.0 * upper, rtol=1e-3)
    np.testing.assert_allclose(SectionArea.of(section, relative=True).evaluate(section.points), 1.0)


def test_the_area_of_a_section_is_its_volume_by_its_span():
    section = surface(4)
    area, volume = (of(section).evaluate(section.points) for of in (SectionArea.of, EnclosedVolume.of))
    np.testing.assert_allclose(area, volume / 1.69, rtol=1e-9)
    shrunk = section.points * [0.8, 1.0, 0.9]
    relative = SectionArea.of(section, relative=True).evaluate(shrunk)
    np.testing.assert_allclose(relative, 0.72, rtol=1e-9)


def test_wings_are_no_sections_and_need_stations():
    wing = rectangular_wing()
    assert not wing.is_section
    for make in (
        SectionThickness.at,
        lambda wing: Thickness.of_sections(wing, [0.5]),
        lambda wing: Thickness.grid(wing, 3),
    ):
        with pytest.raises(InputError, match="no station is given; give fractions of the span"):
            make(wing)
    with pytest.raises(InputError, match="section_area: the surface is no section"):
        SectionArea.of(wing)
    with pytest.raises(InputError, match=r"thickness: parts \[0.0, 0.5\] of the chord; give numbers between 0 and 1"):
        Thickness.of_sections(wing, [0.0, 0.5], [0.5])
    assert len(LeadingEdgeRadius.at(wing).stations) == 5
