"""Fortran unformatted records: payloads between two length markers.

A record longer than 2,147,483,639 bytes is cut into subrecords by gfortran and ifort: the leading marker is negative
where another subrecord follows, the trailing one where another came before.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

__all__ = ["join_records", "split_records"]

MAX_SUBRECORD = 2_147_483_639
"""Longest payload between two 4-byte markers, in bytes."""


def split_records(data: bytes, byte_order: str, marker_bytes: int) -> tuple[bytes, list[int]] | None:
    """Take the records of a file apart.

    Parameters
    ----------
    data : bytes
        The whole file.
    byte_order : str
        ``"<"`` or ``">"``.
    marker_bytes : int
        Length of a marker, 4 or 8.

    Returns
    -------
    payload : bytes
        The payloads of all records, joined.
    lengths : list of int
        Length of every record's payload, in bytes.
        None is returned in place of both where the markers do not match up to the end of the file.
    """
    view, lengths, pieces = memoryview(data), [], []
    start, continues = 0, False
    while start < len(data):
        piece = _subrecord(view, start, byte_order, marker_bytes)
        if piece is None or (piece[2] != continues):
            return None
        payload, is_cut, _ = piece
        pieces.append(payload)
        if continues:
            lengths[-1] += len(payload)
        else:
            lengths.append(len(payload))
        start += len(payload) + 2 * marker_bytes
        continues = is_cut
    return None if continues or not lengths else (b"".join(pieces), lengths)


def _subrecord(view: memoryview, start: int, byte_order: str, marker_bytes: int):
    """Payload at ``start``, whether another follows, and whether one came before; None where it is no record."""
    lead = _marker(view, start, byte_order, marker_bytes)
    if lead is None or lead == 0 or abs(lead) > len(view):
        return None
    stop = start + marker_bytes + abs(lead)
    trail = _marker(view, stop, byte_order, marker_bytes)
    if trail is None or abs(trail) != abs(lead):
        return None
    return view[start + marker_bytes : stop], lead < 0, trail < 0


def _marker(view: memoryview, start: int, byte_order: str, marker_bytes: int) -> int | None:
    raw = view[start : start + marker_bytes]
    if len(raw) < marker_bytes:
        return None
    return int.from_bytes(raw, "little" if byte_order == "<" else "big", signed=True)


def join_records(payloads: Iterable[bytes], byte_order: str, marker_bytes: int) -> Iterator[bytes]:
    """Put markers around payloads; the inverse of `split_records`.

    Parameters
    ----------
    payloads : iterable of bytes
        Payload of every record.
    byte_order : str
        ``"<"`` or ``">"``.
    marker_bytes : int
        Length of a marker, 4 or 8.

    Yields
    ------
    bytes
        Pieces of the file, in order.
    """
    limit = MAX_SUBRECORD if marker_bytes == 4 else np.iinfo(np.int64).max
    dtype = np.dtype(f"{byte_order}i{marker_bytes}")
    for payload in payloads:
        for start in range(0, max(len(payload), 1), limit):
            piece = payload[start : start + limit]
            is_cut, continues = start + limit < len(payload), start > 0
            yield np.array(-len(piece) if is_cut else len(piece), dtype).tobytes()
            yield piece
            yield np.array(-len(piece) if continues else len(piece), dtype).tobytes()
