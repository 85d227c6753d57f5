"""Precompiled kernels shipped in a wheel: used if numba's own cache has none, on processors that can run them.

A wheel may contain kernels for processor levels, ``_kernels/LEVEL`` in the package, compiled by
`tools/ship_kernels.py`. Numba looks up a specialisation in its cache by the name and features of the processor. If
there is none, the kernels of the highest level whose features this processor has in full are searched. Kernels that are
missing, or are from another version of numba, of Python or of the source, are compiled as usual.

The package enables this on import, without importing numba: `enable_with_numba` waits for that. Programs that use numba
without this package are not affected, as they would be by a numba entry point.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

from .kernel_cache import PACKAGE

__all__ = ["FOLDER", "LEVELS", "enable", "enable_with_numba", "level_of"]

FOLDER = os.path.join(PACKAGE, "_kernels")

_CACHING = "numba.core.caching"  # the module that is changed

_V3 = (
    "avx",
    "avx2",
    "bmi",
    "bmi2",
    "cx16",
    "f16c",
    "fma",
    "lzcnt",
    "movbe",
    "popcnt",
    "sahf",
    "ssse3",
    "sse4.1",
    "sse4.2",
)
_WIDE = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")

LEVELS: dict[str, tuple[str, ...]] = {"x86-64-v4": (*_V3, *_WIDE), "x86-64-v3": _V3}
"""Features of each x86-64 level beyond the first, highest level first, by LLVM's names."""

TARGETS = {"x86-64-v4": ",".join([*(f"+{name}" for name in _WIDE), "-prefer-256-bit"]), "x86-64-v3": "+avx2,+fma"}
"""``NUMBA_CPU_FEATURES`` with which the kernels of a level are compiled; ``NUMBA_CPU_NAME`` is its name."""


def level_of(
    features: dict[str, bool],  # LLVM features of a processor
) -> str | None:
    """Highest level that a processor can run; None if it can run none, or would have compiled differently."""
    for level, names in LEVELS.items():
        if all(features.get(name) for name in names):
            # the evaluation takes twice as many lanes if there are wide registers, whatever other features there are
            return level if ("avx512f" in names) == bool(features.get("avx512f")) else None
    return None


def enable_with_numba(folder: str = FOLDER) -> None:
    """Call `enable` as soon as numba is imported, at once if it already is."""
    if _CACHING in sys.modules:
        enable(folder)
    elif os.path.isdir(folder):
        sys.meta_path.insert(0, _WaitForNumba(folder))


class _WaitForNumba:
    """A module finder that finds none itself, and removes itself once numba's caching is found."""

    def __init__(self, folder: str):
        self.folder = folder

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Let the others find numba's caching, and enable shipped kernels as soon as it is loaded."""
        if name != _CACHING:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def exec_module(module: Any) -> None:
                load(module)
                enable(self.folder)

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def enable(folder: str = FOLDER) -> bool:
    """Let numba also look for kernels of this package in a folder; return whether it does."""
    if not os.path.isdir(folder) or os.environ.get("BSPLINE_MDAO_PLAIN_KERNELS", "0") != "0":
        return False
    import llvmlite.binding as llvm
    from numba.core import config
    from numba.core.caching import FunctionCache, IndexDataCacheFile

    if config.CPU_NAME is not None or config.CPU_FEATURES is not None or not config.ENABLE_AVX:
        return False  # the user wants code of another kind
    level = level_of(dict(llvm.get_host_cpu_features()))
    if level is None or not os.path.isdir(os.path.join(folder, level)):
        return False
    load = FunctionCache._load_overload

    def load_overload(self: Any, signature: Any, target: Any) -> Any:
        found = load(self, signature, target)
        if found is not None or not self._enabled:
            return found
        shipped = self.__dict__.get("_shipped")
        if shipped is None:
            source = Path(self._impl.locator._py_file) if hasattr(self._impl.locator, "_py_file") else Path()
            if not source.is_relative_to(PACKAGE):
                return None
            place = os.path.join(folder, level, source.parent.relative_to(PACKAGE))
            stamp = self._impl.locator.get_source_stamp()
            shipped = self._shipped = IndexDataCacheFile(place, self._impl.filename_base, stamp)
        key = self._index_key(signature, target.codegen())
        (triple, _, _), code = key[1], key[2]
        data = shipped.load((signature, (triple, level, TARGETS[level]), code))
        return None if data is None else self._impl.rebuild(target, data)

    FunctionCache._load_overload = load_overload
    return True
