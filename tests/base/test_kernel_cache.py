"""Compiled kernels find a place where neither the package nor the home folder can be written."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import bspline_mdao
from bspline_mdao.base import kernel_cache

PACKAGE = Path(bspline_mdao.__file__).parent
SPAN = """
import numpy as np
from bspline_mdao.core.splines.basis import find_span
T = np.array([0.0, 0.0, 0.0, 0.25, 1.0, 1.0, 1.0])
print(find_span(T, 3, 4, 0.5), sum(find_span.stats.cache_hits.values()), find_span._cache.cache_path)
"""
CHOSEN = "import os, bspline_mdao; print(os.environ['NUMBA_CACHE_DIR'])"


@pytest.fixture(scope="module")
def closed_package(tmp_path_factory):
    """A copy of the package in which nobody can write compiled files, not even root."""
    folder = tmp_path_factory.mktemp("closed")
    shutil.copytree(PACKAGE, folder / "bspline_mdao", ignore=shutil.ignore_patterns("__pycache__"))
    for source in (folder / "bspline_mdao").rglob("*.py"):
        (source.parent / "__pycache__").touch()
    return folder


def run(code, package, temporary, **variables):
    """Run code with a copy of the package and a home that does not exist; gives what it prints and what it warns."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA", "XDG", "PYTHON"))}
    environment = kept | {"HOME": "/dev/null/home", "TMPDIR": str(temporary)} | variables
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=package, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), done.stderr


@pytest.mark.slow
def test_kernels_run_and_are_compiled_once_where_nothing_else_can_be_written(closed_package, tmp_path):
    for n_hits, first in (("0", ""), ("1", "import numba")):  # which reads the environment when it is imported
        (span, hits, place), said = run(first + SPAN, closed_package, tmp_path)
        (folder,) = tmp_path.iterdir()
        assert (span, hits) == ("3", n_hits)
        assert Path(place).is_relative_to(folder)
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert said.count("\n") == 1
        assert str(folder) in said
        assert "set NUMBA_CACHE_DIR to a folder" in said


def test_the_folder_of_the_user_is_taken_and_nothing_said(closed_package, tmp_path):
    for variable in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        chosen = str(tmp_path / variable)
        assert run(CHOSEN, closed_package, tmp_path, **{"NUMBA_CACHE_DIR": "", variable: chosen}) == (
            [chosen] if variable == "NUMBA_CACHE_DIR" else [],
            "",
        )


def test_a_folder_that_somebody_else_could_write_is_not_trusted(closed_package, tmp_path):
    planted = tmp_path / f"bspline_mdao-{os.geteuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    (folder,), said = run(CHOSEN, closed_package, tmp_path)
    assert Path(folder).parent == tmp_path
    assert Path(folder) != planted
    assert folder in said
    assert list(tmp_path.iterdir()) == [planted]  # the other one went with the process


def test_a_link_is_not_trusted(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / f"bspline_mdao-{os.geteuid()}").symlink_to(tmp_path / "elsewhere")
    folder = Path(kernel_cache._private_folder())
    assert folder.name != f"bspline_mdao-{os.geteuid()}"
    assert not folder.is_symlink()


def test_a_relative_home_is_no_place(monkeypatch):
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as where there is no entry for the user
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert not kernel_cache._can_be_made(kernel_cache._user_folder())
