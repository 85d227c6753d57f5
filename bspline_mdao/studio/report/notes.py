"""What a reader of a report must know before its figures: notes of one line each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...core.om.drivers.case_history import CaseHistory
from ...flow.om.mach_range import EULER, LATTICE, MachRange

__all__ = ["notes_on"]

KNOWN_BY = {"shock_threshold": EULER, "n_chord": LATTICE}
"""Options that only flows have, and the Mach numbers at which these were validated."""


def notes_on(
    history: CaseHistory,  # the optimisation
) -> list[str]:  # empty if all is well
    """Say which designs are infeasible, by what and by how much, and which Mach numbers were not validated."""
    designs = {"first": 0, "best": history.best}
    found = {name: history.infeasible(number) for name, number in designs.items()}
    notes = [f"The {name} design is {words}." for name, words in found.items() if words]
    ranges = _ranges(history.options)
    for name, mach in _mach_numbers(history):
        faults = [known.fault(mach) for known in ranges]
        if faults and all(faults):
            notes.append(f"{name.rpartition('.')[0] or 'The flow'}: {faults[0]}.")
    return notes


def _ranges(options: Mapping[str, Mapping[str, object]]) -> list[MachRange]:
    """Mach numbers at which the flows of a problem were validated."""
    names = {name for of_system in options.values() for name in of_system}
    return [known for name, known in KNOWN_BY.items() if name in names]


def _mach_numbers(history: CaseHistory) -> Iterator[tuple[str, float]]:
    """Mach numbers of the best evaluation, by name, as far as they are recorded."""
    for quantity in history.quantities:
        if quantity.name.rpartition(".")[2] == "Mach_number":
            yield quantity.name, float(quantity.values[history.best, 0])
    for name, values in history.outputs.items():
        if name.rpartition(".")[2] == "Mach_number" and history.best in values:
            yield name, float(np.ravel(values[history.best])[0])
