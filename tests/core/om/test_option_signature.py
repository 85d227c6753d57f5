"""Signatures show the options of components, groups and drivers."""

import inspect
from importlib import import_module
from pathlib import Path

import pytest
import tomlkit
from openmdao.core.component import Component
from openmdao.core.driver import Driver
from openmdao.core.explicitcomponent import ExplicitComponent
from openmdao.core.group import Group

from bspline_mdao import EulerFlow

PROJECT = tomlkit.parse((Path(__file__).parents[3] / "pyproject.toml").read_text()).unwrap()["project"]
ENTRIES = [
    place for kind in ("component", "group", "driver") for place in PROJECT["entry-points"][f"openmdao_{kind}"].values()
]


def options_of_openmdao(kind):
    """Names of the options that the class of OpenMDAO has which a class derives from."""
    base = next(base for base in (Group, ExplicitComponent, Component, Driver) if issubclass(kind, base))
    return set(base().options._dict)


@pytest.mark.parametrize("place", ENTRIES)
def test_signatures_list_exactly_the_declared_options_with_their_defaults(place):
    module, _, name = place.partition(":")
    kind = getattr(import_module(module), name)
    shown = dict(inspect.signature(kind).parameters)
    assert shown.pop("options").kind is inspect.Parameter.VAR_KEYWORD
    declared = {name for name in kind().options._dict if name != "model_in_records"} - options_of_openmdao(kind)
    assert set(shown) == declared
    options = kind().options
    for name, parameter in shown.items():
        if parameter.default is inspect.Parameter.empty:
            with pytest.raises(RuntimeError, match="required"):
                options[name]
        else:
            assert options[name] is parameter.default or options[name] == parameter.default


def test_a_class_of_a_user_shows_what_it_adds():
    class MyFlow(EulerFlow):
        def initialize(self):
            super().initialize()
            self.options.declare("cruise", default=0.8)

    shown = inspect.signature(MyFlow).parameters
    assert shown["cruise"].default == 0.8
    assert set(shown) == {*inspect.signature(EulerFlow).parameters, "cruise"}
