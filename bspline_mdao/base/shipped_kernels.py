"""Kernels that a wheel ships compiled: read where numba's own cache has none, by processors that can run them.

A wheel may hold kernels for levels of processors, ``_kernels/LEVEL`` in the package, which `tools/ship_kernels.py`
compiles. Numba asks its cache for a specialisation by the name and the features of the processor; where that has none,
it is looked for among those of the highest level whose features this processor has, all of them. What is not there, is
of another version of numba or of Python or of another source is compiled as ever.

The package asks for it when it is imported, which does not import numba: `enable_with_numba` waits for that. Programs
that use numba without this package meet nothing of it, as they would by an entry point of numba's.
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
"""Features of each level of x86-64 beyond the first, the highest level first; names are those of LLVM."""

TARGETS = {"x86-64-v4": ",".join([*(f"+{name}" for name in _WIDE), "-prefer-256-bit"]), "x86-64-v3": "+avx2,+fma"}
"""``NUMBA_CPU_FEATURES`` that the kernels of a level are compiled with; ``NUMBA_CPU_NAME`` is its name."""


def level_of(
    features: dict[str, bool],  # which features of LLVM a processor has
) -> str | None:
    """Highest level that a processor can run; None where it can run none, or would not have compiled the same."""
    for level, names in LEVELS.items():
        if all(features.get(name) for name in names):
            # the evaluation takes twice as many lanes where there are wide registers, whatever else there is
            return level if ("avx512f" in names) == bool(features.get("avx512f")) else None
    return None


def enable_with_numba(folder: str = FOLDER) -> None:
    """Do as `enable` does as soon as numba is imported, at once if it is."""
    if _CACHING in sys.modules:
        enable(folder)
    elif os.path.isdir(folder):
        sys.meta_path.insert(0, _WaitForNumba(folder))


class _WaitForNumba:
    """A finder of modules that finds none itself, and goes once numba's caching is found."""

    def __init__(self, folder: str):
        self.folder = folder

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Let the others find numba's caching, and enable what is shipped as soon as they have loaded it."""
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
    """Let numba look for kernels of this package in a folder as well; say whether it does."""
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
