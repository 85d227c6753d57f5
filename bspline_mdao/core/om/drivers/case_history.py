"""An optimisation as recorded in an OpenMDAO case file: values of all evaluations, limits, and convergence.

Only the file is needed, whichever driver wrote it. First-order conditions are checked if derivatives are recorded
(``driver.recording_options["record_derivatives"] = True``).

Theory: ``docs/theory/drivers.rst``, "How a run ends".
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import openmdao.api as om
from openmdao.recorders.base_case_reader import BaseCaseReader
from openmdao.recorders.case import Case

from ....base.text import value_names
from ....errors import InputError
from ..model_option import length_units, systems_at
from ..option_signature import IN_RECORDS
from .nlopt_problem import Limits, Point, Statement
from .optimality import optimality
from .sound_cases import sound_cases
from .violations import TOLERATED, Violation, in_words, violations_of

__all__ = ["FEASIBLE", "CaseHistory", "Convergence", "Quantity", "read_history"]

FEASIBLE = 1e-6
"""Violation, in units of the driver, up to which a point counts as feasible: the default tolerance of `NLoptDriver`."""

NO_LIMIT = 1e16
"""Limits beyond this count as absent: OpenMDAO writes 1e30 for infinity."""

TAKEN_BY = {"variable": "get_design_vars", "objective": "get_objectives", "constraint": "get_constraints"}
"""Kinds of quantities, and the methods that get them from a case."""


class Convergence(NamedTuple):
    """Residuals and violations of the points of an optimisation, in units of the driver."""

    violations: np.ndarray  # (n,), largest violation of the constraints at every evaluation
    differentiated: np.ndarray  # (m,) of int, evaluations with a gradient, from 0
    residuals: np.ndarray  # (m,), residuals of the first-order conditions there
    # (m, 1 + n_constraints, n_variables), totals of objective and constraints there; empty if there are none
    totals: np.ndarray


@dataclass(frozen=True, eq=False)
class Quantity:
    """A design variable, an objective or a constraint."""

    name: str  # its name in the driver
    kind: str  # one of these kinds
    # units, text: units and description of the model's variable; empty if there are none
    units: str
    text: str
    # lower, upper, equals: (size,), limits in units of the model; infinite, and NaN for ``equals``, if there is none
    lower: np.ndarray
    upper: np.ndarray
    equals: np.ndarray
    # scaler, adder: (size,), the driver sees ``(value + adder) scaler``
    scaler: np.ndarray
    adder: np.ndarray
    values: np.ndarray  # (n, size), values of all evaluations in units of the model
    # names of the values, such as ``twist[2]``, indexed as in the model's variable
    value_names: tuple[str, ...]
    is_of_grid: bool  # whether it enters or leaves a system with a model, whose lengths are in the unit of the grid

    def scaled(self, values: np.ndarray) -> np.ndarray:
        """Values, or limits, as the driver sees them."""
        return (values + self.adder) * self.scaler

    def violations(self, number: int, tolerance: float = TOLERATED) -> list[Violation]:
        """Values of an evaluation beyond their limits, by more than a tolerance relative to these."""
        is_open = np.isnan(self.equals)
        lower, upper = (np.where(is_open, limits, self.equals) for limits in (self.lower, self.upper))
        return violations_of(self.value_names, self.values[number], lower, upper, 1.0 / np.abs(self.scaler), tolerance)

    def limits(self) -> Limits:
        """Limits as the driver sees them."""
        lower, upper = self.scaled(self.lower), self.scaled(self.upper)  # a negative scaler swaps them
        return Limits(self.name, np.minimum(lower, upper), np.maximum(lower, upper), self.scaled(self.equals))


@dataclass(frozen=True, eq=False)
class CaseHistory:
    """All evaluations of a driver in a case file."""

    driver: str  # name of the driver
    quantities: tuple[Quantity, ...]  # design variables, objectives and constraints, in this order
    seconds: np.ndarray  # (n,), wall time since the first evaluation (s)
    convergence: Convergence | None  # violations and first-order residuals; None unless there is one objective
    # (n,) of bool, whether the model could be run, with finite variables and objectives, and constraints that are
    # numbers
    has_run: np.ndarray
    # the feasible evaluation with the lowest objective, or the one with the smallest violation if none is feasible; the
    # last one unless there is one objective
    best: int
    # other numeric outputs recorded: for each name, the values by evaluation
    outputs: Mapping[str, Mapping[int, np.ndarray]]
    # options of the model's systems by name, in the last recorded run
    options: Mapping[str, Mapping[str, object]]
    n_others: int  # evaluations of earlier runs with other variables or responses, which are left out

    @property
    def n_evaluations(self) -> int:
        """Number of evaluations of the model."""
        return len(self.seconds)

    def of_kind(self, kind: str) -> tuple[Quantity, ...]:
        """Quantities of one kind."""
        return tuple(quantity for quantity in self.quantities if quantity.kind == kind)

    def infeasible(self, number: int, tolerance: float = TOLERATED) -> str:
        """Describe which limits an evaluation violates and by how much; empty if it satisfies all."""
        return in_words([each for quantity in self.quantities for each in quantity.violations(number, tolerance)])

    def in_length_unit(self, unit: str) -> CaseHistory:
        """Write the unit of a grid next to lengths of the grid, which components count in metres."""
        quantities = (replace(q, units=length_units(q.units, unit)) if q.is_of_grid else q for q in self.quantities)
        return replace(self, quantities=tuple(quantities))

    def statement(self) -> Statement:
        """Bounds and constraints as the driver sees them."""
        return _statement(self.quantities)

    def scaled_points(self) -> list[Point]:
        """All evaluations as the driver sees them; requires one objective."""
        return _points(self.quantities, self.n_evaluations)


def read_history(
    file: str | os.PathLike,  # case file of ``om.SqliteRecorder``, attached to a driver
) -> CaseHistory:
    """Read an optimisation from a case file: all driver runs, one after the other."""
    # Runs whose variables or responses differ from the last one's are left out.
    if not os.path.isfile(file):
        raise InputError(f"{file}: there is no such case file; a recorder writes into the problem's folder of outputs")
    try:
        with sound_cases(file) as sound:
            reader = om.CaseReader(str(sound.file))
            names = reader.list_cases("driver", recurse=False, out_stream=None)
            found = _history(reader, names, sound.options) if names else None
    except InputError:
        raise
    except Exception as error:  # from unpacking damaged bytes
        words = " ".join(str(error).split())[:160]
        raise InputError(f"{file}: is no case file that can be read ({words}); it may be damaged") from None
    if found is None:
        raise InputError(
            f"{file}: holds no case of a driver; attach a recorder with "
            f"problem.driver.add_recorder(om.SqliteRecorder(file)) and run the driver"
        )
    return found


def _history(reader: BaseCaseReader, names: list[str], options: Mapping[str, Mapping[str, object]]) -> CaseHistory:
    """History from the cases of a reader."""
    every = [reader.get_case(name) for name in names]
    rows = [{kind: getattr(case, take)(scaled=False) for kind, take in TAKEN_BY.items()} for case in every]
    n_others = _n_others(rows)
    cases = every[n_others:]
    settings = (reader.problem_metadata or {}).get("variables", {})
    version = tuple(int(part) for part in reader.openmdao_version.split(".")[:2])
    outputs, inputs = reader._abs2meta, reader._conns.items()  # OpenMDAO has no public names for these
    systems = ["" if name == "root" else name for name, found in options.items() if found.get(IN_RECORDS)]

    def is_of_grid(source: str) -> bool:
        return next(systems_at(source, inputs, systems), None) is not None

    quantities = _quantities(cases[0], rows[n_others:], settings, outputs, is_of_grid, is_scaled=version < (3, 44))
    convergence = _convergence(quantities, cases)
    stamps = np.array([case.timestamp for case in cases])
    has_run = np.array([bool(case.success) for case in cases])
    for q in quantities:
        has_run &= ~np.isnan(q.values).any(axis=1) if q.kind == "constraint" else np.isfinite(q.values).all(axis=1)
    return CaseHistory(
        driver=names[-1].rpartition(":")[2].partition("|")[0],
        quantities=quantities,
        seconds=stamps - stamps[0],
        convergence=convergence,
        has_run=has_run,
        best=_best(quantities, convergence, has_run),
        outputs=_others(cases, {quantity.name for quantity in quantities}),
        options=options,
        n_others=n_others,
    )


def _n_others(rows: list[dict[str, dict]]) -> int:
    """Number of leading cases, up to the last one whose variables or responses differ from the final case's."""
    sizes = [{(kind, name): np.size(value) for kind, of in row.items() for name, value in of.items()} for row in rows]
    return next((n for n in range(len(sizes), 0, -1) if sizes[n - 1] != sizes[-1]), 0)


