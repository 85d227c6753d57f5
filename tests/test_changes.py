"""In the hosted workflow a change runs the tests of its layer and of those above; all of them where that is unclear."""

import json
import runpy
import subprocess
import sys
from itertools import chain
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
from make_map import layers  # noqa: E402

PROGRAM = ROOT / ".ci" / "layers"
LAYERS, JOBS, jobs = (runpy.run_path(str(PROGRAM))[name] for name in ("LAYERS", "JOBS", "jobs"))


def names(*paths: str) -> list[str]:
    return [job["name"] for job in jobs(paths)]


def test_the_layers_are_those_of_the_package_from_below():
    assert [layer for layer in layers() if layer != "testing"] == list(LAYERS)


@pytest.mark.parametrize(("n", "layer"), list(enumerate(LAYERS)))
def test_a_change_of_a_layer_asks_for_it_and_those_above(n, layer):
    for path in (f"bspline_mdao/{layer}/mesh.py", f"bspline_mdao/{layer}/a/folder/mesh.py"):
        assert names(path) == ["form", *LAYERS[n:], "run_scripts"]
    assert names(f"tests/{layer}/test_mesh.py") == ["form", layer]


@pytest.mark.parametrize(
    "path",
    ["docs/flow.rst", "benchmarks/core/bench_fit.py", "README.md", "tests/test_map.py", "tests/parallel/cases/fit.py"],
)
def test_what_no_layer_uses_asks_for_the_form_alone(path):
    assert names(path) == names() == ["form"]


@pytest.mark.parametrize(
    "path",
    [
        "pyproject.toml",
        "bspline_mdao/names.py",
        "bspline_mdao/testing/dot.py",
        "tests/fit_cases.py",
        ".ci/layers",
        ".github/workflows/ci.yml",
        "a/new/folder",
    ],
)
def test_what_all_layers_use_or_has_no_place_asks_for_everything(path):
    assert names(path) == list(JOBS)


def test_jobs_add_up_and_are_written_as_json():
    paths = ["run_scripts/a.py", "tests/grids/test_a.py", "bspline_mdao/flow/a.py"]
    done = subprocess.run([sys.executable, PROGRAM], input="\n".join(paths), capture_output=True, text=True, check=True)
    assert [job["name"] for job in json.loads(done.stdout)] == ["form", "grids", "flow", "studio", "run_scripts"]


def test_all_tests_and_doctests_but_those_of_several_processes_are_of_a_job():
    places = [path for tests in JOBS.values() for pattern in tests.split() for path in ROOT.glob(pattern)]
    covered = set(chain(places, *(place.rglob("*.py") for place in places)))
    every = {*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "bspline_mdao").rglob("*.py")}
    assert {path for path in every - covered if "parallel" not in path.parts} == set()


def test_the_workflow_runs_the_jobs_of_pull_requests_and_everything_of_main():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())["jobs"]
    assert ".ci/layers" in workflow["change"]["steps"][-1]["run"]
    assert workflow["layer"]["strategy"]["matrix"]["job"] == "${{ fromJSON(needs.change.outputs.jobs) }}"
    assert workflow["layer"]["steps"][-1]["run"].endswith("${{ matrix.job.tests }}")
    assert workflow["tests"]["if"] == "github.event_name == 'push'"
    assert "if" not in workflow["everything"]
