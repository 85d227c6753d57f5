"""Commands on several ranks give what they give on one, and one rank prints."""

import json

import pytest
from parallel_cases import run_ranks

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def wing(tmp_path_factory):
    """Folder of a fitted wing, made by two ranks."""
    folder = tmp_path_factory.mktemp("wing")
    first, second = run_ranks("cases/command.py", 2, "fit", "@onera_m6:9x9x7", "-o", str(folder / "m6.h5"))
    assert "m6.h5 written" in first
    assert first.endswith("\n0\n")
    assert second == "0\n"
    return folder


def numbers_of(n, file, *arguments):
    """What a command writes as JSON on some ranks."""
    texts = run_ranks("cases/command.py", n, *arguments, "--json", str(file))
    assert all(text == "0\n" for text in texts[1:])
    return json.loads(file.read_text())


def test_quality_of_two_and_three_ranks_is_that_of_one(wing):
    one, two, three = (numbers_of(n, wing / f"q{n}.json", "quality", str(wing / "m6.h5")) for n in (1, 2, 3))
    assert one == two == three


def test_a_move_on_two_ranks_is_that_on_one(wing):
    for n in (1, 2):
        numbers_of(
            n, wing / f"{n}.json", "move", str(wing / "m6.h5"), "--deform", "twist=5deg", "-o", str(wing / f"{n}.xyz")
        )
    assert (wing / "1.xyz").read_bytes() == (wing / "2.xyz").read_bytes()


def test_what_is_wrong_is_said_once_and_all_ranks_end_alike(wing):
    first, second = run_ranks("cases/command.py", 2, "quality", str(wing / "nothing.xyz"))
    assert first.splitlines()[1:] == ["2"]
    assert "does not exist" in first
    assert second == "2\n"