def _quantities(
    case: Case,
    rows: list[dict[str, dict]],
    settings: Mapping[str, dict],
    outputs: Mapping[str, dict],
    is_of_grid: Callable[[str], bool],
    is_scaled: bool,
) -> tuple[Quantity, ...]:
    """Design variables, objectives and constraints; limits are scaled in files of older versions of OpenMDAO."""
    metas = case.list_outputs(explicit=True, implicit=True, val=False, units=True, desc=True, out_stream=None)
    by_name = {meta["prom_name"]: meta for _, meta in metas}
    found = []
    for kind in TAKEN_BY:
        for name in rows[0][kind]:
            values = np.array([np.ravel(row[kind][name]) for row in rows], dtype=float)
            meta, about = settings.get(name, {}), by_name.get(name, {})
            places = meta.get("indices")
            if places is not None:  # some count from the end
                places = [place % outputs[meta["source"]]["global_size"] for place in places]
            names = value_names(name, values.shape[1], places)
            of_grid = is_of_grid(meta.get("source", name))
            found.append(_quantity(name, kind, values, names, meta, about, of_grid, is_scaled))
    return tuple(found)


def _quantity(
    name: str,
    kind: str,
    values: np.ndarray,
    names: tuple[str, ...],
    meta: Mapping[str, Any],
    about: Mapping[str, Any],
    is_of_grid: bool,
    is_scaled: bool,
) -> Quantity:
    """One quantity from its values and its metadata in the file."""
    size = values.shape[1]

    def numbers(key: str, absent: float) -> np.ndarray:
        value = meta.get(key)
        array = np.array(np.broadcast_to(absent if value is None else np.ravel(value), (size,)), dtype=float)
        array[np.abs(array) >= NO_LIMIT] = absent
        return array

    scaler, adder = numbers("total_scaler", 1.0), numbers("total_adder", 0.0)
    lower, upper, equals = numbers("lower", -np.inf), numbers("upper", np.inf), numbers("equals", np.nan)
    if is_scaled:
        lower, upper, equals = (limit / scaler - adder for limit in (lower, upper, equals))
        lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
    units, text = str(meta.get("units") or about.get("units") or ""), str(about.get("desc") or "")
    return Quantity(name, kind, units, text, lower, upper, equals, scaler, adder, values, names, is_of_grid)


