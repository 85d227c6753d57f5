"""Studies with random mistakes: each is good, or ends in one line that says what is wrong."""

import numpy as np
import pytest
from fuzz_cases import N_MUTATIONS
from study_mutants import GOOD, mutant

from bspline_mdao.errors import InputError
from bspline_mdao.studio.cli import main
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.reader import read_study
from bspline_mdao.studio.study.script import study_script

N_MUTANTS, N_RUNS = 400, N_MUTATIONS // 5


def mutants():
    """All of them, by their numbers."""
    return {n: mutant(np.random.default_rng([2, n])) for n in range(N_MUTANTS)}


def is_accepted(folder, text):
    """Whether a study can be read and made a script."""
    (folder / "study.toml").write_text(text, encoding="utf-8", newline="")
    said = ""
    try:
        compile(study_script(read_study(folder / "study.toml"), folder), "optimize.py", "exec")
    except InputError as error:
        said = str(error).removeprefix(str(folder))
    assert len(said) < 900
    return not said


@pytest.mark.slow
def test_mutants_of_studies_are_scripts_or_errors_in_one_line(tmp_path):
    accepted = [n for n, text in mutants().items() if is_accepted(tmp_path, text)]
    assert 50 < len(accepted) < 200
    assert all(is_accepted(tmp_path, text) for text in GOOD)


@pytest.mark.slow
def test_mutants_that_can_be_read_end_well_or_in_one_line(tmp_path, monkeypatch, capfd):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    monkeypatch.chdir(tmp_path)
    accepted = [text for text in mutants().values() if is_accepted(tmp_path, text)]
    for number, text in enumerate(accepted[:: max(1, len(accepted) // N_RUNS)]):
        (tmp_path / "study.toml").write_text(text, encoding="utf-8", newline="")
        status = run(["optimize", "study.toml", "-o", f"out{number}", "--max-iterations", "1"])
        said = [line for line in capfd.readouterr().err.splitlines() if line.startswith("bspline-mdao: ")]
        assert (status, len(said)) in ((0, 0), (2, 1)), (text, said)
        assert "unexpected" not in "".join(said), (text, said)


def failing_report():
    """Run out of memory as NumPy does, and fail in saying so as OpenMDAO does."""
    try:
        raise MemoryError((2**40,), float)
    except MemoryError as error:
        return "where: " + error.args[0]


def test_memory_that_ran_out_is_named_also_where_its_report_failed():
    with pytest.raises(TypeError) as caught:
        failing_report()
    assert main.describe(caught.value).startswith("out of memory; ")
    assert main.describe(TypeError("else")).startswith("unexpected TypeError")
