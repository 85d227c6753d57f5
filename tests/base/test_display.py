"""What users print: one line for everything that is public, and for everything that it hands out."""

import inspect
import re
import sys
from dataclasses import dataclass, fields, is_dataclass

import numpy as np
import pytest

import bspline_mdao
from bspline_mdao.base.display import OneLine

TOP = [getattr(bspline_mdao, name) for name in bspline_mdao.__all__]
SPACES = [space for space in TOP if inspect.ismodule(space) and not space.__name__.endswith(("plotting", "testing"))]
PUBLIC = [thing for space in [bspline_mdao, *SPACES] for name in space.__all__
          if not inspect.ismodule(thing := getattr(space, name))]  # fmt: skip


def annotations_of(thing):
    """What the fields, properties and methods of a class are said to be or to return, or what a function returns."""
    if not inspect.isclass(thing):
        return [thing.__annotations__.get("return")]
    hints = list(inspect.get_annotations(thing).values())
    for name, value in vars(thing).items():
        if not name.startswith("_"):
            function = getattr(value, "fget", None) or getattr(value, "func", None) or value
            function = getattr(function, "__func__", function)
            hints.append(getattr(function, "__annotations__", {}).get("return"))
    return hints


def handed_out(thing):
    """Classes of this package that a public name hands out, its bases' methods included."""
    found = set()
    for owner in thing.__mro__ if inspect.isclass(thing) else [thing]:
        if getattr(owner, "__module__", "").partition(".")[0] == "bspline_mdao":
            scope = vars(sys.modules[owner.__module__])
            hints = [hint for hint in annotations_of(owner) if isinstance(hint, str)]
            found |= {scope.get(word) for hint in hints for word in re.findall(r"\w+", hint)}
    return {kind for kind in found if inspect.isclass(kind) and kind.__module__.startswith("bspline_mdao")}


PRINTED = sorted(
    {kind for thing in PUBLIC for kind in {thing, *handed_out(thing)} if inspect.isclass(kind) and is_dataclass(kind)},
    key=lambda kind: (kind.__module__, kind.__name__),
)
AS_FIELDS = [kind for kind in PRINTED if kind.__repr__ is OneLine.__repr__]


def filled(kind, value):
    """Make an object of which all fields hold a value, whatever they should be."""
    new = object.__new__(kind)
    for item in fields(kind):
        object.__setattr__(new, item.name, value)
    return new


def test_what_is_public_is_walked():
    names = {kind.__name__ for kind in PRINTED}
    assert names > {"Twist", "Lattice", "LinearElasticity", "Thickness", "EnclosedVolume", "DesignSurface", "Partition"}
    assert names > {"FitReport", "GridHeader", "Improvement", "MovementReport", "QualityReport", "ErrorEstimate"}


@pytest.mark.parametrize("kind", PRINTED, ids=lambda kind: kind.__name__)
def test_what_is_public_prints_as_one_line(kind):
    assert issubclass(kind, OneLine), "derive it from bspline_mdao.base.display.OneLine"


@pytest.mark.parametrize("kind", AS_FIELDS, ids=lambda kind: kind.__name__)
def test_arrays_lists_and_long_texts_do_not_lengthen_the_line(kind):
    for value in (
        np.zeros((400, 3)),
        list(range(400)),
        {"a": np.zeros(400)},
        "text\n" * 400,
        filled(Case, np.zeros(9)),
    ):
        line = repr(filled(kind, value))
        assert line.startswith(f"{kind.__name__}(")
        assert len(line) <= 120
        assert "\n" not in line


@dataclass(frozen=True)
class Case(OneLine):
    x: float
    points: np.ndarray
    name: str = "a"


class LaterCase(Case):
    pass


@dataclass(frozen=True)
class OwnCase(Case):
    def __repr__(self):
        return "mine"


@dataclass(frozen=True)
class OfOwnCase(OwnCase):
    y: int = 1


def test_a_dataclass_keeps_the_line_and_one_of_its_own_or_of_its_base():
    assert repr(Case(np.float64(1.23456), np.zeros((7, 3)))) == "Case(x=1.235, points=array(7, 3), name='a')"
    assert repr(LaterCase(1.0, np.array([1.0, 2.0]))) == "LaterCase(x=1, points=[1, 2], name='a')"
    assert repr(OwnCase(1.0, np.zeros(2))) == repr(OfOwnCase(1.0, np.zeros(2))) == "mine"
