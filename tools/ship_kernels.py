"""Compile the kernels of usual commands for levels of processors into the package, for a wheel that ships them.

``python tools/ship_kernels.py && python -m build --wheel`` makes a wheel of this Python, this system and this
version of numba, which compiles nothing for usual commands; see `bspline_mdao.base.shipped_kernels`. A machine can
compile for the levels that it can run. ``python tools/ship_kernels.py --remove`` takes the kernels away again.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import llvmlite.binding as llvm
from numba.core.caching import UserProvidedCacheLocator

from bspline_mdao.base.kernel_cache import PACKAGE
from bspline_mdao.base.shipped_kernels import FOLDER, LEVELS, TARGETS


def main(levels: Sequence[str] = tuple(LEVELS), folder: Path = Path(FOLDER)) -> dict[str, int]:
    """Compile the kernels of levels.

    Parameters
    ----------
    levels : sequence of str
        Which of `LEVELS`.
    folder : Path
        Where they go, each into a folder of its own.

    Returns
    -------
    dict
        Number of specialisations by level; levels that this machine cannot run are left out.
    """
    features, counts = dict(llvm.get_host_cpu_features()), {}
    for level in levels:
        if not all(features.get(name) for name in LEVELS[level]):
            print(f"{level}: this processor cannot run it, and so not compile it")
            continue
        with tempfile.TemporaryDirectory() as scratch:
            target = {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": TARGETS[level], "NUMBA_CACHE_DIR": scratch}
            subprocess.run([sys.executable, "-m", "bspline_mdao", "warm-up"], env={**os.environ, **target}, check=True)
            counts[level] = collect(Path(scratch), folder / level)
        print(f"{level}: {counts[level]} specialisations in {folder / level}")
    return counts


def collect(compiled: Path, folder: Path) -> int:
    """Put what numba has compiled into a folder, in folders like the package's; return how many there are."""
    shutil.rmtree(folder, ignore_errors=True)
    for path in {source.parent for source in Path(PACKAGE).rglob("*.py")}:
        found = compiled / UserProvidedCacheLocator.get_suitable_cache_subpath(str(path / "module.py"))
        if found.is_dir():
            shutil.copytree(found, folder / path.relative_to(PACKAGE))
    return len(list(folder.rglob("*.nbc")))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--level", action="append", choices=LEVELS, help="this level alone; may be given more than once"
    )
    parser.add_argument("--remove", action="store_true", help="remove the kernels")
    arguments = parser.parse_args()
    if arguments.remove:
        shutil.rmtree(FOLDER, ignore_errors=True)
    else:
        main(arguments.level or tuple(LEVELS))
