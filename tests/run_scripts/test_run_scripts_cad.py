"""A wing that comes as a STEP file leaves as one, on which its walls are, with less induced drag."""

import importlib
from pathlib import Path

import pytest

from bspline_mdao.files import read_cad

pytestmark = pytest.mark.slow

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


def test_cad_wing_gains_by_twist_and_its_walls_are_on_the_file_that_it_writes(monkeypatch, tmp_path):
    pytest.importorskip("OCP", reason="OpenCascade is not installed")
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    script = importlib.import_module("cad_wing")
    monkeypatch.setitem(script.SIZES, False, ((9, 9, 7), (6, 5, 4)))
    numbers = script.main(figures=tmp_path, folder=tmp_path)
    assert numbers["success"]
    assert numbers["drag"]["after"] == pytest.approx(0.9933 * numbers["drag"]["before"], rel=3e-4)
    assert numbers["lift"]["after"] == pytest.approx(numbers["lift"]["before"], rel=1e-6)
    assert numbers["ways"] == pytest.approx([0.229, 0.063], abs=0.01)
    assert numbers["off"] < 1e-8
    assert numbers["totals"]["transposed"] < 1e-10
    assert numbers["totals"]["differences"] < 1e-7
    before, after = (read_cad(tmp_path / f"{name}.step") for name in ("wing", "optimum"))
    assert after.face_names == before.face_names
    assert after.unit == "millimetre"
    assert (tmp_path / "cad_wing.png").stat().st_size > 20_000
