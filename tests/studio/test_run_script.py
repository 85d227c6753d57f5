"""The command line of a run script is what its main says."""

import json
import warnings
from typing import Literal

import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.studio.run_script import pick_size, run


def main(
    paper: bool = False,
    figures=None,
    flow: Literal["euler", "vortex"] = "euler",
    mach: float = 0.3,
    increments: int | None = None,
    ways: tuple[str, ...] = ("one", "two"),
    node_based: str | None = None,
    drivers={"a": 1},  # noqa: B006
):
    """Return what is given.

    Parameters
    ----------
    paper : bool
        100 % of the size.
    flow : str
        Which
        flow.
    mach, increments : float
        A number.

    Returns
    -------
    dict
        All : of it.
    """
    return {name: value for name, value in locals().items() if name != "drivers"} | {"array": np.arange(2.0)}


def test_options_are_the_parameters_with_their_types(capsys, tmp_path):
    file = tmp_path / "numbers.json"
    given = "--paper --figures here --flow vortex --mach 0.8 --increments 3 --ways three four --node-based none"
    numbers = run(main, [*given.split(), "--json", str(file)])
    expected = {"paper": True, "figures": "here", "flow": "vortex", "mach": 0.8, "increments": 3, "node_based": "none"}
    assert numbers == {**expected, "ways": ["three", "four"], "array": numbers["array"]}
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads(file.read_text()) == {**expected, "ways": ["three", "four"], "array": [0.0, 1.0]}


def test_defaults_are_those_of_main(capsys):
    numbers = run(main, [])
    assert (numbers["flow"], numbers["ways"], numbers["increments"]) == ("euler", ("one", "two"), None)


@pytest.mark.parametrize("wrong", [["--flow", "other"], ["--mach", "fast"], ["--drivers", "x"]])
def test_what_main_does_not_take_is_refused(wrong, capsys):
    with pytest.raises(SystemExit):
        run(main, wrong)
    assert "usage" in capsys.readouterr().err


def test_help_is_that_of_the_docstrings(capsys):
    with pytest.raises(SystemExit):
        run(main, ["--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert "The command line of a run script is what its main says." in told
    for text in ("Which flow.", "100 % of the size.", "{euler,vortex}", "--json FILE"):
        assert text in told


def test_scripts_without_figures_or_sizes_still_know_the_options(capsys):
    assert run(lambda n=2: {"n": n}, ["--paper", "--figures", "x", "--n", "4"]) == {"n": "4"}


def test_unusable_input_ends_with_one_line_and_an_exit_status(capsys):
    def main(grid: str = "none"):
        raise InputError(f"{grid}: no such file; name one that is there")

    with pytest.raises(SystemExit) as ended:
        run(main, ["--grid", "wrong.xyz"])
    assert ended.value.code == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.endswith(": wrong.xyz: no such file; name one that is there\n")
    assert len(told.err.splitlines()) == 1


def test_sizes_are_picked_by_name():
    sizes = {"default": 1, "paper": 2}
    assert [pick_size(sizes), pick_size(sizes, paper=True)] == [1, 2]
    for wrong in ({"quick": True}, {"paper": True, "quick": True}):
        with pytest.raises(InputError, match="default, paper"):
            pick_size(sizes, **wrong)


def test_openmdao_does_not_warn_of_a_mode_that_was_chosen_by_linear_solves_of_a_flow(recwarn):
    def main():
        for message in ("Inefficient choice of derivative mode.  You chose 'rev' for 2 design variables", "other"):
            warnings.warn(message, stacklevel=2)
        return {}

    run(main, [])
    assert [str(warning.message) for warning in recwarn] == ["other"]
