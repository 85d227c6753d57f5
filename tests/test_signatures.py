"""Signatures that editors read are what the options of components, groups and drivers give."""

import ast
import importlib.util
import inspect
import sys
import textwrap
import typing
from numbers import Integral, Real
from pathlib import Path

import pytest
from openmdao.utils.options_dictionary import _UNDEFINED

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))

from write_signatures import KINDS, lines, public_classes, write, written  # noqa: E402

pytestmark = pytest.mark.slow  # all that is public is imported


def texts(kind):
    """What stands in the source of a class, and what its options give."""
    node, now = written(kind), ast.parse(textwrap.dedent("\n".join(lines(kind))))
    return node and ast.unparse(node), ast.unparse(now)


def test_the_signatures_are_what_the_options_give():
    old = [kind.__name__ for kind in public_classes() if len({*texts(kind)}) == 2]
    assert old == [], "run python tools/write_signatures.py"


def leaves(hint):
    """Classes that an annotation allows."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        return tuple(type(value) for value in arguments)
    if origin in (typing.Union, type(int | str)):
        return tuple(leaf for argument in arguments for leaf in leaves(argument))
    return (origin or hint,)


def test_editors_see_the_names_types_and_defaults_of_the_options():
    n_options = 0
    for kind in public_classes():
        namespace = dict(vars(sys.modules[kind.__module__]))
        exec(ast.unparse(ast.Module(written(kind).body, [])), namespace)
        seen = inspect.signature(namespace["__init__"]).parameters
        hints = typing.get_type_hints(namespace["__init__"], namespace)
        shown = inspect.signature(kind).parameters
        assert [*seen] == ["self", *shown], kind
        for name, about in kind().options._dict.items():
            if name not in seen:
                continue  # one of OpenMDAO's
            n_options += 1
            assert seen[name].kind is inspect.Parameter.KEYWORD_ONLY
            assert seen[name].default == (inspect.Parameter.empty if about["val"] is _UNDEFINED else about["val"])
            types = about["types"] if isinstance(about["types"], tuple) else [about["types"]] * bool(about["types"])
            types = [{Real: float, Integral: int}.get(type_, type_) for type_ in types]
            values = [] if about["val"] is _UNDEFINED else [type(about["val"])]
            allowed = tuple(leaf for leaf in leaves(hints[name]) if not getattr(leaf, "_is_protocol", False))
            allowed += (int,) * (float in allowed)
            for type_ in (*types, *values, *([type(None)] if about["allow_none"] else [])):
                assert issubclass(type_, allowed), (kind, name, type_)
    assert n_options > 100


def test_a_signature_is_written_once_and_follows_the_options(tmp_path, monkeypatch):
    source = '''
    from typing import TYPE_CHECKING, Any
    import openmdao.api as om
    from bspline_mdao.core.om.model_option import Copied

    class Part(Copied, om.ExplicitComponent):
        """A part."""

        def initialize(self):
            self.options.declare("size", types=int, lower=1)
            self.options.declare("kind", values=("thin", "thick"), default="thin")
            self.options.declare("factor", default=1.5)
    '''
    path = tmp_path / "part_to_sign.py"

    def loaded(text):
        path.write_text(text)
        spec = importlib.util.spec_from_file_location("part_to_sign", path)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "part_to_sign", module)
        spec.loader.exec_module(module)
        return module.Part

    Part = loaded(textwrap.dedent(source))
    for _ in range(2):
        write(Part)
        found, now = texts(Part)
        assert found == now
    assert "size: int, kind: Literal['thin', 'thick']='thin', factor: float=1.5, **options: Any" in found
    assert path.read_text().count("TYPE_CHECKING:") == 1

    Part = loaded(path.read_text().replace("default=1.5", "types=(int, float), default=2"))
    assert len({*texts(Part)}) == 2
    write(Part)
    assert "factor: int | float=2" in texts(Part)[0]

    Part = loaded(path.read_text().replace("types=(int, float), default=2", "recordable=False"))
    with pytest.raises(SystemExit, match="Part: nothing tells the type of the option 'factor'"):
        write(Part)


def test_types_that_are_written_by_hand_are_those_of_options():
    names = {name for kind in public_classes() for name in inspect.signature(kind).parameters}
    names |= {f"{kind.__name__}.{name}" for kind in public_classes() for name in inspect.signature(kind).parameters}
    assert set(KINDS) <= names
