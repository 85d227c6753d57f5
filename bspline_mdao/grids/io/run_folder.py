"""The folder of a run's results: they are made in a private folder in it, and moved into place when the run ends.

A list in the folder, `MANIFEST`, has the digests of the files that runs wrote: only unchanged files are ever replaced
or removed. The private folder of a killed run stays, with its files, until the results of another run are moved into
place.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...errors import InputError
from .disk import files_in, put_files, replaced_file
from .locked_folder import is_left_behind, locked_folder

__all__ = ["MANIFEST", "PREFIX", "RESULTS", "RunFolder", "about_run", "digest_of"]

MANIFEST = ".bspline_mdao-run.json"
"""List of the files that runs wrote, and the settings of the last one."""

PREFIX = ".bspline_mdao-run-"
"""Beginning of the names of private folders."""

RESULTS = "results"
"""Folder in a private one to which the run writes."""

_PIECE = 2**20


class RunFolder:
    """A folder for the results of a run."""

    def __init__(
        self,
        path: str | os.PathLike,  # the folder, which need not exist
    ):
        self.path = Path(path)
        self._private: Path | None = None
        self._lock: int | None = None
        self._made: list[Path] = []

    @property
    def is_empty(self) -> bool:
        """Whether it is empty, or does not exist."""
        return not self.path.is_dir() or not any(self.path.iterdir())

    @property
    def names(self) -> list[str]:
        """Names of the files that the last run wrote."""
        return sorted(_files_of(self.path))

    def left_behind(self, is_certain: bool = False) -> list[Path]:
        """Private folders of killed runs, as far as known or for certain."""
        return [folder for folder in self.path.glob(f"{PREFIX}*") if is_left_behind(folder, is_certain)]

    def check(
        self,
        wanted: Iterable[str],  # files, and folders of files, that a run is going to write
    ) -> None:
        """Refuse the folder if a run is using it, or if files would be replaced that no run wrote."""
        if set(self.path.glob(f"{PREFIX}*")) - set(self.left_behind()):
            raise InputError(f"{self.path}: another run is at work in it; wait for its end, or name another folder")
        known = _files_of(self.path)
        places = [self.path / name for name in wanted]
        files = [file for place in places for file in ([place] if place.is_file() else _files_below(place))]
        names = {file.relative_to(self.path).as_posix(): file for file in files}
        foreign = [name for name, file in names.items() if not _is_one_of(file, known.get(name, []))]
        if foreign:
            raise InputError(
                f"{self.path}: {', '.join(foreign)} would be replaced, and no run wrote it, or it was changed since; "
                f"move away what you want to keep, or name another folder"
            )

    def begin(
        self,
        about: Mapping[str, Any],  # settings of the run, for JSON: `about_run` returns them
    ) -> Path:  # the folder in it to write to, locked until the run ends
        """Create the private folder of a run."""
        self._made = [place for place in (self.path, *self.path.parents) if not place.exists()]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._private, self._lock = locked_folder(Path(os.path.realpath(self.path)), PREFIX)
            _write_manifest(self._private, {}, about)
            (self._private / RESULTS).mkdir()
        except BaseException:
            self.discard()
            raise
        return self._private / RESULTS

    def keep(self) -> None:
        """Move the run's files into place; remove files of other runs, and folders of killed ones."""
        assert self._private is not None
        made, about = self._private / RESULTS, about_run(self._private)
        old, new = _files_of(self.path), {file.as_posix(): [digest_of(made / file)] for file in files_in(made)}
        _write_manifest(self.path, {name: [*old.get(name, []), *new.get(name, [])] for name in {**old, **new}}, about)
        put_files(made, self.path)
        for name, digests in old.items():
            if name not in new and _is_one_of(self.path / name, digests):
                (self.path / name).unlink()
                with suppress(OSError):  # other files may be in it
                    (self.path / name).parent.rmdir()
        _write_manifest(self.path, new, about)
        for folder in self.left_behind(is_certain=True):
            shutil.rmtree(folder, ignore_errors=True)
        self._end()

    def discard(self) -> None:
        """Remove what the run wrote; the folder stays unchanged."""
        self._end()
        with suppress(OSError):  # others may have put something there
            for place in self._made:
                place.rmdir()

    def _end(self) -> None:
        """Release the private folder."""
        if self._lock is not None:
            os.close(self._lock)
        if self._private is not None:
            shutil.rmtree(self._private, ignore_errors=True)
        self._private = self._lock = None


def about_run(folder: Path) -> dict[str, Any]:
    """Settings of the last run in a folder, or of a private folder; empty if unknown."""
    return _read_manifest(folder).get("about", {})


def _files_of(folder: Path) -> dict[str, list[str]]:
    """Digests of files that runs wrote, by name; several while results are moved into place."""
    return _read_manifest(folder).get("files", {})


def _read_manifest(folder: Path) -> dict[str, Any]:
    """The list of a folder; empty if there is no readable one, so that no file is attributed to a run."""
    try:
        found = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and isinstance(found.get("files"), dict) else {}


def _write_manifest(folder: Path, files: Mapping[str, list[str]], about: Mapping[str, Any]) -> None:
    with replaced_file(folder / MANIFEST) as part:
        part.write_text(json.dumps({"files": files, "about": about}) + "\n", encoding="utf-8")


def _files_below(folder: Path) -> list[Path]:
    return [folder / file for file in files_in(folder)] if folder.is_dir() else []


def _is_one_of(file: Path, digests: list[str]) -> bool:
    """Whether a file exists and has one of some digests."""
    return bool(digests) and file.is_file() and digest_of(file) in digests


def digest_of(file: Path) -> str:
    """Digest of the content of a file, or of the names and contents of the files in a folder."""
    found = hashlib.blake2b(digest_size=16)
    if file.is_dir():
        for name in files_in(file):
            found.update(f"{name.as_posix()} {digest_of(file / name)}\n".encode())
        return found.hexdigest()
    with open(file, "rb") as stream:
        while piece := stream.read(_PIECE):
            found.update(piece)
    return found.hexdigest()
