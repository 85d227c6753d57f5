"""Numbers in text: found, and replaced in place, so that all else stays the same to the last byte."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ....base.text import reason_of
from ....errors import InputError

__all__ = ["TextPoints", "blanked", "integers", "integers_by_line", "words_of"]

LONGEST = 100
"""Largest number of characters of a coordinate: four times as many as distinguish 8-byte reals."""

PIECE = 1 << 22
"""Bytes of text that are split at once: words are objects of about 50 bytes, 4 gigabytes for 10 million cells."""

_BLANKS = np.zeros(256, dtype=bool)
_BLANKS[list(b" \t\n\v\f\r()")] = True

_OUTSIDE = np.int8(1)  # typed like the array to which it is prepended: otherwise all would take eight bytes


def words_of(text: bytes, what: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First bytes of words, between blanks and brackets, the bytes after them, and their lines, counted from 0."""
    if b"\0" in text:  # at the end of a word, NumPy drops it
        raise InputError(f"{what}: has a byte that is zero, and is no text; write the file again")
    data = np.frombuffer(text, dtype=np.uint8)
    edges = np.diff(_BLANKS[data].view(np.int8), prepend=_OUTSIDE, append=_OUTSIDE)
    starts = np.flatnonzero(edges == -1)
    return starts, np.flatnonzero(edges == 1), np.searchsorted(np.flatnonzero(data == ord("\n")), starts)


def blanked(text: bytes, comments: re.Pattern[bytes]) -> bytes:
    """Replace comments by blanks, so that all else stays in place; line ends are kept."""
    return comments.sub(lambda found: re.sub(rb"[^\n]", b" ", found[0]), text)


def integers(text: bytes, n: int, what: str) -> np.ndarray:
    """The ``n`` whole numbers of a text."""
    try:
        parts = [np.array(text[a:b].split(), dtype=np.int64) for a, b in _pieces(text)]
    except (ValueError, OverflowError) as error:
        raise InputError(f"{what}: is no list of whole numbers ({reason_of(error)}); write the file again") from error
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *parts])
    if len(numbers) != n:
        raise InputError(f"{what}: announces {n:,} whole numbers and holds {len(numbers):,}; write the file again")
    return numbers


def integers_by_line(
    text: bytes,  # lines of whole numbers
    what: str,  # description for messages
) -> tuple[np.ndarray, np.ndarray]:  # numbers: (n,) of int; starts: (n_lines + 1,) of int, first number of each line
    """Whole numbers of a text, and the first of every non-empty line."""
    numbers, firsts, n = [np.zeros(0, dtype=np.int64)], [], 0
    for begin, end in _pieces(text, at_lines=True):
        starts, _, lines = words_of(text[begin:end], what)
        numbers.append(integers(text[begin:end], len(starts), what))
        firsts.append(n + np.flatnonzero(np.diff(lines, prepend=-1)))
        n += len(starts)
    return np.concatenate(numbers), np.concatenate([*firsts, [n]]).astype(np.int64)


def _pieces(text: bytes, at_lines: bool = False) -> Iterator[tuple[int, int]]:
    """Consecutive parts of a text, none of which ends within a word or, if requested, within a line."""
    begin = 0
    while begin < len(text):
        end = text.find(b"\n", begin + PIECE) + 1 or len(text)
        if not at_lines and end - begin > 2 * PIECE:  # lists of OpenFOAM may be one line
            end = text.find(b" ", begin + PIECE) + 1 or end
        yield begin, end
        begin = end


@dataclass(frozen=True, eq=False)
class TextPoints:
    """Points whose coordinates are the first words of lines of a text."""

    text: bytes  # the whole text
    spans: np.ndarray  # (n, n_axes, 2) of int, first byte of each coordinate and the one after it
    values: np.ndarray  # (n, n_axes), the coordinates

    @classmethod
    def of(
        cls,
        text: bytes,  # the whole text
        span: tuple[int, int],  # first byte of the part, and the one after it
        n_axes: int,  # coordinates of a point
        what: str,  # description for messages
        before: int = 0,  # before, behind: words of each line before and after them
        behind: int = 0,
        comments: re.Pattern[bytes] | None = None,  # pattern of comments, which contain no words
    ) -> TextPoints:
        """Find the points in a part of a text; empty lines contain none."""
        part = text[slice(*span)] if comments is None else blanked(text[slice(*span)], comments)
        starts, ends, lines = words_of(part, what)
        firsts = np.flatnonzero(np.diff(lines, prepend=-1))
        counts, n_words = np.diff(np.append(firsts, len(starts))), before + n_axes + behind
        is_wrong = counts != n_words
        if is_wrong.any():
            node = int(np.argmax(is_wrong))
            few = "few" if counts[node] < n_words else "many"
            raise InputError(
                f"{what}: node {node + 1} has too {few} coordinates: {counts[node]} words in its line, instead of "
                f"{n_words}; write it again"
            )
        ids = firsts[:, None] + before + np.arange(n_axes)
        return cls.at(text, span[0] + np.stack([starts[ids], ends[ids]], axis=-1), what)

    @classmethod
    def of_words(cls, text: bytes, start: int, stop: int, n_axes: int, what: str) -> TextPoints:
        """Find points in a part of a text that contains only their coordinates, on any lines."""
        starts, ends, _ = words_of(text[start:stop], what)
        if len(starts) % n_axes:
            raise InputError(f"{what}: {len(starts):,} coordinates are not {n_axes} of each node; write it again")
        return cls.at(text, start + np.stack([starts, ends], axis=-1).reshape(-1, n_axes, 2), what)

    @classmethod
    def at(cls, text: bytes, spans: np.ndarray, what: str) -> TextPoints:
        """Take points whose coordinates are at known places, shape (n, n_axes, 2)."""
        longest = int(np.diff(spans, axis=-1).max(initial=0))
        if longest > LONGEST:  # all words take as many bytes as the longest
            raise InputError(f"{what}: a coordinate of {longest:,} characters is no number; write the file again")
        flat, step = spans.reshape(-1, 2), PIECE // 4
        try:
            values = np.empty(len(flat))
            for k in range(0, len(flat), step):
                values[k : k + step] = np.array([text[a:b] for a, b in flat[k : k + step].tolist()]).astype(float)
        except ValueError as error:
            raise InputError(f"{what}: a coordinate is no number ({reason_of(error)}); write the file again") from error
        return cls(text, spans, values.reshape(spans.shape[:2]))

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the text with new coordinates, shape (n, n_axes): the words of unmoved points are kept."""
        is_new = (values != self.values).any(axis=1)
        numbers, spans, view = values[is_new].ravel(), self.spans[is_new].reshape(-1, 2), memoryview(self.text)
        parts: list[bytes | memoryview] = []
        at, step = 0, PIECE // 4
        for k in range(0, len(numbers), step):
            words, ends = [repr(x).encode() for x in numbers[k : k + step].tolist()], spans[k : k + step]
            kept = zip([at, *ends[:-1, 1].tolist()], ends[:, 0].tolist())
            pieces: list[bytes | memoryview] = [b""] * (2 * len(words))
            pieces[::2], pieces[1::2] = [view[a:b] for a, b in kept], words
            parts.append(b"".join(pieces))
            at = int(ends[-1, 1])
        return b"".join([*parts, view[at:]])
