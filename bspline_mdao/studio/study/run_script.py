"""Runs of the script of a study: errors about its walls name the file and the line of the key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...errors import InputError
from .study import Study
from .toml_lines import key_lines

__all__ = ["run_script"]

NAMING_WALLS = ("design", "fixed", "released", "sliding")
"""Keys of ``[grid]`` that name patches."""


def run_script(
    study: Study,  # the study
    script: str,  # its script
    file: Path,  # where the script is
    names: dict[str, Any],  # filled with all names that it defines
) -> None:
    """Run the script of a study as a program."""
    names |= {"__name__": "__main__", "__file__": str(file)}
    try:
        exec(compile(script, str(file), "exec"), names)
    except InputError as error:
        if "model" in names and "wing" not in names:
            raise _of_walls(study, error) from error
        raise


def _of_walls(study: Study, error: InputError) -> InputError:
    """Error about the walls, with file and line of the key that names them."""
    lines = key_lines(study.source.read_text(encoding="utf-8"))
    for key in NAMING_WALLS:
        given = study.grid[key] or ()
        if any(f"'{name}'" in str(error) for name in ([given] if isinstance(given, str) else given)):
            return InputError(f"{study.source}: line {lines['grid', key]}: [grid] '{key}': {error}")
    return error
