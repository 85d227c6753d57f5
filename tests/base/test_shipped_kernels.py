"""Kernels that a wheel ships are loaded by processors that can run them, and by no others."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
import tomlkit

from bspline_mdao.base.shipped_kernels import LEVELS, TARGETS, enable, level_of

TOOL = Path(__file__).parents[2] / "tools" / "ship_kernels.py"
SPAN = """
import sys
import llvmlite.binding as llvm
import numpy as np
if len(sys.argv) > 2:  # as on a processor that has less than this one
    lacking = dict(llvm.get_host_cpu_features()) | dict.fromkeys(sys.argv[2].split(), False)
    llvm.get_host_cpu_features = llvm.targets.get_host_cpu_features = lambda: llvm.targets.FeatureMap(lacking)
    llvm.get_host_cpu_name = lambda: "haswell"
from bspline_mdao.base.shipped_kernels import enable
from bspline_mdao.core.splines.basis import find_span
print(enable(sys.argv[1]))
if len(sys.argv) > 3:
    find_span._cache._impl.locator.get_source_stamp = lambda: b"another source"
T = np.array([0.0, 0.0, 0.0, 0.25, 1.0, 1.0, 1.0])
print(find_span(T, 3, 4, 0.5), sum(find_span.stats.cache_hits.values()))
"""


def span(cache, shipped, *more, **variables):
    """What a process prints: whether it looks in a folder, the result of a kernel, and how often it was loaded."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_C")}
    environment = {**kept, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": os.pathsep.join(sys.path), **variables}
    call = [sys.executable, "-c", SPAN, str(shipped), *more]
    done = subprocess.run(call, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def llvm_features():
    """Features of this processor by their names in LLVM."""
    return dict(pytest.importorskip("llvmlite.binding").get_host_cpu_features())


@pytest.fixture(scope="module")
def here():
    """Level of this processor."""
    level = level_of(llvm_features())
    if level is None:
        pytest.skip("kernels are shipped for no level of this processor")
    return level


def test_the_highest_level_is_taken_that_a_processor_can_run():
    v3, v4 = (dict.fromkeys(LEVELS[f"x86-64-v{n}"], True) for n in (3, 4))
    assert level_of(v4 | {"amx": True}) == "x86-64-v4"
    assert level_of(v3 | {"avx512f": False}) == "x86-64-v3"
    assert level_of(v3 | {"fma": False}) is None
    assert level_of(v3 | {"avx512f": True}) is None  # wide registers, and not all that v4 needs
    assert level_of({"neon": True}) is None


@pytest.mark.slow
def test_shipped_kernels_are_loaded_where_the_processor_and_the_source_fit(here, tmp_path):
    built, shipped = tmp_path / "built", tmp_path / "shipped"
    target = {"NUMBA_CPU_NAME": here, "NUMBA_CPU_FEATURES": TARGETS[here]}
    assert span(built, shipped, **target) == ["False", "3", "0"]
    assert runpy.run_path(str(TOOL))["collect"](built, shipped / here) == 1
    assert span(tmp_path / "mine", shipped) == ["True", "3", "1"]
    assert list((tmp_path / "mine").rglob("*.nbc")) == []  # nothing was compiled
    assert span(tmp_path / "stale", shipped, "", "stale") == ["True", "3", "0"]
    assert span(tmp_path / "generic", shipped, NUMBA_CPU_NAME="generic") == ["False", "3", "0"]
    (shipped / here).rename(shipped / "other")
    assert span(tmp_path / "others", shipped) == ["False", "3", "0"]
    assert len(list((tmp_path / "others").rglob("*.nbc"))) == 1  # compiled, as without a wheel


@pytest.mark.slow
def test_a_processor_without_wide_registers_loads_the_kernels_of_its_level(here, tmp_path):
    built, shipped = tmp_path / "built", tmp_path / "shipped"
    target = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": TARGETS["x86-64-v3"]}
    assert span(built, shipped, **target) == ["False", "3", "0"]
    assert runpy.run_path(str(TOOL))["collect"](built, shipped / "x86-64-v3") == 1
    narrow = " ".join(name for name in llvm_features() if name.startswith("avx512"))
    assert span(tmp_path / "mine", shipped, narrow) == ["True", "3", "1"]
    assert list((tmp_path / "mine").rglob("*.nbc")) == []
    assert span(tmp_path / "less", shipped, f"{narrow} fma") == ["False", "3", "0"]
    (shipped / "x86-64-v3").rename(shipped / "x86-64-v4")
    assert span(tmp_path / "wide", shipped, narrow) == ["False", "3", "0"]  # never those of more than it has


WAIT = """
import sys
import bspline_mdao
from bspline_mdao.base.shipped_kernels import enable_with_numba
assert "numba" not in sys.modules
before = list(sys.meta_path)
enable_with_numba(sys.argv[1])
import numba
from numba.core.caching import FunctionCache
print(FunctionCache._load_overload.__module__, sys.meta_path == before)
"""


def test_the_package_waits_for_numba(here, tmp_path):
    (tmp_path / here).mkdir()

    def said(folder):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        call = [sys.executable, "-c", WAIT, str(folder)]
        return subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout.split()

    assert said(tmp_path) == ["bspline_mdao.base.shipped_kernels", "True"]
    assert said(tmp_path / "none") == ["numba.core.caching", "True"]


def test_numba_calls_nothing_of_the_package():
    project = tomlkit.parse((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "numba_extensions" not in project["entry-points"]


def test_plain_kernels_are_not_shipped(tmp_path, monkeypatch):
    monkeypatch.setenv("BSPLINE_MDAO_PLAIN_KERNELS", "1")
    assert not enable(str(tmp_path))


def test_nothing_is_looked_for_where_nothing_is_shipped(tmp_path):
    assert not enable(str(tmp_path / "none"))
