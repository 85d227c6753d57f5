"""The table of robustness counts what inverts, and elasticity leads it."""

import importlib
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import InputError, read_grid
from bspline_mdao.generators import flat_plate_grid
from bspline_mdao.movers import LinearElasticity, increments_for

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    monkeypatch.delenv("BSPLINE_MDAO_GRIDS", raising=False)
    return importlib.import_module


@pytest.mark.slow
def test_elasticity_leads_the_table_of_robustness(script):
    numbers = script("robustness_table").main(deformations=("twist=90deg",))
    movers = numbers["movers"]
    assert len(movers) == 9
    assert {row["n_cases"] for row in movers.values()} == {4}  # two grids, each by its own shape too
    assert movers["elasticity"]["share_of_possible"] == 1.0
    assert movers["elasticity"]["n_valid"] == max(row["n_valid"] for row in movers.values())
    assert movers["elasticity"]["n_valid"] >= 3
    assert movers["held"]["n_inverted"] > 50
    assert numbers["lost"] == []
    assert numbers["not_applicable"] == {}


@pytest.mark.slow
def test_the_number_of_increments_that_is_chosen_loses_no_case_that_five_manage(script, monkeypatch):
    table = script("robustness_table")
    studied = {name: table.INCREMENTS[name] for name in ("chosen", "m = 1", "m = 5")}
    monkeypatch.setitem(table.STUDIES, "increments", studied)
    numbers = table.main(study="increments", deformations=("twist=90deg",))
    assert numbers["movers"]["chosen"]["n_cases"] == 4
    assert numbers["lost"] == []
    assert numbers["movers"]["chosen"]["n_valid"] >= numbers["movers"]["m = 5"]["n_valid"] > 0
    assert numbers["movers"]["m = 1"]["n_valid"] < numbers["movers"]["chosen"]["n_valid"]


def test_a_real_grid_that_one_increment_tangles_gets_two(script, real_grids):
    body = script("robustness_table").Body("cylinder", read_grid(real_grids / "aither_multiblock_cylinder.xyz"))
    surface = body.surface("twist=90deg")
    assert increments_for(LinearElasticity(body.mesh), [surface]) == 2
    one, two = (LinearElasticity(body.mesh, n_increments=m).move(body.mesh.points, surface) for m in (1, 2))
    assert one.report.first_tangled()
    assert not two.report.first_tangled()
    assert body.judge(two.points)[0] == 0


def test_what_the_first_mover_loses_is_named(script):
    robustness_table = script("robustness_table")
    cases = [
        robustness_table.Outcome("grid", "twist", "elasticity", n_inverted=3, q_min=-0.1, n_tangled=1),
        robustness_table.Outcome("grid", "twist", "springs", q_min=0.2),
        robustness_table.Outcome("grid", "chord", "elasticity", q_min=0.3),
        robustness_table.Outcome("grid", "chord", "springs", failure="cannot go on"),
    ]
    (case,) = robustness_table.lost(cases, "elasticity")
    assert case["case"] == "grid: twist"
    assert case["others"] == {"springs": 0.2}
    row = robustness_table.table(cases)["springs"]
    assert (row["n_valid"], row["n_failed"], row["share_of_possible"], row["q_min"]) == (1, 1, 0.5, 0.2)


def test_the_best_of_a_case_is_the_valid_one_with_the_largest_smallest_q(script):
    outcome = script("robustness_table").Outcome
    cases = [
        outcome("grid", "twist", "elasticity", q_min=0.1, seconds=3.0),
        outcome("grid", "twist", "springs", q_min=0.2, seconds=1.0),
        outcome("grid", "twist", "radial", n_inverted=1, q_min=0.3),
        outcome("grid", "chord", "elasticity", q_min=0.3, seconds=4.0),
        outcome("grid", "chord", "springs", failure="cannot go on", seconds=1.0),
        outcome("grid", "chord", "radial", q_min=0.3),
        outcome("grid", "bend", "elasticity", n_inverted=4, q_min=-0.1, seconds=9.0),
    ]
    rows = script("robustness_table").table(cases)
    assert {mover: row["n_best"] for mover, row in rows.items()} == {"elasticity": 1, "springs": 1, "radial": 1}
    assert {mover: row["seconds"] for mover, row in rows.items()} == {"elasticity": 4.0, "springs": 1.0, "radial": 0.0}


@pytest.mark.slow
def test_cells_that_were_invalid_before_are_not_counted(script, monkeypatch):
    body = script("robustness_table").Body("plate", flat_plate_grid((7, 7, 7)), (5, 5, 5))
    points = body.mesh.points.copy()
    assert body.judge(points)[0] == 0
    points[body.mesh.surface_ids] += np.array([0.0, 0.3, 0.0])
    n_inverted, _ = body.judge(points)
    assert n_inverted > 0
    blocks = tuple(replace(block, was_invalid=np.arange(block.n_cells)) for block in body.quality.blocks)
    monkeypatch.setitem(body.__dict__, "quality", replace(body.quality, blocks=blocks))
    assert body.judge(points) == (0, np.inf)


@pytest.mark.slow
def test_a_real_grid_moves_and_what_it_cannot_take_is_told(script, real_grids, tmp_path):
    shutil.copy(real_grids / "cgns_5blocks.cgns", tmp_path)
    (tmp_path / "notes.txt").write_text("no grid")
    bodies, left_out = script("robustness_table").collect(False, tmp_path)
    assert [body.name for body in bodies] == ["plate", "M6", "cgns_5blocks.cgns"]
    assert list(left_out) == ["notes.txt"]
    body = bodies[-1]
    assert body.surface("chord=0.5").shape == (len(body.mesh.surface_ids), 3)
    with pytest.raises(InputError, match="leave the box around the grid"):
        body.surface("stretch=2")
