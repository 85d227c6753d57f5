"""Fields written by OpenFOAM in ASCII: their values in cells and on patches."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import SolverError
from .program import disk_full

__all__ = ["WrittenField", "words_of"]

_VALUE = r"(?:uniform\s+(?P<one>[^;]*?)|nonuniform\s+(?:List<\w+>)?\s*(?P<n>\d+)\s*(?P<list>[({][^;]*[)}]|))\s*;"
_INTERNAL = re.compile(rf"internalField\s+(?P<entry>{_VALUE})")
_ON_PATCH = re.compile(rf"(?<![\w.])value\s+(?P<entry>{_VALUE})")
_TYPE = re.compile(r"(?<![\w.])type\s+([^\s;]+)\s*;")
_BRACKETS = str.maketrans("(){}", "    ")

OF_CELLS = frozenset({"zeroGradient", "symmetry", "symmetryPlane", "slip", "empty"})
"""Types of patches without values in the file: a scalar there equals its values in the cells behind them."""


@dataclass(frozen=True)
class WrittenField:
    """Text of a field."""

    path: Path
    text: str

    @classmethod
    def read(cls, folder: Path, name: str) -> WrittenField:
        """Read a field of a time."""
        path = folder / name
        try:
            return cls(path, path.read_text())
        except OSError as error:
            raise disk_full("fields", folder.parent, error) from error

    @property
    def internal_entry(self) -> str:
        """Values in cells as text."""
        return self._internal["entry"]

    def with_internal(self, entry: str) -> str:
        """Text of the field with other values in cells, given as text."""
        start, end = self._internal.span("entry")
        return self.text[:start] + entry + self.text[end:]

    def internal(self, n_cells: int) -> np.ndarray:
        """Values in cells, shape (n_cells,), or (n_cells, 3) for a vector."""
        return self._values(self._internal, n_cells)

    def on_patch(self, name: str, cells: np.ndarray, n_cells: int) -> np.ndarray:
        """Values on the faces of a patch, whose cells are given; same number of components as in cells."""
        entry = self._entries.get(name)
        if entry is None:
            raise SolverError(
                f"{self.path}: has no values on patch {name}: it is not whole, or of another mesh; check the disk"
            )
        found = _ON_PATCH.search(entry)
        if found:
            return self._values(found, len(cells))
        kind = _TYPE.search(entry)
        if kind is None or kind[1] not in OF_CELLS:
            raise SolverError(f"{self.path}: patch {name} has no values; give it a condition that writes them")
        return self.internal(n_cells)[cells]

    @property
    def _internal(self) -> re.Match[str]:
        found = _INTERNAL.search(self.text)
        if found is None:
            raise SolverError(f"{self.path}: is not whole, or not in ASCII; check the disk and to writeFormat")
        return found

    @property
    def _entries(self) -> dict[str, str]:
        """Text of the entry of each patch."""
        _, is_there, boundary = self.text.partition("boundaryField")
        return dict(_dictionaries(boundary)) if is_there else {}

    def _values(self, found: re.Match[str], n: int) -> np.ndarray:
        """Numbers of an entry, as many as there are cells or faces."""
        one = found["one"]
        words = one if one is not None else found["list"]
        numbers = np.array(words.translate(_BRACKETS).split(), dtype=float)
        if one is not None or (found["list"][:1] == "{"):  # one value for all
            return np.broadcast_to(numbers if "(" in words else numbers[0], (n, 3) if "(" in words else (n,))
        n_parts = 3 if "(" in words[1:] else 1
        if int(found["n"]) != n or len(numbers) != n_parts * n:
            raise SolverError(f"{self.path}: has {found['n']} values for {n} cells or faces; check the disk")
        return numbers.reshape(n, 3) if n_parts == 3 else numbers


def _dictionaries(text: str) -> Iterator[tuple[str, str]]:
    """Names and contents of the dictionaries in one, after its name."""
    depth, start, name = 0, 0, ""
    for brace in re.finditer(r"[{}]", text):
        depth += 1 if brace[0] == "{" else -1
        if depth == 0:
            return
        if depth == 2 and brace[0] == "{":
            name, start = words_of(text[start : brace.start()])[-1].strip('"'), brace.end()
        elif depth == 1:
            if brace[0] == "}":
                yield name, text[start : brace.start()]
            start = brace.end()


def words_of(text: str) -> list[str]:
    """Words of a text without comments, at least one."""
    return re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.S).split() or [""]
