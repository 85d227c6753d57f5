"""Signatures of components, groups and drivers, from their declared options.

OpenMDAO's constructors take ``**kwargs``, so neither ``help`` nor an editor knows the names. The options that a class
declares in ``initialize`` are known once an object is made, so the signature is read from there. Editors and type
checkers, which run nothing, read what ``tools/write_signatures.py`` writes into the classes.
"""

from __future__ import annotations

from inspect import Parameter, Signature
from typing import Any

from openmdao.core.component import Component
from openmdao.core.driver import Driver
from openmdao.core.explicitcomponent import ExplicitComponent
from openmdao.core.group import Group
from openmdao.core.implicitcomponent import ImplicitComponent
from openmdao.utils.options_dictionary import _UNDEFINED

__all__ = ["IN_RECORDS", "OptionSignature"]

BASES = (Group, ImplicitComponent, ExplicitComponent, Component, Driver)
"""Classes of OpenMDAO; the options that subclasses inherit from one are covered by ``**options``."""

IN_RECORDS = "model_in_records"
"""Option kept for recorders; it is set automatically and is not an argument."""


class OptionSignature:
    """Value of ``__signature__`` of a class: an argument for each option that it declares, and ``**options``."""

    def __get__(self, instance: Any, owner: type) -> Signature:
        base = next((kind for kind in BASES if issubclass(owner, kind)), None)
        if base is None:  # mixins have no options of their own
            raise AttributeError("__signature__")
        of_base = base().options._dict
        arguments = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=Parameter.empty if _is_needed(about) else about["val"])
            for name, about in owner().options._dict.items()
            if name not in of_base and name != IN_RECORDS
        ]
        return Signature([*arguments, Parameter("options", Parameter.VAR_KEYWORD)])


def _is_needed(about: dict[str, Any]) -> bool:
    """Whether an option has no default."""
    return about["val"] is _UNDEFINED
