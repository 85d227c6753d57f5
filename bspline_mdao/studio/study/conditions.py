"""The flight conditions of a study: each has its own flow on the one grid.

Keys that a condition leaves out are taken from ``[flow]``. Conditions with a given lift are trimmed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from .keys import FLOWS

__all__ = ["bare_outputs", "of_conditions", "resolved_conditions", "weights_of"]

Refuse = Callable[[Sequence[str], str], Exception]
"""Makes the error about a key from its path and a complaint."""


def resolved_conditions(
    given: Mapping[str, dict[str, Any]],  # tables of the conditions by name, None for keys that are left out
    flow: Mapping[str, Any],  # table of the flow
    refuse: Refuse,  # makes the error about a key
) -> dict[str, dict[str, Any]]:
    """Fill in the keys that conditions leave out."""
    # Returns ``Mach_number``, ``weight``, and ``trim`` with either ``CL_target`` or ``alpha``, by name.
    found = {}
    for name, table in given.items():
        target = table.get("CL_target")
        if target is not None and table["alpha"] is not None:
            raise refuse(("conditions", name, "alpha"), "is solved for if CL_target is given; leave one of them out")
        is_trimmed = target is not None or (bool(flow.get("trim")) and table["alpha"] is None)
        if is_trimmed and target is None:
            target = flow["CL_target"]
        if is_trimmed and target is None:
            raise refuse(("conditions", name), "needs a target lift; give CL_target here or in [flow]")
        found[name] = {
            "Mach_number": flow["Mach_number"] if table["Mach_number"] is None else table["Mach_number"],
            "alpha": flow["alpha"] if table["alpha"] is None else table["alpha"],
            "trim": is_trimmed,
            "CL_target": target,
            "weight": table["weight"],
        }
    return found


def of_conditions(conditions: Iterable[str], outputs: Iterable[str]) -> tuple[str, ...]:
    """Names of the outputs of all conditions, such as ``cruise.CL``."""
    return tuple(f"{condition}.{output}" for condition in conditions for output in outputs)


def bare_outputs(names: Iterable[str]) -> list[str]:
    """Outputs of a flow among names, which exist once per condition."""
    return [name for name in names if name in FLOWS["euler"].outputs]


def weights_of(conditions: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Weights of the conditions that have a positive weight."""
    return {name: table["weight"] for name, table in conditions.items() if table["weight"] > 0.0}
