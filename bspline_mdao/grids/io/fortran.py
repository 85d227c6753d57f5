"""Numbers in the formats of Fortran: list-directed text, and unformatted records.

A record is a payload between two markers of its length. gfortran and ifort cut a record longer than 2,147,483,639 bytes
into subrecords: the leading marker is negative if another subrecord follows, the trailing one if another came before.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import re
import warnings
from codecs import BOM_UTF8
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import zip_longest

import numpy as np

from ...errors import InputError
from .stored_numbers import TEXT_PART, BinaryNumbers, StoredBytes, TextNumbers

_LINE_BREAKS = (b"\n", b"\r")
_BREAKS = (b" ", b"\t", *_LINE_BREAKS)
_SEPARATORS = b" \t\r\n,;\x0b\x0c"
_NUMBERS = b"0123456789+-.eEdDqQ*" + b"nNaAiIfFtTyY"
_PLAIN = bytes.maketrans(b",;DdQq*", b"  EEEE ")
_COMMENT = re.compile(rb"[#!][^\n\r]*")
_LOST_EXPONENT = re.compile(rb"([0-9.])([+-])")

_FREE_EXPANSION = 2**23
_EXPANSION_PER_BYTE = 1000
"""Repeats may give ``2**23 + 1000 len(text)`` numbers: more than a grid needs, but few enough for memory."""


def is_text(data: bytes) -> bool:
    """Whether the beginning of a file is text rather than binary numbers."""
    return not data[:1024].translate(None, bytes(range(32, 127)) + b"\t\r\n\x0b\x0c")


def parse_numbers(
    data: bytes,  # the text
    source: str,  # its name, for messages
    n_lines: int = 0,  # lines before the text, if it is a part
) -> np.ndarray:  # (n,), the numbers; NaN and infinities are kept
    """Read all numbers of a list-directed text."""
    # Blanks, line ends, commas and semicolons separate; ``3*0.5`` repeats; ``1.5D-3``, ``1.5Q-3`` and ``1.5-103`` are
    # exponents; text after ``#`` or ``!`` on a line is a comment.
    data = data.rstrip(b"\x00\x1a")
    data = _COMMENT.sub(b"", data) if _has_comments(data) else data
    if data.translate(None, _SEPARATORS + _NUMBERS):
        raise _not_a_number(data, source, n_lines)
    plain = data.translate(_PLAIN)
    if _has_lost_exponent(plain):
        plain = _LOST_EXPONENT.sub(rb"\1E\2", plain)
        data = _LOST_EXPONENT.sub(rb"\1E\2", data)
    starts = _token_starts(plain)
    values = _parse_plain(plain)
    if len(values) != len(starts):
        raise _not_a_number(data, source, n_lines)
    return _repeat(values, starts, data, source, n_lines) if b"*" in data else values


def _has_comments(data: bytes) -> bool:
    return b"#" in data or b"!" in data


def count_comments(data: bytes) -> int:
    """Count the comments of a text."""
    return len(_COMMENT.findall(data)) if _has_comments(data) else 0


def scan_text(
    data: StoredBytes,  # the text
    source: str,  # its name, for messages
) -> TextNumbers:
    """Scan a text and count the numbers in each part of it."""
    parse, start, n_lines, n_numbers, n_comments = partial(_parse_part, source), 0, 0, 0, 0
    starts, lines, ends = [0], [], []
    while start < len(data):
        part = data[start : start + TEXT_PART]
        if start + len(part) < len(data):
            breaks = _LINE_BREAKS if _has_comments(part) else _BREAKS
            length = 1 + max(map(part.rfind, breaks))  # no number and no comment is cut in two
            if not length:
                raise InputError(f"{source}: holds text that is not a list of numbers; is this an ASCII PLOT3D grid?")
            part = part[:length]
        lines.append(n_lines)
        n_numbers += len(parse(part, n_lines))
        n_comments += count_comments(part)
        n_lines += part.count(b"\n")
        start += len(part)
        starts.append(start)
        ends.append(n_numbers)
    return TextNumbers(parse, data, np.array(starts), np.array(lines), np.array(ends), n_comments)


def _parse_part(source: str, part: bytes, n_lines: int) -> np.ndarray:
    """Numbers of a part of a text."""
    return parse_numbers(part.removeprefix(BOM_UTF8) if n_lines == 0 else part, source, n_lines)


def _has_lost_exponent(plain: bytes) -> bool:
    """Whether a sign follows a digit or point, as in ``1.5-103``; ten times as fast as the regular expression."""
    characters = np.frombuffer(plain, np.uint8)
    signs = np.flatnonzero((characters[1:] == ord("-")) | (characters[1:] == ord("+")))
    before = characters[signs]
    return bool((((before >= ord("0")) & (before <= ord("9"))) | (before == ord("."))).any())


def _token_starts(plain: bytes) -> np.ndarray:
    """Positions at which a number begins."""
    is_token = np.frombuffer(plain, np.uint8) > ord(" ")
    begins = is_token.copy()
    begins[1:] &= ~is_token[:-1]
    return np.flatnonzero(begins)


def _parse_plain(plain: bytes) -> np.ndarray:
    """Numbers of a text separated by blanks; None if one cannot be read."""
    if not plain.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # raised by NumPy before 2.3 for unreadable text
        try:
            return np.fromstring(plain, dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return np.empty(0)


def _repeat(values: np.ndarray, starts: np.ndarray, data: bytes, source: str, n_lines: int) -> np.ndarray:
    """Expand repeats: ``n*value`` stands for a value n times."""
    padded = np.frombuffer(b" " + data + b" ", np.uint8)
    stars = np.flatnonzero(padded == ord("*")) - 1
    before, after = padded[stars], padded[stars + 2]
    is_whole = (
        (before >= ord("0")) & (before <= ord("9")) & (after > ord(" ")) & (after != ord("*")) & (after != ord(","))
    )
    if is_whole.all():
        counts_at = np.searchsorted(starts, stars) - 1
        values_at = counts_at + 1
        is_whole = _is_count(values[counts_at])
        is_whole[1:] &= counts_at[1:] > values_at[:-1]
    if not is_whole.all():
        line = n_lines + data.count(b"\n", 0, int(stars[np.argmin(is_whole)])) + 1
        raise InputError(f"{source}: line {line}: '*' is not a repeat like 3*0.5; write the value out")
    counts = np.ones(len(values))
    counts[values_at] = values[counts_at]
    counts[counts_at] = 0
    if counts.sum() > _FREE_EXPANSION + _EXPANSION_PER_BYTE * len(data):
        raise InputError(f"{source}: repeats give {counts.sum():.3g} numbers, which no grid of this size needs")
    return np.repeat(values, counts.astype(np.int64))


def _is_count(values: np.ndarray) -> np.ndarray:
    """Mark positive whole numbers that a real stores exactly."""
    return (values >= 1) & (values < 2**53) & (np.floor(values) == values)


def _not_a_number(data: bytes, source: str, n_lines: int) -> InputError:
    """Name the first token that Python cannot read either."""
    for number, line in enumerate(data.splitlines(), 1 + n_lines):
        for token in re.split(rb"[\s,;]+", line):
            if token and not _is_number(token):
                text = token[:24].decode("ascii", "backslashreplace")
                return InputError(f"{source}: line {number}: '{text}' is not a number; is this an ASCII PLOT3D grid?")
    return InputError(f"{source}: holds text that is not a list of numbers; is this an ASCII PLOT3D grid?")


def _is_number(token: bytes) -> bool:
    """Whether Python can read a token, with or without a repeat."""
    value = re.sub(rb"^\d+\*", b"", token).translate(_PLAIN)
    try:
        float(_LOST_EXPONENT.sub(rb"\1E\2", value))
    except ValueError:
        return False
    return b"_" not in token


def format_numbers(
    values: np.ndarray,  # (n,), integers or reals
    per_line: int = 4,  # numbers on a line; Fortran readers dislike very long lines
) -> Iterator[bytes]:  # whole lines, about a megabyte at a time
    """Write numbers as text that gives exactly the same numbers when read."""
    chunk = 2**14 * per_line
    for start in range(0, len(values), chunk):
        tokens = map(repr, values[start : start + chunk].tolist())
        lines = map(" ".join, zip_longest(*[tokens] * per_line, fillvalue=""))
        yield ("\n".join(lines).rstrip(" ") + "\n").encode("ascii")


MAX_SUBRECORD = 2_147_483_639
"""Longest payload between two 4-byte markers, in bytes."""


def split_records(
    data: bytes | StoredBytes,  # the whole file
    byte_order: str,  # ``"<"`` or ``">"``
    marker_bytes: int,  # length of a marker, 4 or 8
) -> tuple[BinaryNumbers, list[int]] | None:
    """Split a file into its records; of a file on disk only the markers are read."""
    # Returns payload: the payloads of all records, joined; lengths: length of every record's payload, in bytes. Both
    # are None if the markers do not match up to the end of the file.
    starts: list[int] = []
    sizes: list[int] = []
    lengths: list[int] = []
    start, continues = 0, False
    while start < len(data):
        piece = _subrecord(data, start, byte_order, marker_bytes)
        if piece is None or (piece[2] != continues):
            return None
        n_bytes, is_cut, _ = piece
        starts.append(start + marker_bytes)
        sizes.append(n_bytes)
        if continues:
            lengths[-1] += n_bytes
        else:
            lengths.append(n_bytes)
        start += n_bytes + 2 * marker_bytes
        continues = is_cut
    return None if continues or not lengths else (BinaryNumbers(data, np.array(starts), np.cumsum(sizes)), lengths)


def _subrecord(
    data: bytes | StoredBytes, start: int, byte_order: str, marker_bytes: int
) -> tuple[int, bool, bool] | None:
    """Bytes of the payload at ``start``, whether another follows, whether one came before; None if invalid."""
    before = _marker(data, start, byte_order, marker_bytes)
    if before is None or before == 0 or abs(before) > len(data):
        return None
    after = _marker(data, start + marker_bytes + abs(before), byte_order, marker_bytes)
    if after is None or abs(after) != abs(before):
        return None
    return abs(before), before < 0, after < 0


def _marker(data: bytes | StoredBytes, start: int, byte_order: str, marker_bytes: int) -> int | None:
    """Read a marker; None if the file ends in it."""
    raw = data[start : start + marker_bytes]
    if len(raw) < marker_bytes:
        return None
    return int.from_bytes(raw, "little" if byte_order == "<" else "big", signed=True)


def join_records(
    payloads: Iterable[bytes],  # payload of every record
    byte_order: str,  # ``"<"`` or ``">"``
    marker_bytes: int,  # length of a marker, 4 or 8
) -> Iterator[bytes]:  # pieces of the file, in order
    """Put markers around payloads; the inverse of `split_records`."""
    limit = MAX_SUBRECORD if marker_bytes == 4 else np.iinfo(np.int64).max
    dtype = np.dtype(f"{byte_order}i{marker_bytes}")
    for payload in payloads:
        for start in range(0, max(len(payload), 1), limit):
            piece = payload[start : start + limit]
            is_cut, continues = start + limit < len(payload), start > 0
            yield np.array(-len(piece) if is_cut else len(piece), dtype).tobytes()
            yield piece
            yield np.array(-len(piece) if continues else len(piece), dtype).tobytes()
