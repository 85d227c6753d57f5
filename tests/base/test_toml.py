"""Text of TOML files: what is wrong is one line that names the place."""

import pytest

from bspline_mdao import InputError
from bspline_mdao.base.toml import parse_toml

OPEN = "a string is not closed at line 2 col 12"


@pytest.mark.parametrize("end", ["", "\n", "\r\n", "\nnext = 1\n"])
@pytest.mark.parametrize("line", ['wing = "wall', "wing = 'wall", 'w = ["a", "b', "'wing = wall"])
def test_a_string_that_is_not_closed_is_said_to_be_and_where(line, end):
    with pytest.raises(InputError) as error:
        parse_toml(f"[kinds]\n{line}{end}", "kinds.toml")
    assert str(error.value) == f"kinds.toml: line 2: is not TOML ({OPEN})"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('a = "b\x01c"\n', "line 1: is not TOML (Control characters"),
        ("a = 1\nb = = 2", "line 2: is not TOML (Unexpected character"),
        ("a = 1\na = 2\n", 'line 3: is not TOML (Key "a" already exists'),
    ],
)
def test_other_faults_have_the_message_of_the_parser(text, reason):
    with pytest.raises(InputError) as error:
        parse_toml(text, "study.toml")
    assert str(error.value).startswith(f"study.toml: {reason}")


def test_a_file_without_a_line_end_is_read():
    assert parse_toml("[kinds]\nwing = 'wall'", "kinds.toml") == {"kinds": {"wing": "wall"}}
    assert parse_toml("a = 1 # remark", "kinds.toml") == {"a": 1}
