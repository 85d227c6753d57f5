"""Trees of Python and their text: values are values, whatever is in them, and lines are readable."""

import ast
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bspline_mdao.studio.study.layout import WIDTH, python_text
from bspline_mdao.studio.study.syntax import call, expression, literal, statement

TEXTS = st.text(max_size=30) | st.sampled_from(
    ['"""', "'''\n", "\\", '\\"', "a\\unit.h5", "{x}", "\ud800", "# ", "\x00"]
)
PLAIN = TEXTS | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.booleans() | st.none()
VALUES = st.recursive(PLAIN, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3))


@given(VALUES)
@example('"""\n__import__("os").system("touch ran")\n"""')
@example("a,  b (c, d],   e" + 200 * ", x")
@example([-0.0, -1, 10**400])
def test_a_value_is_read_back_from_a_script_as_it_was(value):
    text = python_text([statement("found = made", made=call("made_of", value, first=value))])
    (assigned,) = ast.parse(text).body
    found = assigned.value
    assert repr(ast.literal_eval(found.args[0])) == repr(value)
    assert repr(ast.literal_eval(found.keywords[0].value)) == repr(value)


@given(st.text(max_size=60))
@example("a=1, b")
@example("__import__('os').system('touch ran') or x")
def test_the_name_of_a_setting_is_a_name(name):
    try:
        made = call("made_of", **{name: 1.0})
    except ValueError:
        assert not name.isidentifier()
        return
    assert [keyword.arg for keyword in made.keywords] == [name]


@pytest.mark.parametrize("value", [math.nan, math.inf, object(), b"bytes", 1j, [math.nan], {"a": {1}}])
def test_what_python_does_not_write_is_no_value(value):
    with pytest.raises((TypeError, ValueError), match="cannot be written as Python"):
        literal(value)


def test_a_script_that_would_say_something_else_is_none():
    with pytest.raises((SyntaxError, ValueError)):
        python_text([statement("found = made", made=call("made_of", **{"lambda": 1.0}))])
    with pytest.raises(ValueError, match="does not say what it is to say"):
        python_text([ast.Expr(ast.Name("a + b"))])
    with pytest.raises(ValueError, match="is no function"):
        call("lambda: x")


LONG = """\
table = {
    "one": {"a": 1.0},
    "two": {},
}
many = [
    made(1),
]
few = [1, 2.5, "three"]
for name, values in table.items():
    if name in few:
        found = made_of(
            name,
            HERE / "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
            settings={
                "quoted": "say \\"so\\"",
                "backslash": "a\\\\unit.h5",
                "far": (1, 2, "bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb"),
            },
            of=f"{name}.x",
        )
"""


def test_long_lines_are_cut_at_brackets_and_never_inside_texts():
    tree = ast.parse(LONG)
    assert python_text(tree.body) == LONG
    assert max(map(len, LONG.splitlines())) < WIDTH
    folded = python_text([statement("x = made", made=[f"a, ({'b' * 40}], {n}" for n in range(5)])])
    assert folded.splitlines()[1] == f'    "a, ({"b" * 40}], 0",'


def test_comments_and_blank_lines_stay_where_they_are():
    text = python_text(["# first", statement("a = 1"), "", "import os\n", statement("b = x", x=expression("a"))])
    assert text == "# first\na = 1\n\nimport os\n\nb = a\n"
