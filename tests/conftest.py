"""What all tests share."""

import gc
import gzip
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

os.environ["OPENMDAO_REPORTS"] = "0"
WORK_FOLDER = tempfile.TemporaryDirectory(prefix="bspline_mdao_")
os.environ["OPENMDAO_WORKDIR"] = WORK_FOLDER.name
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")
collect_ignore_glob = ["parallel/cases/*"]  # scripts of ranks, which do not wait to be called


def pytest_configure(config):
    """Give each of several workers one thread: they share the cores, and BLAS and kernels take all by default."""
    if config.getoption("numprocesses", None):
        for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
            os.environ.setdefault(variable, "1")


def pytest_unconfigure():
    """Leave nothing in the temporary folder."""
    WORK_FOLDER.cleanup()


def pytest_collection_modifyitems(items):
    """Count doctests among the slow ones: each makes what a user would, grid and fit included."""
    for item in items:
        if isinstance(item, pytest.DoctestItem):
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish():
    """Take what is imported and collected out of what the garbage collector looks through again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def seeded_directions():
    """Let OpenMDAO draw the same directions in each run of a test."""
    np.random.seed(0)  # noqa: NPY002 - the generator that it draws them from


@pytest.fixture(scope="session")
def real_grids() -> Path:
    """Folder of grids from other projects, which are not part of this one."""
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    if not folder:
        pytest.skip("set BSPLINE_MDAO_GRIDS to the folder of real grids")
    return Path(folder)


@pytest.fixture
def real_mesh(real_grids, tmp_path):
    """Unpack a mesh without structure of other projects by its name, from the folder beside that of the grids."""

    def unpacked(name: str) -> Path:
        packed = real_grids.parent / "meshes" / f"{name}.su2.gz"
        if not packed.is_file():
            pytest.skip(f"put {packed.name} into {packed.parent}, the folder of real meshes")
        path = tmp_path / f"{name}.su2"
        path.write_bytes(gzip.decompress(packed.read_bytes()))
        return path

    return unpacked


@pytest.fixture
def pyvista():
    """The reader of files for ParaView, which takes a second to import: too long while tests are collected."""
    return pytest.importorskip("pyvista", reason="PyVista is not installed")
