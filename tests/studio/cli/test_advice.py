"""What messages tell a user to type is what the commands take."""

import ast
import re
from pathlib import Path

import click
import pytest
from fit_cases import fit_with

from bspline_mdao.studio.cli.commands import bspline_mdao
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.cli.movers import MOVERS, SOLVERS, STIFFNESS

PACKAGE = Path(__file__).parents[3] / "bspline_mdao"

COMMANDS = bspline_mdao.commands
"""The commands by name."""

NOT_COMMANDS = {"run_script.py", "page.py"}
"""Files whose options are those of scripts, and of trame."""

OPTION = r"--[a-z][a-z-]*[a-z]"
NAMED = rf"(?<![\w-]){OPTION}"
"""An option where it is named."""


def options_of(command):
    """Options of a command, and the parameter of each."""
    return {
        text: option
        for option in command.params
        for text in [*option.opts, *option.secondary_opts]
        if text.startswith("--")
    }


CHOICES = {
    text: set(option.type.choices)
    for command in COMMANDS.values()
    for text, option in options_of(command).items()
    if isinstance(option.type, click.Choice)
} | {"--mover": set(MOVERS), "--stiffness": set(STIFFNESS), "--solver": set(SOLVERS)}
"""Values of the options that take some words alone."""

ALL = {text for command in COMMANDS.values() for text in options_of(command)} | {"--help"}


def texts(path):
    """Messages of a file: strings but docstrings, what is computed in them as {}."""
    source = path.read_text()
    if not re.search(NAMED, source):  # most files, which need no parsing
        return
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    left_out = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    left_out |= {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in left_out:
            yield node.value


MESSAGES = sorted(
    {
        (str(path.relative_to(PACKAGE)), text)
        for path in PACKAGE.rglob("*.py")
        if path.name not in NOT_COMMANDS
        for text in texts(path)
        if re.search(NAMED, text)
    }
)
"""File and text of every message that names an option."""


def test_messages_that_name_options_are_found():
    assert len(MESSAGES) > 30
    found = {file for file, _ in MESSAGES}
    assert {"studio/cli/move.py", "core/fit/errors.py", "core/movement/mover.py", "core/fit/closer_counts.py"} <= found


@pytest.mark.parametrize(("file", "text"), MESSAGES)
def test_every_option_that_a_message_names_exists(file, text):
    assert set(re.findall(rf"(?<![\w-])({OPTION})", text)) <= ALL


@pytest.mark.parametrize(("file", "text"), MESSAGES)
def test_an_option_that_follows_the_name_of_a_command_is_one_of_it(file, text):
    names = "|".join(COMMANDS)
    for name, rest in re.findall(rf"(?<![\w-])({names})((?: (?!-)[^\s,;()']+)?(?: {OPTION}[^,;()'-]*)+)", text):
        assert set(re.findall(OPTION, rest)) <= {*options_of(COMMANDS[name]), "--help"}


@pytest.mark.parametrize(("file", "text"), [m for m in MESSAGES if m[0].startswith("studio/cli/")])
def test_an_option_in_a_message_of_a_command_is_one_of_it_or_of_one_that_the_message_names(file, text):
    users = {"movers": ["move", "ride"], "counts": ["fit", "improve"], "curved": ["quality", "refine"]}
    stem = Path(file).stem
    names = users.get(stem, [stem] if stem in COMMANDS else list(COMMANDS))
    names = [*names, *(name for name in COMMANDS if re.search(rf"\b{name}\b", text))]
    allowed = {option for name in names for option in options_of(COMMANDS[name])} | {"--help"}
    assert set(re.findall(rf"(?<![\w-])({OPTION})", text)) <= allowed


@pytest.mark.parametrize(("file", "text"), MESSAGES)
def test_values_that_messages_give_to_options_are_taken(file, text):
    for name, value in re.findall(rf"(?<![\w-])({OPTION}) ([\w.]+)", text):
        assert value in CHOICES.get(name, {value}) or value in {"or", "if", "as", "and", "is"}


@pytest.mark.slow
def test_what_a_fit_says_to_type_against_too_much_memory_is_taken(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fit_with(
        monkeypatch,
        small_mesh=1,
        largest_factor=1,
        most_cells_per_span=4,
        largest_miss=0.3,
        layer=1.0,
        largest_line_miss=0.1,
    )
    assert run(["fit", "@onera_m6:17x17x15", "-o", "wing.h5", "--no-certify"]) == 0
    advised = re.findall(r"--n-control \d+=\d+x\d+x\d+", "".join(capsys.readouterr()))
    assert advised
    arguments = [word for option in advised for word in option.split()]
    assert run(["fit", "@onera_m6:17x17x15", "-o", "wing.h5", "--overwrite", "--no-certify", *arguments]) == 0
    asked = re.findall(r"=(\d+)x(\d+)x(\d+)", " ".join(advised))
    table = "".join(capsys.readouterr())
    assert all(" x ".join(counts) in table for counts in asked)
