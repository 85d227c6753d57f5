"""Libraries of the extra ``report``, imported when a page is made."""

from __future__ import annotations

import importlib

from ..errors import InputError

__all__ = ["require"]


def require(name: str):
    """Import a module that pages are made with.

    Parameters
    ----------
    name : str
        Name of the module.

    Returns
    -------
    module

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        library = name.partition(".")[0]
        raise InputError(f"a report needs {library}: pip install 'bspline_mdao[report]'") from None
