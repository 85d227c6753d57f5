"""The option ``model`` of systems, its entry in case files of any recorder, and copies of systems with it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from typing import Any, NamedTuple

import openmdao.api as om
from openmdao.utils.options_dictionary import OptionsDictionary

from ..model.movable import Movable
from .option_signature import IN_RECORDS, OptionSignature

__all__ = ["Copied", "NamedModel", "declare_model", "length_units", "named_model", "systems_at"]


class NamedModel(NamedTuple):
    """A case file's entry about the optimised model."""

    checksum: str  # checksum of the model
    file: str  # file it was saved to or loaded from before the run; empty if neither


def systems_at(
    source: str,  # absolute name of an output
    inputs: Iterable[tuple[str, str]],  # absolute names of inputs, and the outputs they are connected to
    systems: Iterable[str],  # names of systems
) -> Iterator[str]:
    """Names of the systems that have an output, or an input connected to it, in the order given."""
    ends = [source, *(end for end, of in inputs if of == source)]
    return (name for name in systems if any(end.startswith(f"{name}." if name else "") for end in ends))


def length_units(
    units: str,  # units of a variable of a system with a model
    unit: str,  # unit of the model's lengths
) -> str:
    """Units of a variable in those of its grid: components count lengths of any grid in metres."""
    return re.sub(r"^m(?=$|\*\*[23]$)", unit, units)


class _InRecords:
    """Text that names a system's model, made when a recorder requests it, since the model may be saved by then."""

    def __init__(self, options: OptionsDictionary):
        self._options = options

    def __str__(self) -> str:
        try:
            model = self._options["model"]
        except RuntimeError:  # it is not set
            return ""
        return "" if model.checksum is None else f"{model.checksum} {model.file or ''}"

    __repr__ = __str__

    def __deepcopy__(self, memo: dict[int, Any]) -> _InRecords:
        return _InRecords(deepcopy(self._options, memo))

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        return str, (str(self),)  # a case file is read without this package


class Copied:
    """Mixin for systems that are copied and pickled with all their options, before ``Problem.setup``."""

    # OpenMDAO leaves out unrecordable options, such as models and meshes, which every system needs.

    options: OptionsDictionary
    __signature__ = OptionSignature()

    def __getstate__(self) -> dict:
        """State with the options as they are declared."""
        state = vars(self).copy()
        options = vars(state.pop("options")).copy()
        options["_dict"] = {name: meta for name, meta in options["_dict"].items() if name != IN_RECORDS}
        return {**state, "_all_options": options}

    def __setstate__(self, state: dict) -> None:
        """Take a state."""
        state = dict(state)
        options = state.pop("_all_options")
        self.__dict__.update(state, options=OptionsDictionary())
        self.options.__dict__.update(options)
        if "model" in self.options:
            _name_in_records(self.options)


def declare_model(
    system: om.System,  # the system
    types: type | tuple[type, ...] = Movable,  # types it accepts as a model
    desc: str = "the fitted grid",  # what the model is
) -> None:
    """Declare the option ``model``, in ``initialize``, and one that names the model in case files."""
    # The model itself is too large for case files. OpenMDAO's recorders keep the other options of all systems.
    system.options.declare("model", types=types, recordable=False, desc=desc)
    _name_in_records(system.options)


def _name_in_records(options: OptionsDictionary) -> None:
    """Declare the option that names the model in case files."""
    options.declare(IN_RECORDS, default=_InRecords(options), desc="set automatically: names the model in case files")


def named_model(
    options: Mapping[str, Mapping[str, object]],  # options of the systems by their names
) -> NamedModel | None:
    """Find the model named in the options of systems in a case file."""
    # Takes the first system that has a model; None if there is none, or if each process has only its part of it.
    texts = (str(of_system.get(IN_RECORDS) or "") for of_system in options.values())
    return next((NamedModel(*text.partition(" ")[::2]) for text in texts if text), None)
