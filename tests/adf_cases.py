"""Files in ADF, made from HDF5: the reader has nothing in common with this writer."""

import struct

import h5py
import numpy as np

BLOCK, NULL = 4096, 4096
KINDS = {"i4": "I4", "i8": "I8", "f4": "R4", "f8": "R8", "i1": "C1", "u1": "B1"}


class AdfWriter:
    """Bytes of a file of version "A" or "B", with numbers in an order, "<" or ">", and data in so many pieces."""

    def __init__(self, version="A", order="<", n_pieces=1):
        self.version, self.order, self.n_pieces = version, order, n_pieces
        self.data = bytearray(266)

    def pointer(self, place: int) -> bytes:
        block, offset = divmod(place, BLOCK) if place != NULL else (0, NULL)
        return (
            f"{block:08X}{offset:04X}".encode()
            if self.version == "A"
            else struct.pack(self.order + "QI", block, offset)
        )

    def put(self, piece: bytes) -> int:
        self.data += bytes(3)  # pieces may begin anywhere
        self.data += piece
        return len(self.data) - len(piece)

    def put_data(self, raw: bytes) -> int:
        place = len(self.data) + 3
        return self.put(b"DaTa" + self.pointer(place + 16 + len(raw)) + raw + b"dEnD")

    def put_value(self, raw: bytes) -> tuple[int, int]:
        """Number of pieces, and where the data or the table of its pieces is."""
        if not raw:
            return 0, NULL
        if self.n_pieces == 1:
            return 1, self.put_data(raw)
        cuts = np.linspace(0, len(raw), self.n_pieces + 1).astype(int)
        places = [(self.put_data(raw[a:b]), b - a) for a, b in zip(cuts, cuts[1:])]
        table = b"".join(self.pointer(start) + self.pointer(start + 16 + size) for start, size in places)
        return self.n_pieces, self.put(b"DCtb" + self.pointer(len(self.data) + 3 + 16 + len(table)) + table + b"dcTE")

    def node(self, name: str, label: str, kind: str, value: np.ndarray | None, children: list[tuple[str, int]]) -> int:
        shape = () if value is None else value.shape[::-1]
        raw = b"" if value is None else value.astype(value.dtype.newbyteorder(self.order)).tobytes()
        n_pieces, data = self.put_value(raw)
        entries = b"".join(child.ljust(32).encode() + self.pointer(place) for child, place in children)
        end = self.pointer(len(self.data) + 3 + 16 + len(entries))
        table = self.put(b"SNTb" + end + entries + b"snTE") if children else NULL
        sizes = [*shape, *[0] * (12 - len(shape))]
        stored = (
            "".join(f"{n:08X}" for n in sizes).encode()
            if self.version == "A"
            else struct.pack(self.order + "12Q", *sizes)
        )
        head = name.ljust(32).encode() + label.ljust(32).encode() + f"{len(children):08X}{len(children):08X}".encode()
        tail = f"{len(shape):02X}".encode() + stored + f"{n_pieces:04X}".encode() + self.pointer(data) + b"TaiL"
        return self.put(b"NoDe" + head + self.pointer(table) + kind.ljust(32).encode() + tail)

    def tree(self, name: str, group: h5py.Group) -> int:
        children = [(n, self.tree(n, g)) for n, g in group.items() if isinstance(g, h5py.Group)]
        value = group[" data"][()] if " data" in group else None
        kind = "MT" if value is None else KINDS[value.dtype.str[1:]]
        return self.node(name, group.attrs["label"].decode(), kind, value, children)

    def finished(self, root: int) -> bytes:
        date = b"Wed Aug 31 15:40:12 2011    "
        head = b"\xc0\xa8\xa3\xa9ADF Database Version " + self.version.encode() + b"02011>AdF0" + date + b"AdF1" + date
        head += b"AdF2" + {"<": b"L", ">": b"B"}[self.order] + b"BAdF3010204080408080808080808AdF4"
        head += self.pointer(root) + 3 * self.pointer(NULL) + b"AdF5"
        self.data[: len(head)] = head
        return bytes(self.data)


def as_adf(path, **options) -> bytes:
    """The tree of a CGNS file in HDF5 as a file in ADF."""
    writer = AdfWriter(**options)
    with h5py.File(path, "r") as file:
        return writer.finished(writer.tree("ADF MotherNode", file))
