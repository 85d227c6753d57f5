"""Options that all commands have: where they print, what they replace, how shells complete them."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from bspline_mdao.studio.cli.commands import SHELLS, bspline_mdao
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.cli.program import SECTIONS

GRID = "@onera_m6:7x9x7"

REPLACING = {"live", "optimize", "sample"}
"""Commands of folders, which have rules of their own."""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_numbers_on_standard_output_come_alone(workplace, capsys):
    assert run(["fit", GRID, "-o", "m6.h5", "--json", "numbers.json"]) == 0
    capsys.readouterr()
    assert run(["fit", GRID, "-o", "m6.h5", "--overwrite", "--json", "-"]) == 0
    captured = capsys.readouterr()
    there, here = json.loads(Path("numbers.json").read_text()), json.loads(captured.out)
    assert {**here, "seconds": 0} == {**there, "seconds": 0}
    assert "m6.h5 written" in captured.err
    assert not Path("-").exists()


def test_nothing_is_printed_on_standard_output_by_a_command_that_fails(workplace, capsys):
    Path("there.h5").touch()
    assert run(["fit", GRID, "-o", "there.h5", "--json", "-"]) == 2
    assert capsys.readouterr().out == ""


def test_a_quiet_command_prints_its_warnings_alone(workplace, capsys):
    assert run(["fit", GRID, "-o", "m6.h5", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert run(["move", "m6.h5", "--deform", "twist=30deg", "-o", "moved.xyz", "--quiet"]) == 0
    captured = capsys.readouterr()
    assert captured.out == ""
    assert all(line.startswith("warning: the first cells at 'wing_") for line in captured.err.splitlines())
    assert len(captured.err.splitlines()) == 2


def test_a_verbose_command_prints_where_an_error_came_up(workplace, capsys, monkeypatch):
    assert run(["fit", "missing.xyz", "-o", "m6.h5"]) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert run(["fit", "missing.xyz", "-o", "m6.h5", "-v"]) == 2
    assert capsys.readouterr().err.startswith("Traceback")
    monkeypatch.setenv("BSPLINE_MDAO_TRACEBACK", "1")
    assert run(["fit", "missing.xyz", "-o", "m6.h5"]) == 2
    assert capsys.readouterr().err.startswith("Traceback")


def test_files_that_are_there_are_replaced_only_if_that_is_asked_for(workplace, capsys):
    Path("moved.xyz").write_text("mine")
    assert run(["fit", GRID, "-o", "m6.h5"]) == 0
    move = ["move", "m6.h5", "--deform", "twist=2deg", "-o", "moved.xyz"]
    assert run(move) == 2
    assert capsys.readouterr().err == "bspline-mdao: moved.xyz: is there already; give --overwrite, or another name\n"
    assert Path("moved.xyz").read_text() == "mine"
    assert run([*move, "--overwrite"]) == 0
    assert Path("moved.xyz").stat().st_size > 1000


@pytest.mark.parametrize("name", sorted(bspline_mdao.commands))
def test_all_commands_have_the_common_options(name):
    options = {option for each in bspline_mdao.commands[name].params for option in each.opts}
    assert {"--quiet", "--verbose"} <= options
    if "--output" in options and name not in REPLACING:
        assert "--overwrite" in options


def test_every_command_is_in_one_section_of_the_help():
    assert sorted(name for names in SECTIONS.values() for name in names) == sorted(bspline_mdao.commands)
    text = click.unstyle(bspline_mdao.get_help(click.Context(bspline_mdao)))
    assert all(f"\n{title}:\n  {names[0]} " in text for title, names in SECTIONS.items())


def test_help_lists_what_many_commands_have_last_and_in_colour():
    command = bspline_mdao.commands["quality"]
    text = command.get_help(command.context_class(command))
    assert "\x1b[36m--bins N\x1b[0m" in text
    own, common = click.unstyle(text).split("Common options:\n")
    assert "--bins N" in own.split("Options:\n")[1]
    assert re.findall(r"--\w+", common.split("Example:")[0]) == ["--json", "--quiet", "--verbose", "--help"]


@pytest.mark.parametrize("shell", SHELLS)
def test_shells_complete_commands(shell, capsys):
    if shell == "bash" and subprocess.run(["which", "bash"], capture_output=True).returncode:
        pytest.skip("there is no bash")
    assert run(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert f"_BSPLINE_MDAO_COMPLETE={shell}_complete" in script
    assert "bspline-mdao" in script


def test_the_program_answers_what_shells_ask(workplace):
    asked = {"COMP_WORDS": "bspline-mdao mo", "COMP_CWORD": "1", "_BSPLINE_MDAO_COMPLETE": "bash_complete"}
    command = [sys.executable, "-m", "bspline_mdao"]
    answer = subprocess.run(command, env={**os.environ, **asked}, capture_output=True, text=True, check=True)
    assert answer.stdout == "plain,move\n"
