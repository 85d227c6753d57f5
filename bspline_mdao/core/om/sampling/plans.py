"""Plans of designs within the bounds of the variables, as generators for OpenMDAO's ``DOEDriver``.

SciPy fills the cube evenly. The same plan with the same variables and seed gives the same set of designs on any
machine.
"""

from __future__ import annotations

import csv
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from openmdao.drivers.doe_generators import DOEGenerator
from scipy.stats import qmc

from ....base.text import value_names
from ....errors import InputError

__all__ = ["LatinHypercube", "Sobol", "Table"]

Case = list[tuple[str, np.ndarray]]

_NO_BOUND = 1e16
"""OpenMDAO writes 1e30 for an absent bound; scaling may reduce it."""


class _InCube(DOEGenerator, ABC):
    """Designs that fill the cube between all bounds."""

    def __init__(self, n: int, seed: int = 0):
        super().__init__()
        if not isinstance(n, int) or isinstance(n, bool) or n < 1:
            raise InputError(f"plan of designs: {n} of them; give a whole number from 1")
        self.n, self.seed = n, seed

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.n}, seed={self.seed})"

    def __call__(self, design_vars: Mapping[str, Mapping[str, Any]], model: Any = None) -> Iterator[Case]:
        """Yield the designs, each a list of names and values; called by OpenMDAO."""
        sizes = {name: int(meta["size"]) for name, meta in design_vars.items()}
        lower, upper = (
            np.concatenate([np.broadcast_to(meta[end], sizes[name]) for name, meta in design_vars.items()])
            for end in ("lower", "upper")
        )
        is_open = (np.abs(lower) >= _NO_BOUND) | (np.abs(upper) >= _NO_BOUND)
        if is_open.any():
            names = [each for name, meta in design_vars.items() for each in _names(name, meta)]
            raise InputError(
                f"plan of designs: {names[int(np.argmax(is_open))]} has no bounds on both sides; give both"
            )
        if not len(lower):
            raise InputError("plan of designs: the problem has no design variables; add some with bounds")
        places = np.cumsum(list(sizes.values()))[:-1]
        for point in self._points(len(lower), np.random.default_rng(self.seed)):
            yield list(zip(sizes, np.split(lower + point * (upper - lower), places)))

    @abstractmethod
    def _points(self, n_values: int, generator: np.random.Generator) -> np.ndarray:
        """Points of the unit cube, shape (n, n_values)."""


class LatinHypercube(_InCube):
    """Latin hypercube: each design has its own interval of the range of every value.

    Parameters
    ----------
    n : int
        Number of designs.
    seed : int
        Seed of the random numbers; another seed gives other designs.

    Raises
    ------
    InputError
        If the number is invalid; when called, if a variable has no bounds.

    Examples
    --------
    >>> from bspline_mdao.sampling import LatinHypercube
    >>> designs = list(LatinHypercube(4)({"twist": {"size": 2, "lower": -3.0, "upper": 1.0}}))
    >>> sorted(int(np.floor(values[0])) for ((_, values),) in designs)
    [-3, -2, -1, 0]
    """

    def _points(self, n_values: int, generator: np.random.Generator) -> np.ndarray:
        """Points of the unit cube, shape (n, n_values)."""
        return qmc.LatinHypercube(n_values, seed=generator).random(self.n)


class Sobol(_InCube):
    """Designs of a scrambled Sobol sequence, which fills the ranges evenly from the first designs on.

    Parameters
    ----------
    n : int
        Number of designs; powers of two fill the ranges best.
    seed : int
        Seed of the random numbers; another seed gives other designs.

    Raises
    ------
    InputError
        As `LatinHypercube`.

    Examples
    --------
    >>> from bspline_mdao.sampling import Sobol
    >>> len(list(Sobol(8)({"twist": {"size": 2, "lower": -3.0, "upper": 1.0}})))
    8
    """

    def _points(self, n_values: int, generator: np.random.Generator) -> np.ndarray:
        """Points of the unit cube, shape (n, n_values)."""
        n_doublings = int(np.ceil(np.log2(self.n)))  # SciPy warns unless it is a power of two; the excess is cut off
        return qmc.Sobol(n_values, seed=generator).random_base2(n_doublings)[: self.n]


class Table(DOEGenerator):
    r"""Designs of a table: a CSV file whose header names values, such as ``twist[0],twist[1],alpha``.

    Parameters
    ----------
    file : path-like
        The file. Values it does not name keep their values from the start of `sample`; a ``DOEDriver`` needs all values
        of a variable or none.

    Raises
    ------
    InputError
        When called, if the file cannot be read, names something unknown, or has a value that is not a number.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bspline_mdao.sampling import Table
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "designs.csv").write_text("twist[1]\n-2.5\n")
    ...     plan = Table(Path(folder, "designs.csv"))
    ...     list(plan({"twist": {"size": 2, "lower": -3.0, "upper": 1.0, "value": np.zeros(2)}}))
    [[('twist', array([ 0. , -2.5]))]]
    """

    def __init__(self, file: str | os.PathLike):
        super().__init__()
        self.file = Path(file)

    def __repr__(self) -> str:
        return f"Table('{self.file}')"

    def __call__(self, design_vars: Mapping[str, Mapping[str, Any]], model: Any = None) -> Iterator[Case]:
        """Yield the designs, each a list of names and values; called by OpenMDAO."""
        places = {
            each: (name, place) for name, meta in design_vars.items() for place, each in enumerate(_names(name, meta))
        }
        heads, rows = self._read()
        unknown = [head for head in heads if head not in places]
        if unknown or len(set(heads)) < len(heads):
            what = f"'{unknown[0]}' is no value of a variable" if unknown else "a value has two columns"
            raise InputError(f"{self.file}: {what}; the values are {', '.join(places)}")
        for number, row in enumerate(rows, start=2):
            case: dict[str, np.ndarray] = {}
            for head, text in zip(heads, row):
                name, place = places[head]
                meta = design_vars[name]
                start = np.broadcast_to(meta.get("value", np.nan), (int(meta["size"]),))
                case.setdefault(name, np.array(start, dtype=float))[place] = self._number(text, head, number)
            missing = [name for name, values in case.items() if np.isnan(values).any()]
            if missing:
                raise InputError(f"{self.file}: gives some values of '{missing[0]}'; give all of them, or none")
            yield list(case.items())

    def _read(self) -> tuple[list[str], list[list[str]]]:
        """Header, and rows of equally many texts."""
        try:
            with open(self.file, newline="", encoding="utf-8-sig") as file:
                found = [[text.strip() for text in row] for row in csv.reader(file) if row]
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise InputError(f"{self.file}: cannot be read as a table ({error})") from None
        if len(found) < 2:
            raise InputError(f"{self.file}: a table of designs has a line of names, and one for each design")
        for number, row in enumerate(found[1:], start=2):
            if len(row) != len(found[0]):
                raise InputError(f"{self.file}: line {number} has {len(row)} values, and {len(found[0])} have names")
        return found[0], found[1:]

    def _number(self, text: str, head: str, line: int) -> float:
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise InputError(f"{self.file}: line {line}, {head}: '{text}' is no number; correct it")
        return value


def _names(name: str, meta: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the values of a variable."""
    return meta["names"] if "names" in meta else value_names(name, int(meta["size"]))
