"""Run script of Table 1."""

import importlib
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

RUN_SCRIPTS = Path(__file__).parents[3] / "run_scripts"


@pytest.fixture(scope="module")
def numbers(tmp_path_factory):
    figures = tmp_path_factory.mktemp("figures")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(RUN_SCRIPTS))
        numbers = importlib.import_module("table1_fit_errors").main(figures=figures)
    assert {file.name for file in figures.iterdir()} == {"table1_grids.png", "table1_errors.png"}
    return numbers


@pytest.mark.parametrize("case", ["onera_m6", "blended_wing_body"])
def test_parameter_correction_lowers_the_error(numbers, case):
    plain, corrected = numbers[case], numbers[case]["corrected"]
    assert 0.0 < corrected["rms"] < 0.5 * plain["rms"]
    assert len(plain["max_error"]) == len(corrected["max_error"]) == 3
    assert max(plain["max_error"]) > plain["rms"]


@pytest.mark.parametrize("case", ["onera_m6", "blended_wing_body"])
def test_control_mesh_is_valid(numbers, case):
    assert numbers[case]["n_invalid"] == 0


def test_small_grids_fit_as_well_as_their_size_allows(numbers):
    assert numbers["onera_m6"]["rms"] < 2e-3
    assert numbers["blended_wing_body"]["rms"] < 2e-4
