"""Line numbers of the keys of a TOML text, which parsers do not keep."""

from __future__ import annotations

import re
from collections import Counter

import tomlkit

__all__ = ["key_lines", "line_of"]

_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|\n|[][{}=.,]|[^][\s{}=.,"\'#]+',
    re.S,
)

Path = tuple[str, ...]


def key_lines(text: str) -> dict[Path, int]:
    r"""Find the lines of all tables and keys of TOML without errors.

    Lines are from 1, by the path of each table and key; in arrays of tables the number of the table, from 1, follows
    the name of the array. Keys within inline tables are not included.

    Examples
    --------
    >>> key_lines("[flow]\nalpha = 3.0")
    {('flow',): 1, ('flow', 'alpha'): 2}
    >>> list(key_lines("[[stations]]\nchord = 1.0"))
    [('stations',), ('stations', '1'), ('stations', '1', 'chord')]
    """
    found: dict[Path, int] = {}
    table: Path = ()
    parts: list[str] = []
    n_tables: Counter[Path] = Counter()  # of arrays, so far
    depth, is_header, is_array, is_value = 0, False, False, False
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token == "\n":
            if is_header:
                table = tuple(parts)
            if is_array:
                n_tables[table] += 1
                table = (*table, str(n_tables[table]))
                found[table] = text.count("\n", 0, match.start()) + 1
            if depth == 0:
                parts, is_header, is_array, is_value = [], False, False, False
        elif is_value:
            depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(token, 0)
        elif token == "[" and not parts:
            is_header, is_array = True, is_header
        elif token == "=":
            is_value = True
        elif token not in ("]", ".") and not token.startswith("#"):
            parts.append(_key(token))
            path = tuple(parts) if is_header else (*table, *parts)
            found.setdefault(path, text.count("\n", 0, match.start()) + 1)
    return found


def _key(token: str) -> str:
    """Key as the parser returns it, without quotes and escapes."""
    return next(iter(tomlkit.parse(f"{token} = 0").unwrap())) if token[0] in "\"'" else token


def line_of(lines: dict[Path, int], path: Path) -> int | None:
    """Return the line of a key, or else of its table; None for the file as a whole."""
    while path and path not in lines:
        path = path[:-1]
    return lines.get(path)
