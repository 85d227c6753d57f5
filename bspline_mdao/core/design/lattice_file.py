"""Lattices from a user's files: free-form (FFD) boxes of pyGeo and DAFoam, and boxes in SU2 mesh files.

Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...grids.io.meshes.ffd_boxes import FfdBox, read_ffd_boxes
from ...grids.io.plot3d import read_plot3d
from .lattice import Lattice
from .lattice_blocks import LatticeBlocks

__all__ = ["read_lattice"]


def read_lattice(path: str | os.PathLike, box: str | None = None, **options: Any) -> Lattice | LatticeBlocks:
    """Read a lattice from a file of free-form boxes.

    Two kinds of files are supported. A PLOT3D grid (``.xyz``, ``.fmt`` and others, text or binary) contains the points
    of one block or several, as in pyGeo and DAFoam: B-splines of order 4, or of the number of points if that is less,
    with evenly spaced knots; points shared by blocks move together. An SU2 mesh (``.su2``) contains named boxes, Bezier
    volumes or B-splines as the file says.

    Parameters
    ----------
    path : path-like
        The file.
    box : str, optional
        Name of the box (``FFD_TAG``) in an SU2 file with several.
    **options
        ``parent``, ``moves`` and ``continuity`` of `Lattice`; for a box of pyGeo's ``addChild`` the parent is the other
        box's lattice.

    Returns
    -------
    Lattice or LatticeBlocks
        Argument for `FreeForm`: one volume, or several.

    Raises
    ------
    InputError
        If the file cannot be read, has no such box, or does not form a lattice.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from bspline_mdao.design import read_lattice
    >>> box = np.moveaxis(np.indices((3, 2, 2)), 0, 3).astype(float)  # i, j and k are x, y and z
    >>> numbers = " ".join(map(str, box.transpose(3, 2, 1, 0).ravel()))  # i runs fastest
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "box.xyz")
    ...     _ = file.write_text(f"1 3 2 2 {numbers}")
    ...     lattice = read_lattice(file)
    >>> lattice.control_points.shape, lattice.orders
    ((3, 2, 2, 3), (3, 2, 2))
    """
    if Path(path).suffix.lower() == ".su2":
        found = _choose(read_ffd_boxes(path), box, str(path))
        return Lattice(found.control_points, found.orders, **options)
    if box is not None:
        raise InputError(f"{path}: has no names of boxes; leave out '{box}'")
    blocks = [block.nodes for block in read_plot3d(path).blocks]
    flat = next((number for number, nodes in enumerate(blocks, 1) if min(nodes.shape[:3]) < 2), None)
    if flat is not None:
        raise InputError(f"{path}: block {flat} is no volume; give two points or more in each direction")
    return Lattice(blocks[0], **options) if len(blocks) == 1 else LatticeBlocks(blocks, **options)


def _choose(boxes: tuple[FfdBox, ...], name: str | None, source: str) -> FfdBox:
    """Return the named box, or the only one."""
    names = ", ".join(box.name for box in boxes)
    if not boxes:
        raise InputError(f"{source}: has no FFD boxes; give a mesh with boxes, or a PLOT3D grid of their points")
    if name is None and len(boxes) > 1:
        raise InputError(f"{source}: has several FFD boxes, {names}; name one")
    for box in boxes:
        if name in (None, box.name):
            return box
    raise InputError(f"{source}: no FFD box is called '{name}'; there are {names}")
