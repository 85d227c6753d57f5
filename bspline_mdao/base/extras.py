"""Libraries installed on request, as extras of the package, and messages for missing ones."""

from __future__ import annotations

import importlib
from types import ModuleType

from ..errors import InputError

__all__ = ["INSTALL", "library"]

INSTALL = 'pip install "bspline_mdao[{extra}]"'
"""Command that installs an extra, in the quotes that every shell knows."""


def library(
    module: str,  # name of the module
    need: str,  # beginning of the message: what needs which library, such as ``"files of Gmsh need meshio"``
    extra: str,  # extra that installs it
    otherwise: str = "",  # what can be done without it
) -> ModuleType:
    """Import a module of an optional library."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or module.split(".")[0] == error.name.split(".")[0]:
            ways = [INSTALL.format(extra=extra), *([otherwise] if otherwise else [])]
            raise InputError(f"{need}: {', or '.join(ways)}") from None
        raise InputError(f"{need}, which needs {error.name}: pip install {error.name}") from error
    except (ImportError, OSError) as error:
        raise InputError(f"{need}, which is installed but cannot be imported: {error}") from error
