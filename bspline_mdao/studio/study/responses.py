"""Responses of a study: outputs of the problem, or of components that compute them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from .conditions import bare_outputs, of_conditions, weights_of
from .expressions import is_name, names_in, renamed
from .keys import FLOWS

__all__ = ["Response", "constraint_responses", "objective_response"]

Conditions = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Response:
    """A response of the problem."""

    name: str  # name of the constraint, or ``objective``
    output: str  # output of the problem
    formula: str = ""  # its formula in other outputs; empty if the output exists already

    @property
    def component(self) -> str:
        """Component that computes it."""
        return f"{self.name}_expression"

    @property
    def of_flow(self) -> bool:
        """Whether it depends on a flow."""
        names = names_in(self.formula or self.output)
        return any(name.rpartition(".")[2] in FLOWS["euler"].outputs for name in names)

    def far_and_near(self, conditions: Iterable[str]) -> tuple[list[str], list[str]]:
        """Outputs in its formula: outputs of conditions, and promoted outputs."""
        of_flows = of_conditions(conditions, FLOWS["euler"].outputs)
        names = names_in(self.formula)
        return [name for name in names if name in of_flows], [name for name in names if name not in of_flows]

    @property
    def equation(self) -> str:
        """Output and formula, with names that an ``om.ExecComp`` accepts."""
        return f"{self.output} = {renamed(self.formula, flat_name)}"


def objective_response(of: str, conditions: Conditions) -> Response:
    """Response of an objective; outputs of the flow without a condition are averaged over all conditions."""
    weights = weights_of(conditions)
    if not conditions or not bare_outputs(names_in(of)):
        return _response("objective", of)
    parts = {name: _at_condition(of, name) for name in weights}
    if len(parts) == 1:
        return _response("objective", *parts.values())
    parts = {name: part if is_name(part) or weights[name] == 1.0 else f"({part})" for name, part in parts.items()}
    terms = [part if weights[name] == 1.0 else f"{weights[name]} * {part}" for name, part in parts.items()]
    output = f"mean_{of}" if is_name(of) else "objective_value"
    total, mean = f"{sum(weights.values()):.12g}", " + ".join(terms)
    return Response("objective", output, mean if total == "1" else f"({mean}) / {total}")


def constraint_responses(name: str, of: str, conditions: Conditions) -> Iterator[Response]:
    """Responses of a constraint; outputs of the flow without a condition make one for each."""
    key = flat_name(name)
    if not conditions or not bare_outputs(names_in(of)):
        yield _response(key, of)
        return
    for each in conditions:
        yield _response(f"{key}_{each}", _at_condition(of, each))


def flat_name(name: str) -> str:
    """Name of an input for an output of a condition."""
    return name.replace(".", "_")


def _response(name: str, of: str) -> Response:
    return Response(name, of) if is_name(of) else Response(name, f"{name}_value", of)


def _at_condition(of: str, condition: str) -> str:
    """Write an expression of outputs of the flow for one condition."""
    bare = bare_outputs(names_in(of))
    return renamed(of, lambda name: f"{condition}.{name}" if name in bare else name)
