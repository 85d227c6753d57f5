"""An optimisation problem in numbers: objective, variables, constraints and other outputs."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import openmdao.api as om

from ...base.display import OneLine
from ...base.text import value_names
from ...core.model.movable import Movable
from ...core.om.drivers.violations import TOLERATED, Violation, in_words, violations_of
from ...core.om.model_option import length_units, systems_at
from ...errors import InputError
from ...flow.euler.error_estimate import ErrorEstimate
from ...flow.functionals import OF_SECTION, numbers
from ...flow.om.error_estimate import error_estimate
from ...flow.om.euler_flow import EulerFlow
from ...flow.om.finer_flow import solved_on_finer_grid
from ...flow.om.induced_gain import induced_gains
from ...flow.om.spurious_drag import induced_and_least, warn_below_the_ellipse
from ...grids.io.disk import replaced_file

__all__ = ["DesignSummary", "SummaryEntry", "design_summary"]

_MOST_VALUES = 12
"""Largest number of values of an entry in a table; above it, the table shows the smallest and the largest."""

_UNBOUNDED = 1e29
"""Values from here on are no bounds, by OpenMDAO's convention of 1e30."""


@dataclass(frozen=True, eq=False)
class SummaryEntry(OneLine):
    """Values of one variable or response."""

    role: str  # ``"objective"``, ``"variable"``, ``"constraint"`` or ``"output"``
    name: str  # its name
    units: str  # its units, empty if there are none
    # values, lower, upper: (n,), values and bounds; NaN if there is no bound
    values: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    value_names: tuple[str, ...]  # names of the values, such as ``twist[2]``
    unit: np.ndarray  # () or (n,), what the driver sees as 1

    def at_bounds(self, most: int | None = None) -> list[str]:
        """Remarks on values of a variable at its bounds: one a value, or two for more values than ``most``."""
        n = len(self.values)
        is_short = most is not None and n > most
        if self.role != "variable":
            return [""] * (2 if is_short else n)
        near = TOLERATED * np.fmin(self.upper - self.lower, self.unit)
        bounds = ("lower", self.lower), ("upper", self.upper)
        sides = [(side, np.abs(self.values - bound) <= near) for side, bound in bounds]
        if is_short:
            return [f"{int(is_at.sum())} at the {side} bound" if is_at.any() else "" for side, is_at in sides]
        return [" and ".join(f"at the {side} bound" for side, is_at in sides if is_at[number]) for number in range(n)]

    @property
    def violations(self) -> list[Violation]:
        """The values that violate their bounds."""
        return violations_of(self.value_names, self.values, self.lower, self.upper, self.unit)


