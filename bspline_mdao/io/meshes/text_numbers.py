"""Numbers in text: found, and replaced in their places, so that all else stays as it is to the last byte."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import InputError

__all__ = ["TextPoints", "integers_by_line"]

_BLANKS = np.zeros(256, dtype=bool)
_BLANKS[:33] = True
_BLANKS[[ord("("), ord(")")]] = True


def _words(data: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First bytes of words, the bytes behind them, and the lines that they are in, counted from 0."""
    edges = np.diff(_BLANKS[data].astype(np.int8), prepend=1, append=1)
    starts = np.flatnonzero(edges == -1)
    return starts, np.flatnonzero(edges == 1), np.searchsorted(np.flatnonzero(data == ord("\n")), starts)


def integers_by_line(text: bytes, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Whole numbers of a text, and the first of every line that has some.

    Parameters
    ----------
    text : bytes
        Lines of whole numbers.
    what : str
        Where they are, for messages.

    Returns
    -------
    numbers : ndarray of int, shape (n,)
    starts : ndarray of int, shape (n_lines + 1,)
        First number of each line.

    Raises
    ------
    InputError
        If a word is no whole number.
    """
    starts, _, lines = _words(np.frombuffer(text, dtype=np.uint8))
    try:
        numbers = np.array(text.split(), dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{what}: is no list of whole numbers ({error}); write the file again") from error
    firsts = np.flatnonzero(np.diff(lines, prepend=-1))
    return numbers, np.append(firsts, len(starts))


@dataclass(frozen=True, eq=False)
class TextPoints:
    """Points whose coordinates are the first words of lines of a text.

    Parameters
    ----------
    text : bytes
        The whole text.
    spans : ndarray of int, shape (n, n_axes, 2)
        First byte of each coordinate and the one behind it.
    values : ndarray, shape (n, n_axes)
        The coordinates.
    """

    text: bytes
    spans: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, text: bytes, start: int, stop: int, n_axes: int, skip: int, what: str) -> TextPoints:
        """Find the points in a part of a text; empty lines and those that begin with ``%`` hold none.

        Parameters
        ----------
        text : bytes
            The whole text.
        start, stop : int
            First byte of the part, and the one behind it.
        n_axes : int
            Coordinates of a point.
        skip : int
            Words of each line before them.
        what : str
            What it is, for messages.

        Raises
        ------
        InputError
            If a line has too few words, or they are no numbers.
        """
        data = np.frombuffer(text, dtype=np.uint8)[start:stop]
        starts, ends, lines = _words(data)
        firsts = np.flatnonzero(np.diff(lines, prepend=-1))
        counts = np.diff(np.append(firsts, len(starts)))
        is_point = data[starts[firsts]] != ord("%")
        firsts, counts = firsts[is_point], counts[is_point]
        if (counts < skip + n_axes).any():
            raise InputError(f"{what}: node {int(np.argmax(counts < skip + n_axes)) + 1} has too few coordinates")
        ids = firsts[:, None] + skip + np.arange(n_axes)
        return cls._at(text, start + np.stack([starts[ids], ends[ids]], axis=-1), what)

    @classmethod
    def of_words(cls, text: bytes, start: int, stop: int, n_axes: int, what: str) -> TextPoints:
        """Find points in a part of a text whose words are nothing but their coordinates, on whatever lines."""
        starts, ends, _ = _words(np.frombuffer(text, dtype=np.uint8)[start:stop])
        if len(starts) % n_axes:
            raise InputError(f"{what}: {len(starts):,} coordinates are not {n_axes} of each node; write it again")
        return cls._at(text, start + np.stack([starts, ends], axis=-1).reshape(-1, n_axes, 2), what)

    @classmethod
    def _at(cls, text: bytes, spans: np.ndarray, what: str) -> TextPoints:
        try:
            values = np.array([text[a:b] for a, b in spans.reshape(-1, 2).tolist()]).astype(float)
        except ValueError as error:
            raise InputError(f"{what}: a coordinate is no number ({error}); write the file again") from error
        return cls(text, spans, values.reshape(spans.shape[:2]))

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the text with other coordinates, shape (n, n_axes): the words of points that stay are kept."""
        is_new = (values != self.values).any(axis=1)
        words = [repr(x).encode() for x in values[is_new].ravel().tolist()]
        spans, view = self.spans[is_new].reshape(-1, 2), memoryview(self.text)
        kept = zip([0, *spans[:, 1].tolist()], [*spans[:, 0].tolist(), len(self.text)])
        pieces: list[bytes | memoryview] = [b""] * (2 * len(words) + 1)
        pieces[::2], pieces[1::2] = [view[a:b] for a, b in kept], words
        return b"".join(pieces)
