"""The file formats of grids in one table, for reading, writing, messages and the help of the command line.

To add a format, write its module next to the others and add a line to `FORMATS`. The table names the modules without
importing them (`.files` does, when a file of the format is first used): the help of the command line shows the table,
and should not wait for NumPy and HDF5.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "CURVED_FORMATS",
    "FORMATS",
    "MESH_MODEL_FORMAT",
    "MODEL",
    "MODEL_FORMAT",
    "POLYMESH",
    "GridFormat",
    "curved_names",
    "format_of_content",
    "format_of_name",
    "read_names",
    "written_names",
]

POLYMESH = "polyMesh"
"""Name of the folder that OpenFOAM expects in ``constant`` of a case."""

MODEL, MODEL_FORMAT = ".h5", "bspline_mdao fitted model"
"""Suffix of fitted models, and the attribute ``format`` of their HDF5 files."""

MESH_MODEL_FORMAT = "bspline_mdao mesh"
"""The same attribute for models of unstructured meshes."""

COMPRESSED = (".gz", ".bz2", ".xz")
"""Suffixes that may follow the suffix of a compressible format."""


@dataclass(frozen=True)
class GridFormat:
    """A file format of grids."""

    name: str  # its name in messages: the format, or its program
    module: str  # its module in this folder
    writer: str  # function of the module that writes a path and a grid
    reader: str = ""  # function of the module that reads a path
    opener: str = ""  # function of the module that opens a path, to read blocks of it later
    suffixes: tuple[str, ...] = ()  # suffixes of its files; ``""`` for names without one
    listed: tuple[str, ...] = ()  # the suffixes that help names, all by default
    folder: str = ""  # name of the folder that it writes, instead of a file
    # signature of its files and its byte; files with no known signature are read by the format without
    signatures: tuple[tuple[int, bytes], ...] = ()
    takes_topology: bool = False  # whether the writer takes the topology of the grid as well
    may_be_compressed: bool = False  # whether one of `COMPRESSED` may follow the suffix

    def suffix_of(self, path: Path) -> str:
        """Return the decisive suffix, in lower case: the one before `COMPRESSED` if that may follow."""
        is_compressed = self.may_be_compressed and path.suffix.lower() in COMPRESSED
        return (path.with_suffix("") if is_compressed else path).suffix.lower()

    def __str__(self) -> str:
        """Name its suffixes or its folder, and the format if they do not imply it."""
        listed = f"a folder {self.folder}" if self.folder else ", ".join(self.listed or self.suffixes)
        return listed if listed == f".{self.name.lower()}" else f"{listed} ({self.name})"


HDF5 = b"\x89HDF\r\n\x1a\n"
"""Signature of HDF5, at the beginning or after a user block of 512 bytes, 1024 bytes and so on."""

ADF = b"ADF Database Version "
"""Signature of CGNS files before HDF5, after their first four bytes, which are not text."""

FORMATS = (
    GridFormat(
        "PLOT3D",
        "plot3d",
        "write_plot3d_as_named",
        "read_plot3d",
        "open_plot3d",
        suffixes=("", ".xyz", ".x", ".p3d", ".plot3d", ".g", ".grd", ".unf", ".fmt", ".p3dfmt", ".txt"),
        listed=(".xyz", ".fmt"),
        may_be_compressed=True,
    ),
    GridFormat(
        "CGNS",
        "cgns",
        "write_cgns",
        "read_cgns",
        "open_cgns",
        suffixes=(".cgns",),
        signatures=((0, HDF5), (512, HDF5), (1024, HDF5), (2048, HDF5), (4, ADF)),
        takes_topology=True,
    ),
    GridFormat("ParaView", "fields", "write_with_quality", suffixes=(".vtm",)),
    GridFormat("Tecplot", "fields", "write_with_quality", suffixes=(".dat", ".tec"), listed=(".dat",)),
    GridFormat("OpenFOAM", "openfoam", "write_polymesh", folder=POLYMESH, takes_topology=True),
)
"""All formats, in the order of the help."""

CURVED_FORMATS = (
    GridFormat("CGNS", "cgns_elements", "write_cgns_elements", suffixes=(".cgns",)),
    GridFormat("Gmsh", "curved_gmsh", "write_msh", suffixes=(".msh",)),
)
"""Formats of curved elements."""


def format_of_content(head: bytes) -> GridFormat:
    """Return the format that reads a file, from its first 4096 bytes."""
    for item in FORMATS:
        if any(head[at : at + len(mark)] == mark for at, mark in item.signatures):
            return item
    return next(item for item in FORMATS if item.reader and not item.signatures)


def format_of_name(path: Path) -> GridFormat | None:
    """Return the format for the name of a path; None if it belongs to none."""
    for item in sorted(FORMATS, key=lambda item: not item.folder):  # the name of a folder is also a name without suffix
        if path.name == item.folder if item.folder else item.suffix_of(path) in item.suffixes:
            return item
    return None


def read_names() -> str:
    """Name the formats that are read, such as ``PLOT3D or CGNS``."""
    *names, last = (item.name for item in FORMATS if item.reader)
    return f"{', '.join(names)} or {last}" if names else last


def curved_names() -> str:
    """Name suffixes of the formats of curved elements."""
    return " or ".join(map(str, CURVED_FORMATS))


def written_names() -> str:
    """Name suffixes and folders of the formats that are written."""
    *names, last = map(str, FORMATS)
    return f"{', '.join(names)}, or {last}"