@dataclass(frozen=True, eq=False)
class DesignSummary(OneLine):
    """Objective, design variables, constraints and other outputs of a problem as it is; made by `design_summary`.

    Parameters
    ----------
    entries : tuple of SummaryEntry
        The objective first.
    estimates : mapping of str to ErrorEstimate
        By the names of entries, estimates of lift and drag on a finer member of the grid's family, if they were
        requested.
    notes : tuple of str
        Remarks on the entries, such as whether coefficients are of a section.
    solved : mapping of str to float
        By the names of entries, results of flows on a finer member, if they were requested.

    Examples
    --------
    >>> import tempfile
    >>> import openmdao.api as om
    >>> from bspline_mdao import design_summary
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", om.ExecComp("f = (x - 3)**2"), promotes=["*"])
    >>> problem.model.add_design_var("x", lower=-5.0, upper=5.0)
    >>> problem.model.add_objective("f")
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> summary = design_summary(problem)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     summary.write_csv(f"{folder}/design.csv")
    >>> [entry.name for entry in summary.entries]
    ['f', 'x']
    """

    entries: tuple[SummaryEntry, ...]
    estimates: Mapping[str, ErrorEstimate] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    solved: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        """Write the table of its values."""
        return self.table()

    @property
    def infeasible(self) -> str:
        """Which bounds the design violates, and by how much, in words; empty if it satisfies all.

        A bound counts as met within a ten-thousandth of its value, or of what the driver sees as 1 if it is zero.
        """
        return in_words([violation for entry in self.entries for violation in entry.violations])

    def table(self, before: DesignSummary | None = None) -> str:
        """Write a table of the values, next to another summary of the same problem.

        If errors are estimated, the value on the finer member comes last, with its uncertainty. If flows were solved on
        a finer member, their results follow. Variables at a bound are marked. If errors are estimated in both
        summaries, a line for each induced drag gives the reduction on either grid. Below the table stands whether a
        design is infeasible, which bounds it violates, and by how much.

        Parameters
        ----------
        before : DesignSummary, optional
            Summary of the same problem at another design.

        Returns
        -------
        str
            Lines of text.
        """
        heads = ("", *self._heads(before, ("finer grid", "+-"), ("solved finer",), ("finer before", "finer after")))
        rows: list[tuple[str, ...]] = []
        marks = [mark for entry in self.entries for mark in entry.at_bounds(_MOST_VALUES)]
        for (role, label, columns), mark in zip(self._rows(before, _MOST_VALUES), marks):
            if not rows or rows[-1][0] != role:
                rows.append((role, *heads, ""))
            rows.append((role, label, *(_number(value) for value in columns), mark))
        widths = [max(len(row[n]) for row in rows) for n in range(1, len(heads) + 1)]
        lines = []
        for role, label, *cells, mark in rows:
            title = f"{role}s" if label == "" and role != "objective" else role if label == "" else f"  {label}"
            padded = (cell.rjust(width) for cell, width in zip(cells, widths[1:]))
            lines.append(f"{title:<{max(widths[0] + 2, 12)}}  {'  '.join(padded)}{mark and f'  {mark}'}".rstrip())
        lines += self.notes
        lines += [gain.words for gain in induced_gains(before.estimates if before else {}, self.estimates)]
        designs = (("before: ", before), ("after: ", self)) if before else (("", self),)
        lines += [f"{label}{summary.infeasible}" for label, summary in designs if summary.infeasible]
        return "\n".join(lines)

    def write_csv(self, path: str | os.PathLike, before: DesignSummary | None = None) -> None:
        """Write all values to a CSV file: role, name of the value such as ``twist[2]``, values and bounds.

        If errors are estimated, ``finer`` and ``remaining`` come next, see `ErrorEstimate`. If flows were solved on a
        finer member, ``solved_finer`` comes next, or ``finer_before`` and ``finer_after`` for two designs. Then comes
        ``infeasible``, or ``infeasible_before`` and ``infeasible_after`` for two designs: the amount by which a value
        violates its bound. Last comes ``at_bound``, the mark of variables at a bound in `table`.

        Parameters
        ----------
        path : path-like
            File to create or to replace.
        before : DesignSummary, optional
            Summary of the same problem at another design.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        designs = (before, self) if before else (self,)
        beyond = [{v.name: v.excess for entry in each.entries for v in entry.violations} for each in designs]
        last = ("infeasible_before", "infeasible_after") if before else ("infeasible",)
        solved = ("solved_finer",), ("finer_before", "finer_after")
        heads = ("role", "name", *self._heads(before, ("finer", "remaining"), *solved), *last, "at_bound")
        names = [name for entry in self.entries for name in entry.value_names]
        marks = [mark for entry in self.entries for mark in entry.at_bounds()]
        rows = zip(self._rows(before, None), names, marks)
        with replaced_file(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(heads)
            for (role, label, columns), name, mark in rows:
                columns += [excess.get(name, np.nan) for excess in beyond]
                writer.writerow([role, label, *map(_exact, columns), mark])

    def numbers(self) -> dict[str, dict]:
        """Values and bounds by name, as lists, for JSON.

        ``infeasible`` is the amount by which values violate their bounds. ``finer`` and ``remaining`` are present if
        errors are estimated.
        """
        found = {
            entry.name: {
                "role": entry.role,
                "units": entry.units or None,
                "values": entry.values.tolist(),
                "lower": entry.lower.tolist(),
                "upper": entry.upper.tolist(),
                "infeasible": {violation.name: violation.excess for violation in entry.violations},
            }
            for entry in self.entries
        }
        for name, estimate in self.estimates.items():
            found[name] |= {"finer": estimate.finer, "remaining": estimate.remaining}
        for name, value in self.solved.items():
            found[name] |= {"solved_finer": value}
        return found

    def _heads(
        self,
        before: DesignSummary | None,
        of_estimates: tuple[str, ...],
        of_solved: tuple[str, ...],
        of_both: tuple[str, ...],
    ) -> tuple[str, ...]:
        """Heads of the columns of values, bounds, estimates, and results on a finer grid, for one or two summaries."""
        values = ("before", "after") if before else ("value",)
        solved = (of_both if before else of_solved) if self.solved else ()
        return (*values, "lower", "upper", *(of_estimates if self.estimates else ()), *solved)

    def _rows(self, before: DesignSummary | None, most: int | None) -> Iterator[tuple[str, str, list[float]]]:
        """Role, label and numbers of every row; the extremes of entries with more values than ``most``."""
        previous = {entry.name: entry for entry in before.entries} if before else {}
        for entry in self.entries:
            columns = [entry.values, entry.lower, entry.upper]
            if before:
                if entry.name not in previous or len(previous[entry.name].values) != len(entry.values):
                    raise InputError(f"summary: '{entry.name}' is not in the one before; give one of the same problem")
                columns.insert(0, previous[entry.name].values)
            if self.estimates:
                estimate = self.estimates.get(entry.name)
                numbers = (estimate.finer, estimate.remaining) if estimate else (np.nan, np.nan)
                columns += [np.full(len(entry.values), number) for number in numbers]
            if self.solved:
                designs = (before, self) if before else (self,)
                columns += [np.full(len(entry.values), each.solved.get(entry.name, np.nan)) for each in designs]
            units, n = f" ({entry.units})" if entry.units else "", len(entry.values)
            if most is not None and n > most:
                for word, extreme in (("smallest", np.min), ("largest", np.max)):
                    yield entry.role, f"{entry.name}, {word} of {n}{units}", [float(extreme(x)) for x in columns]
                continue
            for number, label in enumerate(entry.value_names):
                yield entry.role, f"{label}{units}", [float(x[number]) for x in columns]


def design_summary(
    problem: om.Problem, outputs: Sequence[str] = (), finer: float | None = None, solved_on: float | None = None
) -> DesignSummary:
    """Summarise objective, design variables and constraints of a problem, in their own units.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has been run.
    outputs : sequence of str
        Other outputs to include, such as ``"CD"``. Objectives and constraints are listed once. Outputs that the flow
        about a section does not have, such as ``"CD_induced"``, are left out.
    finer : float, optional
        Factor on the cells per direction of a finer member of the grid's family, on which lift, drag and other numbers
        of every `EulerFlow` are estimated, see `error_estimate`. If that is not possible, a warning gives the reason. A
        warning also reports an induced drag below the elliptical one.
    solved_on : float, optional
        The same for a member on which the flow of every `EulerFlow` is solved, at its lift if it is trimmed, otherwise
        at its angle of attack.

    Returns
    -------
    DesignSummary

    Raises
    ------
    InputError
        If there is no such output, or the finer member is not finer.

    Examples
    --------
    >>> import openmdao.api as om
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("f", om.ExecComp("f = (x - 3)**2"), promotes=["*"])
    >>> problem.model.add_design_var("x", lower=-5.0, upper=5.0)
    >>> problem.model.add_objective("f")
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> print(design_summary(problem))
    objective     value  lower  upper
      f               4
    variables     value  lower  upper
      x               1     -5      5
    """
    for name, factor in (("finer", finer), ("solved_on", solved_on)):
        if factor is not None and not factor > 1.0:
            raise InputError(f"summary: {name} is {factor!r}; give a number above 1, such as 1.5, or leave it out")
    problem.final_setup()
    driver = problem.driver
    found = (
        ("objective", driver._objs, driver.get_objective_values(driver_scaling=False)),
        ("variable", driver._designvars, driver.get_design_var_values(driver_scaling=False)),
        ("constraint", driver._cons, driver.get_constraint_values(driver_scaling=False)),
    )
    is_scaled = getattr(driver, "_autoscaler", None) is None
    entries = [
        _entry(role, metas[name], np.ravel(values), is_scaled, _length_unit(problem, metas[name]["source"]))
        for role, metas, all_values in found
        for name, values in all_values.items()
    ]
    flows = problem.model.system_iter(include_self=True, recurse=True, typ=EulerFlow)
    sections, of_sections = [flow for flow in flows if flow.is_section], numbers("euler", is_section=True)
    taken = {entry.name for entry in entries}
    sources = {_name(meta): meta["source"] for _, metas, _ in found for meta in metas.values()}
    for name in (name for name in outputs if name not in taken):
        try:
            values, nothing = np.ravel(problem.get_val(name)), np.full(np.size(problem.get_val(name)), np.nan)
        except KeyError:
            raise InputError(f"summary: the problem has no output '{name}'; leave it out") from None
        source = problem.model.get_source(name)
        if any(_is_of(flow, source) and source.rpartition(".")[2] not in of_sections for flow in sections):
            continue
        names = value_names(name, values.size)
        entries.append(SummaryEntry("output", name, "", values.copy(), nothing, nothing, names, np.ones(())))
        sources[name] = source
    has_section = any(_is_of(flow, source) for flow in sections for source in sources.values())
    estimates = _estimates(problem, sources, finer) if finer is not None else {}
    solved = _solved(problem, sources, solved_on) if solved_on is not None else {}
    notes = [OF_SECTION] if has_section else []
    notes += [f"finer: flows solved on a grid of {solved_on:g} times the cells per direction"] if solved else []
    return DesignSummary(tuple(entries), estimates, tuple(notes), solved)


def _is_of(flow: EulerFlow, source: str, *others: str) -> bool:
    """Whether an output, by its absolute name, is a number of a flow, or an alias of one."""
    inside = f"{flow.pathname}." if flow.pathname else ""
    return source.startswith(inside) and source.rpartition(".")[2] in (*numbers("euler"), *others)


def _solved(problem: om.Problem, sources: Mapping[str, str], factor: float) -> dict[str, float]:
    """Results, on a finer member, of flows among outputs, given by name with their absolute names."""
    solved: dict[str, float] = {}
    for flow in problem.model.system_iter(include_self=True, recurse=True, typ=EulerFlow):
        of = {name: source.rpartition(".")[2] for name, source in sources.items() if _is_of(flow, source, "alpha")}
        if not of:
            continue
        try:
            found = solved_on_finer_grid(flow, factor)
        except (InputError, om.AnalysisError) as error:  # as with estimates
            om.issue_warning(f"summary: {', '.join(of)} are not solved for on a finer grid: {error}")
            continue
        solved |= {name: found[number] for name, number in of.items() if number in found}
    return solved


def _estimates(problem: om.Problem, sources: Mapping[str, str], factor: float) -> dict[str, ErrorEstimate]:
    """Estimate the errors of lift and drag among outputs, given by name with their absolute names."""
    estimates: dict[str, ErrorEstimate] = {}
    for flow in problem.model.system_iter(include_self=True, recurse=True, typ=EulerFlow):
        of = {name: source.rpartition(".")[2] for name, source in sources.items() if _is_of(flow, source)}
        if not of:
            continue
        try:
            found = error_estimate(problem, sorted(set(of.values())), factor, flow)
        except (InputError, om.AnalysisError) as error:  # the summary is worth more than its errors
            om.issue_warning(f"summary: the errors of {', '.join(of)} are not estimated: {error}")
            continue
        estimates |= {name: found[coefficient] for name, coefficient in of.items()}
        if "CD_induced" in found and not flow.is_section:
            warn_below_the_ellipse(flow.pathname, *induced_and_least(flow))
    return estimates


def _name(meta: dict) -> str:
    """Name of a variable or response."""
    return str(meta.get("alias") or meta["name"])


def _length_unit(problem: om.Problem, source: str) -> str:
    """Unit of the grid that a variable moves, or a response is of: components count lengths of any grid in metres."""
    systems = problem.model.system_iter(include_self=True, recurse=True)
    models = {system.pathname: system.options["model"] for system in systems if "model" in system.options}
    name = next(systems_at(source, problem.model._conn_global_abs_in2out.items(), models), None)
    model = None if name is None else models[name]
    return model.length_unit if isinstance(model, Movable) else "m"


def _entry(role: str, meta: dict, values: np.ndarray, is_scaled: bool, length_unit: str) -> SummaryEntry:
    """Record one variable or response, with its bounds in its own units."""
    # Up to OpenMDAO 3.43 the bounds are scaled when they are declared.

    def bound_of(key: str) -> np.ndarray:
        bound = meta.get("equals") if meta.get("equals") is not None else meta.get(key)
        bound = np.broadcast_to(np.ravel(np.nan if bound is None else bound), values.shape).astype(float)
        for step, factor in (("total_scaler", np.divide), ("total_adder", np.subtract)):
            if is_scaled and meta.get(step) is not None:
                bound = factor(bound, meta[step])
        return np.where(np.abs(bound) < _UNBOUNDED, bound, np.nan)

    name, indices, units = _name(meta), meta.get("indices"), meta.get("units") or ""
    units = length_units(units, length_unit)
    names = value_names(name, values.size, None if indices is None else indices.shaped_array(flat=True))
    scaler = meta.get("total_scaler")
    unit = np.ones(()) if scaler is None else 1.0 / np.abs(scaler)
    return SummaryEntry(role, name, units, values.copy(), bound_of("lower"), bound_of("upper"), names, unit)


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.6g}"


def _exact(value: float) -> str:
    return "" if np.isnan(value) else repr(value)
