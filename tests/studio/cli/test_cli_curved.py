"""The command ``quality`` of files of curved hexahedra: Jacobians, and which elements are inverted."""

import numpy as np
import pytest
from test_cli import fails_as_expected, numbers

from bspline_mdao import fit_grid
from bspline_mdao.files import write_curved_grid
from bspline_mdao.generators import ball_grid
from bspline_mdao.splines import curved_grid
from bspline_mdao.studio.cli.main import run


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit_grid(ball_grid((5, 4, 5, 4), far=3.0)).save("ball.h5")
    return tmp_path


@pytest.mark.parametrize("degree", [1, 3])
def test_quality_of_curved_hexahedra_is_what_refine_says_of_them(workplace, capsys, degree):
    assert run(["refine", "ball.h5", "--degree", str(degree), "-o", "c.cgns", "--json", "r.json"]) == 0
    written = capsys.readouterr().out
    assert run(["quality", "c.cgns", "--json", "q.json"]) == 0
    text, found, expected = capsys.readouterr().out, numbers("q.json"), numbers("r.json")
    for name in ("degree", "n_elements", "n_nodes", "n_collapsed", "n_inverted", "n_undecided", "worst_jacobian"):
        assert found[name] == expected[name]
    first, _, proved = text.strip().split("\n")
    assert first in written
    assert proved in written
    assert f"element {found['worst_element']:,}" in text


def test_quality_finds_the_curved_element_that_is_inverted(workplace, capsys):
    grid = curved_grid(fit_grid(ball_grid((5, 4, 5, 4), far=3.0)), 2)
    wrong = 17
    inner = grid.elements[wrong, 1, 1, 1]
    grid.nodes[inner] += 3.0 * np.ptp(grid.nodes[grid.elements[wrong].ravel()], axis=0)
    write_curved_grid("c.cgns", grid)
    assert run(["quality", "c.cgns", "--json", "q.json"]) == 0
    found = numbers("q.json")
    assert (found["n_inverted"], found["worst_element"]) == (1, wrong + 1)
    assert "warning: 1 inverted element\n" in "".join(capsys.readouterr())


def test_quality_of_curved_hexahedra_has_no_baseline(workplace, capsys):
    write_curved_grid("c.cgns", curved_grid(fit_grid(ball_grid((5, 4, 5, 4), far=3.0)), 2))
    fails_as_expected(["quality", "c.cgns", "--baseline", "ball.h5"], capsys, "c.cgns: has curved", "--baseline")
