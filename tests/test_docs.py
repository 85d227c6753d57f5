"""What the documentation shows works: its Python examples and its command lines."""

import os
import re
import shlex
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import fit_grid, onera_m6_grid, write_grid
from bspline_mdao.cli.main import run

pytestmark = pytest.mark.slow

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


def test_the_python_examples_of_the_components_run():
    chain, nodes, spar, movers, own = code_blocks("components.rst", "python")
    for example in (chain + nodes, spar, movers, own):
        contents = {"__name__": __name__}
        exec(example, contents)
        if "wing" in contents:
            walls = contents["problem"].get_val("grid").reshape(-1, 3)[contents["wing"].rows]
            np.testing.assert_allclose(walls, contents["nodes"], rtol=0, atol=1e-12)


def test_the_python_examples_of_design_run():
    problems = []
    for example in code_blocks("design.rst", "python"):
        contents = {"__name__": __name__}
        exec(example, contents)
        problems.append(contents.get("problem"))
    optimised, _, checked = problems
    assert optimised.get_val("volume").item() > 1.0 - 1e-6
    assert optimised.get_val("surface_area").item() < 2.2
    assert checked.get_val("leading_edge_radius").shape == (3,)


@pytest.mark.filterwarnings("ignore::openmdao.api.DistributedComponentWarning")
def test_the_python_examples_of_mphys_run(tmp_path, monkeypatch):
    pytest.importorskip("mphys", reason="MPhys is not installed")
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    from mphys_cases import stand_ins

    grid = onera_m6_grid((9, 8, 7))
    monkeypatch.chdir(tmp_path)
    write_grid("wing.cgns", grid)
    fit_grid(grid).save("wing.h5")
    for name, module in stand_ins(grid).items():
        monkeypatch.setitem(sys.modules, name, module)
    problems = []
    for example in code_blocks("mphys.rst", "python"):
        contents = {"__name__": __name__}
        exec(example, contents)
        problems.append(contents["problem"])
    adflow, dafoam, ours = problems
    for problem, of in (adflow, "cruise.aero_post.cl"), (dafoam, "cruise.aero_post.CL"):
        assert np.abs(problem.compute_totals([of], ["twist"])[of, "twist"]).min() > 1e-3
    assert ours.get_val("climb.CL") > ours.get_val("cruise.CL")


def test_the_python_example_of_the_flow_runs(capsys):
    example, *_ = code_blocks("flow.rst", "python")
    contents = {"__name__": __name__}
    exec(example, contents)
    problem = contents["problem"]
    assert problem.get_val("CL") == pytest.approx(0.15, abs=0.03)
    totals = problem.compute_totals(["CL"], ["twist", "alpha"])
    assert totals["CL", "twist"].sum() == pytest.approx(totals["CL", "alpha"].item(), rel=0.05)  # all turn the same way
    assert "flow.state: residual" in capsys.readouterr().out


def test_the_examples_of_lift_loads_and_files_of_a_flow_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    contents = {"__name__": __name__}
    for example in code_blocks("flow.rst", "python"):
        exec(example, contents)
    assert abs(contents["problem"].get_val("CM_aileron").item()) > 0.0
    assert {"wing.vtm", "wing_walls.vtm", "wing.h5"} <= {path.name for path in tmp_path.iterdir()}


def test_the_derivative_of_the_mover_in_the_documentation_is_exact():
    contents = {"__name__": __name__}
    exec(code_blocks("components.rst", "python")[-1], contents)
    mover, random = contents["mover"], np.random.default_rng(1)
    initial, surface = mover.mesh.points, mover.mesh.points[mover.mesh.surface_ids] + [0.1, 0.2, 0.0]
    direction = mover.mesh.slide(random.standard_normal(initial.shape))
    movement, step = mover.move(initial, surface), 1e-6
    points = [mover.move(initial + h * direction, surface).points for h in (step, -step)]
    change = movement.jvp(direction, np.zeros_like(surface))
    off_plate = np.abs(initial[:, 1]) > 1e-3
    np.testing.assert_allclose((points[0] - points[1])[off_plate] / (2 * step), change[off_plate], atol=1e-8)
    bar = random.standard_normal(initial.shape)
    initial_bar, _ = movement.vjp(bar)
    assert np.vdot(bar, change) == pytest.approx(np.vdot(initial_bar, direction), rel=1e-12)


def test_the_commands_of_the_quickstart_run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    lines = "\n".join(code_blocks("quickstart.rst", "sh")).splitlines()
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("bspline-mdao")]
    assert [command[0] for command in commands] == [
        *("fit", "move", "inspect", "fit", "move", "move", "quality", "fit", "refine", "refine", "refine")
    ]
    for command in commands:
        assert run([word.replace("@onera_m6", "@onera_m6:9x9x9") for word in command]) == 0
    assert {"m6.h5", "wing.toml", "wing.h5", "fine.xyz", "coarse.cgns", "wing.vtm", "moved.vtm", "bent.xyz"} <= set(
        os.listdir(folder)
    )
