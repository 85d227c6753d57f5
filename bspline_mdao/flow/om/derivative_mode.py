"""Linear solves of the flow per gradient in forward and reverse mode, and a hint if the other mode takes fewer.

OpenMDAO chooses, and warns, by the sizes of all design variables and responses. The cost is in linear solves of the
flow, and measures of the shape need none: five hundred thicknesses with a lift and a drag take two in reverse.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import openmdao.api as om

from ...errors import DerivativeModeWarning

__all__ = ["flow_solves", "outputs_downstream", "outputs_upstream", "warn_of_derivative_mode"]

MUCH = 2.0
"""The other mode is suggested if it takes fewer solves by this factor."""

WORDS = {"fwd": "forward", "rev": "in reverse"}
"""The modes in words."""


def outputs_downstream(model: om.Group, outputs: set[str]) -> set[str]:
    """Absolute names of the outputs that depend on any of some outputs, and these; by components, not by partials."""
    sources = model._conn_global_abs_in2out
    responses = {meta["source"] for meta in model.get_responses(get_sizes=False).values()}
    known = {*sources.values(), *responses}

    def next_of(new: set[str]) -> set[str]:
        components = {to.rpartition(".")[0] for to, source in sources.items() if source in new}
        return {output for output in known if output.rpartition(".")[0] in components}

    return _closed(outputs, next_of)


def outputs_upstream(model: om.Group, outputs: set[str]) -> set[str]:
    """Absolute names of the outputs on which any of some outputs depends, and these; by components, not by partials."""
    sources = model._conn_global_abs_in2out

    def next_of(new: set[str]) -> set[str]:
        components = {output.rpartition(".")[0] for output in new}
        return {source for to, source in sources.items() if to.rpartition(".")[0] in components}

    return _closed(outputs, next_of)


def _closed(outputs: set[str], next_of: Callable[[set[str]], set[str]]) -> set[str]:
    """Outputs and everything reachable from them."""
    reached: set[str] = set()
    new = set(outputs)
    while new:
        reached |= new
        new = next_of(new) - reached
    return reached


def flow_solves(
    component: om.ImplicitComponent,  # solves for the state
    state: str,  # name of the state
) -> dict[str, int]:
    """Linear solves of a state for the totals of the driver in both modes, one by one."""
    # Returns by ``"fwd"`` and ``"rev"``: design variables that the state depends on, responses that depend on it.
    model, name = component._problem_meta["model_ref"](), {f"{component.pathname}.{state}"}
    before, after = outputs_upstream(model, name), outputs_downstream(model, name)
    designs = model.get_design_vars().values()
    responses = [meta for meta in model.get_responses().values() if not meta.get("linear")]
    return {
        "fwd": sum(meta["size"] for meta in designs if meta["source"] in before),
        "rev": sum(meta["size"] for meta in responses if meta["source"] in after),
    }


def warn_of_derivative_mode(component: om.ImplicitComponent, state: str) -> None:
    """Warn if the other mode takes far fewer solves."""
    solves, mode = flow_solves(component, state), component._problem_meta["mode"]
    other = "rev" if mode == "fwd" else "fwd"
    if 0 < MUCH * solves[other] <= solves[mode]:
        warnings.warn(
            f"{component.pathname}: gradients are taken {WORDS[mode]}, by {solves[mode]} linear solves of the flow, "
            f"where {solves[other]} {WORDS[other]} would do; call setup(mode='{other}')",
            DerivativeModeWarning,
            stacklevel=2,
        )
