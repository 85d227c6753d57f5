"""The tables of a study file, read key by key: errors name file, line and key."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from ...base.toml import parse_toml
from ...errors import InputError
from .kinds import NAMES, Key
from .names import choices, fault_of_name, shortened
from .toml_lines import key_lines, line_of

__all__ = ["Table", "Tables"]

Table = dict[str, Any]
"""Values by key; keys that were left out have their default, or None."""

AnyTables = TypeVar("AnyTables", bound="Tables")

MOST_BYTES = 2**20
"""Largest size of a file."""

MOST_TABLES = 100
"""Largest number of tables of one kind."""


class Tables:
    """The tables of a file, usually a study, with the lines of its keys."""

    @classmethod
    def read(
        cls: type[AnyTables],
        path: Path,  # the file
        what: str,  # what it should be: "a study"
        advice: str,  # what to do if it cannot be read
    ) -> AnyTables:
        """Read a file."""
        try:
            if path.stat().st_size > MOST_BYTES:
                raise InputError(f"{path}: is longer than {MOST_BYTES} bytes; is this {what}?")
            text = path.read_text(encoding="utf-8-sig")
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or error}); {advice}") from error
        except ValueError as error:
            raise InputError(f"{path}: is not text; give {what} in TOML") from error
        return cls(path, text)

    def __init__(
        self,
        path: Path,  # the file
        text: str,  # its contents
    ):
        self.path = path
        self.document = parse_toml(text, str(path))
        self.lines = key_lines(text)
        self.families: dict[str, list[str]] = {}  # patches by the name of their family

    def refuse(self, path: Sequence[str], complaint: str) -> InputError:
        """Make an error that names file, line and key."""
        line = line_of(self.lines, tuple(path))
        parts = [shortened(part) for part in path]
        what = "".join(f"[{'.'.join(parts[:-1])}] " if len(parts) > 1 else "") + (f"'{parts[-1]}' " if parts else "")
        return InputError(f"{self.path}: {f'line {line}: ' if line else ''}{what}{complaint}")

    def known(self, table: Mapping, allowed: Iterable[str], path: tuple[str, ...], what: str = "key") -> None:
        """Refuse a misspelt key."""
        for name in table:
            if name not in allowed:
                raise self.refuse((*path, name), f"is no {what}; {choices(name, allowed, f'the {what}s are')}")

    def table(self, name: str, keys: Mapping[str, Key], *sub: str) -> Table:
        """Read one table: values by key, defaults for keys that are left out."""
        path, found = (name, *sub), self.document
        for part in path:
            found = found.get(part, {})
        if not isinstance(found, Mapping):
            raise self.refuse(path, f"is no table; write [{'.'.join(path)}] and its keys below")
        return self._values(found, keys, path)

    def array(self, name: str, keys: Mapping[str, Key]) -> list[Table]:
        """Read an array of tables in the same way."""
        found = self.document.get(name, [])
        if not (isinstance(found, list) and found and all(isinstance(each, Mapping) for each in found)):
            raise self.refuse((name,), f"is no array of tables; write [[{name}]] and its keys below for each of them")
        if len(found) > MOST_TABLES:
            raise self.refuse((name,), f"has {len(found):,} tables; give {MOST_TABLES} at most")
        return [self._values(each, keys, (name, str(number))) for number, each in enumerate(found, 1)]

    def _values(self, found: Mapping, keys: Mapping[str, Key], path: tuple[str, ...]) -> Table:
        """Values of a table."""
        self.known(found, keys, path)
        for key, spec in keys.items():
            if key not in found and spec.is_required:
                raise self.refuse(path, f"has no key '{key}' ({spec.meaning}); give {spec.kind.words}")
            if key in found and not spec.kind.accepts(found[key]):
                raise self.refuse((*path, key), f"is {shortened(_said(found[key]))}; give {spec.kind.words}")
        values = {key: found.get(key, spec.default) for key, spec in keys.items()}
        return {key: self.members(value) if keys[key].kind is NAMES else value for key, value in values.items()}

    def members(self, patches: str | list[str] | None) -> str | list[str] | None:
        """Patches, with families replaced by their patches."""
        if patches is None or not self.families:
            return patches
        names = [patches] if isinstance(patches, str) else patches
        found = list(dict.fromkeys(member for name in names for member in self.families.get(name, [name])))
        return found if len(found) > 1 or isinstance(patches, list) else found[0]

    def named(self, name: str) -> list[str]:
        """Names of the tables in a table."""
        tables = self.document.get(name, {})
        if not isinstance(tables, Mapping):
            raise self.refuse((name,), f"is no table; write [{name}.NAME] for each of them")
        if len(tables) > MOST_TABLES:
            raise self.refuse((name,), f"has {len(tables):,} tables; give {MOST_TABLES} at most")
        for sub, table in tables.items():
            if not isinstance(table, Mapping):
                raise self.refuse((name, sub), f"is no table; write [{name}.{shortened(sub)}] and its keys below")
            if fault := fault_of_name(name, sub):
                raise self.refuse((name, sub), fault)
        return list(tables)

    def kind(self, name: str, sub: str, kinds: Iterable[str]) -> str:
        """Kind of a table: by its key ``kind``, or its name."""
        kind = self.document[name][sub].get("kind", sub)
        if not isinstance(kind, str) or kind not in kinds:
            path = (name, sub, "kind") if "kind" in self.document[name][sub] else (name, sub)
            said = f"is '{shortened(str(kind))}', which is no kind"
            said = said if len(path) == 3 else "is no kind, and has no key 'kind'"
            raise self.refuse(path, f"{said}; {choices(str(kind), kinds, 'the kinds are')}")
        return kind


def _said(value: Any) -> str:
    """A value in a message, without whole numbers that have more digits than Python writes."""
    try:
        return repr(value)
    except ValueError:
        return "a number of very many digits"
