"""The model as seen by an optimizer, in one scaled vector. All use of OpenMDAO's private driver API is in this module.

OpenMDAO moved the scaling of design variables and constraints twice. Up to 3.43 the limits in the metadata are scaled
when they are declared. From 3.44 on an autoscaler scales vectors; its ``get_bounds_scaling`` returns three vectors up
to 3.45.0 and a dictionary of limits by name from 3.45.1 on.

Theory: ``docs/theory/drivers.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import openmdao.api as om
from numpy.typing import ArrayLike
from openmdao.core.component import Component
from openmdao.core.driver import Driver, RecordingDebugging
from openmdao.core.group import Group
from scipy.sparse import issparse

from ....base.numerics.processes import together
from ....base.text import value_names
from ....errors import InputError
from .nlopt_problem import AnalysisFailed, Limits

__all__ = ["ScaledModel", "derivative_at_fault", "unusable_derivatives"]

NO_LIMIT = 1e16
"""Scaled limits beyond this count as absent: OpenMDAO writes 1e30 for infinity, which scaling may reduce."""


def _as_limit(value: ArrayLike | None, size: int, absent: float) -> np.ndarray:
    """A limit as an array, `absent` if there is none."""
    array = np.array(np.broadcast_to(absent if value is None else value, (size,)), dtype=float)
    array[np.abs(array) >= NO_LIMIT] = absent
    return array


def _scaled_limits(driver: Driver, kind: str, name: str, meta: dict) -> tuple:
    """Scaled lower limit, upper limit and required value, as this version of OpenMDAO gives them."""
    autoscaler = getattr(driver, "_autoscaler", None)
    if autoscaler is None:
        return meta["lower"], meta["upper"], meta.get("equals")
    scaled = autoscaler.get_bounds_scaling(kind)
    if isinstance(scaled, tuple):
        lower, upper, equals = scaled
        return lower[name], upper[name], equals[name] if meta.get("equals") is not None else None
    return scaled[name].lower, scaled[name].upper, scaled[name].equals


def _scaling(driver: Driver, kind: str, name: str, meta: dict) -> tuple[np.ndarray, np.ndarray]:
    """Scaler and adder of a variable: the driver sees ``(value + adder) scaler``."""
    autoscaler = getattr(driver, "_autoscaler", None)
    found = autoscaler._var_meta[kind][name] if autoscaler else meta
    scaler, adder = found["total_scaler"], found["total_adder"]
    return np.asarray(1.0 if scaler is None else scaler), np.asarray(0.0 if adder is None else adder)


def _is_flipped(driver: Driver, kind: str, name: str, meta: dict) -> np.ndarray:
    """Whether the scaling reverses the variable, so its lower limit becomes the upper one."""
    return _scaling(driver, kind, name, meta)[0] < 0


def _limits(driver: Driver, kind: str, name: str, meta: dict, size: int) -> Limits:
    """Limits of one design variable or constraint."""
    lower, upper, equals = _scaled_limits(driver, kind, name, meta)
    lower, upper = _as_limit(lower, size, -np.inf), _as_limit(upper, size, np.inf)
    is_flipped = np.broadcast_to(_is_flipped(driver, kind, name, meta), (size,))
    turned = np.where(np.isinf(upper), -np.inf, upper), np.where(np.isinf(lower), np.inf, lower)
    lower, upper = np.where(is_flipped, turned[0], lower), np.where(is_flipped, turned[1], upper)
    return Limits(name, lower, upper, np.array(np.broadcast_to(np.nan if equals is None else equals, (size,)), float))


def _flat(values: Iterable[np.ndarray]) -> np.ndarray:
    """Values of all variables in one vector."""
    return np.concatenate([np.zeros(0), *(np.ravel(value) for value in values)])


def derivative_at_fault(driver: Driver, responses: Sequence[str], totals: np.ndarray) -> str:
    """Name of a derivative that is not finite, if the totals of responses have one; empty otherwise."""
    # totals: (size of all responses, size of all variables). A partial that is not finite also spoils totals that do
    # not depend on it, so the first such partial is named, ``d CD / d twist of component aero``. If all partials are
    # finite, or components are matrix-free, a total is named.
    wrong = np.argwhere(~np.isfinite(totals))
    if not len(wrong):
        return ""
    for component in driver._problem().model.system_iter(recurse=True, typ=Component):
        for (of, wrt), info in component._subjacs_info.items():
            if info["val"] is not None and not np.isfinite(_numbers(info["val"])).all():
                names = (name.rpartition(".")[2] for name in (of, wrt))
                return f"d {' / d '.join(names)} of component {component.pathname}"
    of, wrt = wrong[0]
    variables = list(driver._designvars)
    return f"d {_owner(responses, driver._responses, of)} / d {_owner(variables, driver._designvars, wrt)}"


def _numbers(value: Any) -> np.ndarray:
    """Entries of a partial, dense or sparse."""
    return np.asarray(value.data if issparse(value) else value, dtype=float)


def _owner(names: Sequence[str], metas: dict, number: int) -> str:
    """Which of several concatenated variables an entry belongs to."""
    ends = np.cumsum([metas[name]["global_size"] for name in names])
    return names[int(np.searchsorted(ends, number, side="right"))]


def unusable_derivatives(what: str) -> InputError:
    """Error for derivatives with which no search can start."""
    return InputError(
        f"driver: {what}, the first time that derivatives are computed; check_partials shows which are wrong"
    )


class ScaledModel:
    """The model of a driver's problem as a function of one scaled vector of all design variables."""

    # Nonlinear constraints come first, each kind in the order of the driver.

    def __init__(
        self,
        driver: Driver,  # A driver that has been set up
    ):
        self._driver = driver
        self._model = driver._problem().model
        self._designs = dict(driver._designvars)
        self._constraints = dict(sorted(driver._cons.items(), key=lambda item: bool(item[1]["linear"])))
        self._good_states = self._kept_states = np.zeros(0)
        self._linear_totals: np.ndarray | None = None
        self._is_first = True
        driver._total_jac = driver._total_jac_linear = None

    @property
    def has_derivatives(self) -> bool:
        """Whether the problem was set up with derivatives."""
        return bool(self._model._use_derivatives)

    def start(self) -> tuple[np.ndarray, float, np.ndarray]:
        """Run at the present design variables; returns them (n,), the objective and the constraints (m,)."""
        self._driver._check_for_missing_objective()
        self._driver._check_for_invalid_desvar_values()
        self._solve()
        self._good_states, self._kept_states = self._states().copy(), self._states().copy()
        try:
            self._require_numbers("the objective or a constraint at the start", *self._responses())
        except AnalysisFailed as error:
            raise om.AnalysisError(str(error)) from None
        return self.present()

    def present(self) -> tuple[np.ndarray, float, np.ndarray]:
        """Design variables (n,), objective and constraints (m,) as the last run left them."""
        return _flat(self._driver.get_design_var_values().values()), *self._responses()

    def run(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Run at a point (n,); returns the objective and the constraints (m,)."""
        self.set(x)
        try:
            self._solve()
            objective, constraints = self._responses()
            self._require_numbers("the objective or a constraint", objective, constraints)
        except (om.AnalysisError, AnalysisFailed) as error:
            self._states()[:] = self._good_states
            raise AnalysisFailed(str(error)) from error
        self._good_states[:] = self._states()
        return objective, constraints

    def keep(self) -> None:
        """Store the states of the last run, the best point, for `restore`."""
        self._kept_states[:] = self._good_states

    def restore(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Run at the point (n,) whose states were stored, see `run`: from others a flow may not converge again."""
        self._states()[:] = self._kept_states
        return self.run(x)

    def place(self, x: np.ndarray) -> None:
        """Set the design variables (n,) and restore the states of the last good point, without a run."""
        self._states()[:] = self._good_states
        self.set(x)

    def sizes(self, kind: str) -> dict[str, int]:
        """Numbers of values of the design variables, objectives or constraints, by name."""
        take = getattr(self._driver, f"get_{kind}_values")
        return {name: np.size(values) for name, values in take().items()}

    def scaled(self, values: Mapping[str, np.ndarray]) -> tuple[np.ndarray, float, np.ndarray]:
        """Design variables (n,), objective and constraints (m,) from values by name, in units of the model."""
        objective = self._scaled("objective", self._driver._objs, values)
        constraints = self._scaled("constraint", self._constraints, values)
        return self._scaled("design_var", self._designs, values), float(objective[0]), constraints

    def _scaled(self, kind: str, metas: Mapping[str, dict], values: Mapping[str, np.ndarray]) -> np.ndarray:
        """One scaled vector from values of one kind by name, in units of the model."""
        scalings = {name: _scaling(self._driver, kind, name, meta) for name, meta in metas.items()}
        return _flat((values[name] + adder) * scaler for name, (scaler, adder) in scalings.items())

    def design_variables(self) -> dict[str, dict[str, Any]]:
        """Names, units, bounds and present values of the design variables, unscaled, as DOE generators need them."""
        found, driver = {}, self._driver
        values = driver.get_design_var_values()
        for limits in self.design_limits():
            meta = self._designs[limits.name]
            scaler, adder = _scaling(driver, "design_var", limits.name, meta)
            ends = [(end / scaler) - adder for end in (limits.lower, limits.upper, values[limits.name])]
            size, indices = len(limits.lower), meta.get("indices")
            found[limits.name] = {
                "size": size,
                "names": value_names(limits.name, size, None if indices is None else indices.shaped_array(flat=True)),
                "units": meta.get("units") or self._model.get_io_metadata()[meta["source"]]["units"],
                "lower": np.where(scaler < 0, ends[1], ends[0]),
                "upper": np.where(scaler < 0, ends[0], ends[1]),
                "value": np.asarray(ends[2], dtype=float),
            }
        return found

    def set_values(self, values: Mapping[str, np.ndarray]) -> None:
        """Set unscaled design variables by name, without a run."""
        self.set(self._scaled("design_var", self._designs, values))

    def set(self, x: np.ndarray) -> None:
        """Set the scaled design variables (n,), without a run."""
        driver = self._driver
        if getattr(driver, "_vectors", None):
            driver._vectors["design_var"].set_data(x, driver_scaling=True)
            driver._set_design_vars(driver_scaling=True)
        else:
            driver._scipy_update_design_vars(x)

    def differentiate(self) -> np.ndarray:
        """Totals (1 + m, n) of objective and constraints at the last run's point; linear ones are computed once."""
        # `AnalysisFailed` if a component raised ``om.AnalysisError`` or a derivative is not finite; `InputError` if a
        # derivative is not finite the first time, since no search can start.
        is_first, self._is_first = self._is_first, False
        if is_first:
            self._prepare_derivatives()
        try:
            responses = self._driver._get_ordered_nl_responses()
            totals = self._totals(responses)
            self._require_numbers(derivative_at_fault(self._driver, responses, totals) or "a derivative", totals)
        except om.AnalysisError as error:
            raise AnalysisFailed(str(error)) from error
        except AnalysisFailed as error:
            if not is_first:
                raise
            raise unusable_derivatives(str(error)) from None
        if is_first:
            self._check_for_zeros()
        return totals if self._linear_totals is None else np.vstack([totals, self._linear_totals])

    def differentiate_in(self, name: str) -> np.ndarray:
        """Totals (1 + m, size) of objective and constraints with respect to any output of the model, in its units."""
        problem = self._driver._problem()
        names = [*self._driver._objs, *self._constraints]
        return np.array(problem.compute_totals(names, [name], return_format="array", driver_scaling=True))

    def design_limits(self) -> tuple[Limits, ...]:
        """Scaled bounds of the design variables."""
        values = self._driver.get_design_var_values()
        return tuple(
            _limits(self._driver, "design_var", name, meta, np.size(values[name]))
            for name, meta in self._designs.items()
        )

    def constraint_limits(self) -> tuple[Limits, ...]:
        """Scaled limits of the constraints."""
        values = self._driver.get_constraint_values()
        return tuple(
            _limits(self._driver, "constraint", name, meta, np.size(values[name]))
            for name, meta in self._constraints.items()
        )

    def _solve(self) -> None:
        """Run the model, record and print."""
        driver = self._driver
        with RecordingDebugging(driver._get_name(), driver.iter_count, driver):
            driver.iter_count += 1
            with self._model._relevance.nonlinear_active("iter"):
                driver._run_solve_nonlinear()

    def _states(self) -> np.ndarray:
        """All outputs of the model, to be read and written."""
        return self._model._outputs.asarray()

    def _responses(self) -> tuple[float, np.ndarray]:
        """Objective and constraints (m,) of the last run."""
        (objective,) = self._driver.get_objective_values().values()
        values = self._driver.get_constraint_values()
        return float(np.ravel(objective)[0]), _flat(values[name] for name in self._constraints)

    def _require_numbers(self, what: str, *arrays: float | np.ndarray) -> None:
        """Treat numbers that are not finite on any process as a failed analysis."""
        with together(self._model.comm):
            if not all(np.isfinite(array).all() for array in arrays):
                raise AnalysisFailed(f"{what} is not a finite number")

    def _totals(self, names: list[str]) -> np.ndarray:
        """Totals of some responses with respect to all design variables."""
        return np.array(self._driver._compute_totals(names, list(self._designs), "array"))

    def _prepare_derivatives(self) -> None:
        """Compute the totals of the linear constraints, and the others' colouring if one was declared."""
        driver = self._driver
        linear = [name for name, meta in self._constraints.items() if meta["linear"]]
        self._linear_totals = self._totals(linear) if linear else None
        driver._problem().get_total_coloring(driver._coloring_info, run_model=False)

    def _check_for_zeros(self) -> None:
        """Warn of rows and columns of zeros in the totals, or refuse them, as the driver's options say."""
        options, jacobian = self._driver.options, self._driver._total_jac
        if "singular_jac_behavior" not in options:  # for the plain driver, which runs the model once
            return
        has_approximations = any(group._has_approx for group in self._model.system_iter(True, True, Group))
        if options["singular_jac_behavior"] != "ignore" and jacobian is not None and not has_approximations:
            jacobian.check_total_jac(options["singular_jac_behavior"] == "error", options["singular_jac_tol"])