def _convergence(quantities: tuple[Quantity, ...], cases: list[Case]) -> Convergence | None:
    """Violations of all points, and first-order residuals where there are derivatives."""
    designs, objectives, constraints = (
        [q for q in quantities if q.kind == kind] for kind in ("variable", "objective", "constraint")
    )
    if len(objectives) != 1 or objectives[0].values.shape[1] != 1:
        return None
    statement, points = _statement(quantities), _points(quantities, len(cases))
    violations = np.array([point.violation for point in points])
    found = []
    for n, after in enumerate(cases[1:]):  # OpenMDAO stores a gradient under the next evaluation
        totals = after.derivatives
        if totals:
            rows = ([totals[q.name, wrt.name] for wrt in designs] for q in (*objectives, *constraints))
            found.append((n, np.vstack([np.hstack(row) for row in rows])))
    residuals = [optimality(statement, points[n], matrix) for n, matrix in found]
    matrices = [matrix for _, matrix in found]
    stacked = np.array(matrices) if found else np.zeros((0, 0, 0))
    return Convergence(violations, np.array([n for n, _ in found], dtype=int), np.array(residuals), stacked)


def _statement(quantities: tuple[Quantity, ...]) -> Statement:
    """Bounds and constraints as the driver sees them."""
    bounds, limits = (tuple(q.limits() for q in quantities if q.kind == kind) for kind in ("variable", "constraint"))
    return Statement.of(bounds, limits, tolerance=0.0)


def _points(quantities: tuple[Quantity, ...], n: int) -> list[Point]:
    """All evaluations as the driver sees them."""
    x, objective, others = (
        _rows([q for q in quantities if q.kind == kind], n) for kind in ("variable", "objective", "constraint")
    )
    statement = _statement(quantities)
    return [statement.point(*point) for point in zip(x, objective[:, 0], others)]


def _rows(quantities: list[Quantity], n: int) -> np.ndarray:
    """Values of several quantities in one row for every evaluation, as the driver sees them."""
    return np.hstack([np.zeros((n, 0)), *(q.scaled(q.values) for q in quantities)])


def _best(quantities: tuple[Quantity, ...], convergence: Convergence | None, has_run: np.ndarray) -> int:
    """Number of the best evaluation."""
    if convergence is None:
        return len(has_run) - 1
    objective = next(q for q in quantities if q.kind == "objective")
    values, violations = objective.scaled(objective.values)[:, 0], convergence.violations
    feasible = has_run & (violations <= FEASIBLE)
    if feasible.any():
        return int(np.argmin(np.where(feasible, values, np.inf)))
    return int(np.argmin(np.where(has_run, violations, np.inf)))


def _others(cases: list[Case], taken: set[str]) -> dict[str, dict[int, np.ndarray]]:
    """Other recorded numeric outputs."""
    found: dict[str, dict[int, np.ndarray]] = {}
    for n, case in enumerate(cases):
        for name in case.outputs.keys() if case.outputs is not None else ():
            if name in taken:
                continue
            values = np.asarray(case.outputs[name])
            if values.dtype.kind in "fiu":
                found.setdefault(name, {})[n] = values
    return found
