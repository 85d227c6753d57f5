"""What the documentation shows works: its Python examples and its command lines."""

import os
import re
import shlex
import textwrap
from pathlib import Path

import pytest

from bspline_mdao import fit_grid, onera_m6_grid, write_grid
from bspline_mdao.cli.main import run

DOCS = Path(__file__).parents[1] / "docs"


def code_blocks(page, language):
    """Code of every block of one language on a page."""
    pattern = rf"^\.\. code-block:: {language}\n\n((?:   .*\n|\n)+)"
    return [textwrap.dedent(block) for block in re.findall(pattern, (DOCS / page).read_text(), re.M)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with the grid and the model that the pages speak of, small."""
    folder = tmp_path_factory.mktemp("docs")
    grid = onera_m6_grid((15, 17, 13))
    write_grid(folder / "wing.xyz", grid)
    fit_grid(grid).save(folder / "m6.h5")
    return folder


def test_the_python_examples_of_the_quickstart_run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    examples = code_blocks("quickstart.rst", "python")
    assert len(examples) == 3
    for example in examples:
        exec(example, {})
    assert (folder / "thicker.xyz").exists()


def test_the_commands_of_the_quickstart_run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    lines = "\n".join(code_blocks("quickstart.rst", "sh")).splitlines()
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("bspline-mdao")]
    assert [command[0] for command in commands] == ["fit", "inspect", "fit", "refine", "refine", "refine"]
    for command in commands:
        assert run([word.replace("@onera_m6", "@onera_m6:9x9x9") for word in command]) == 0
    assert {"m6.h5", "wing.toml", "wing.h5", "fine.xyz", "coarse.cgns", "wing.vtm"} <= set(os.listdir(folder))
