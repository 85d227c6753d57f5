"""The model file of a case file: found by what the case file says, identified by its checksum."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ...core.model.model_file import checksum_in
from ...core.om.model_option import NamedModel

__all__ = ["ADVICE", "find_model"]

ADVICE = "give the model that was optimised, --model MODEL.h5 or write_report(..., model=...)"
"""Ways to give the model of a case file."""


def find_model(
    case_file: Path,  # the case file
    named: NamedModel | None,  # what it says of its model
) -> tuple[Path | None, str]:  # file: None if not found; reason: why not, and what to do
    """Find the model of a case file."""
    # It is searched for at its original place, and next to the case file, above it and in the working directory: by its
    # name if it had one, and among all models if it was saved after the run. The checksum must match the model that was
    # optimised.
    if named is None:
        return None, f"The case file does not name the model: {ADVICE}, to see its grid with its quality."
    others: list[Path] = []
    for file in _candidates(case_file, named):
        checksum = checksum_in(file)
        if checksum == named.checksum:
            return file, ""
        if checksum is not None:
            others.append(file)
    if not named.file:
        text = "The grid is not shown: the model was not saved before the run, and none next to the case file matches"
        return None, f"{text} it. Save it by model.save(...); {ADVICE}."
    if others:
        text = f"The grid is not shown: {others[0]} is not the model that was optimised"
        return None, f"{text}; it was written since. Put that one back, or {ADVICE}."
    return (
        None,
        f"The grid is not shown: its model {named.file} is no longer there, nor next to the case file; {ADVICE}.",
    )


def _candidates(case_file: Path, named: NamedModel) -> Iterator[Path]:
    """Files that may be the model, the most likely first."""
    if named.file:
        yield Path(named.file)
    folders = case_file.absolute().parent, case_file.absolute().parents[min(1, len(case_file.absolute().parents) - 1)]
    for folder in dict.fromkeys((*folders, Path.cwd())):
        yield from [folder / Path(named.file).name] if named.file else sorted(folder.glob("*.h5"))
