"""The mesh file of a model: moved nodes are written into a copy of it.

Its other contents and its format are preserved.
"""

from __future__ import annotations

import os

import numpy as np

from ...errors import InputError
from ...grids.io.meshes.blocks import open_blocks
from ...grids.io.meshes.files import MeshFile, check_same_format, read_mesh
from .mesh_model import MeshModel

__all__ = ["open_mesh_file"]


def open_mesh_file(model: MeshModel, output: str | os.PathLike | None = None) -> MeshFile:
    r"""Read the mesh file from which a model was made.

    Parameters
    ----------
    model : MeshModel
        The model, from `fit_mesh` or loaded.
    output : path-like, optional
        Where moved nodes will be written: a name of the same format.

    Returns
    -------
    MeshFile
        File whose ``write(path, points)`` writes it with other nodes.

    Raises
    ------
    InputError
        If the file no longer exists, or has different nodes than the model, or ``output`` implies another format.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bspline_mdao.meshes import fit_mesh, open_mesh_file
    >>> nodes = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "cell.su2")
    ...     marker = "NMARK= 1\nMARKER_TAG= wing\nMARKER_ELEMS= 1\n5 0 1 2\n"
    ...     _ = path.write_text(f"NDIME= 3\nNELEM= 1\n10 0 1 2 3\nNPOIN= 4\n{nodes}{marker}")
    ...     open_mesh_file(fit_mesh(path)).mesh.n_points
    4
    """
    origin = f"the model {model.file}" if model.file else "the model"
    if not model.mesh_file or not os.path.exists(model.mesh_file):
        raise InputError(
            f"{model.mesh_file or model.source}: is not there, and moved nodes are written into a copy of the mesh "
            f"that {origin} was made of; put it back, or fit it where it is now"
        )
    if model.mesh.numbers is not None:
        grid = open_blocks(model.mesh_file, model.mesh)
        if output is not None:
            grid.check_name(output)
        return grid
    if output is not None:
        check_same_format(model.mesh_file, output)
    file = read_mesh(model.mesh_file)
    if not np.array_equal(file.mesh.points, model.mesh.points):
        raise InputError(f"{model.mesh_file}: has changed since {origin} was made of it; fit it again")
    return file
