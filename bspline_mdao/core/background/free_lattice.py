"""The lattice around a mesh as a free-form lattice: its points are design variables.

The walls then move as the whole mesh would with these points, x = x0 + A d, and the mover moves the mesh with them.

Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

from typing import Any

from ...errors import InputError
from ..design.lattice import Lattice
from .mesh_model import MeshModel

__all__ = ["free_lattice"]


def free_lattice(model: MeshModel, **options: Any) -> Lattice:
    """Use the lattice around an unstructured mesh as a free-form lattice.

    It has the spans that move the mesh: even around the walls, and growing from there to the ends of the mesh. Points
    that affect no wall node have no values in `FreeForm`, so only points near the walls remain.
    ``model.with_settings(LatticeSettings(spacing=...))`` has a coarser lattice.

    Parameters
    ----------
    model : MeshModel
        The mesh.
    **options
        ``parent``, ``moves`` and ``continuity`` of `Lattice`.

    Returns
    -------
    Lattice

    Raises
    ------
    InputError
        If the lattice is cylindrical, so its knots are not the coordinates of a box.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.design import FreeForm
    >>> from bspline_mdao.meshes import MeshModel, MixedMesh, free_lattice
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    >>> tetrahedra, floor = np.array([[0, 1, 2, 3], [1, 4, 2, 3]]), np.array([[0, 1, 2, 2]])
    >>> model = MeshModel.of(MixedMesh(corners, {"tetra": tetrahedra}, {"floor": floor}), {"floor": "wall"})
    >>> lattice = free_lattice(model)
    >>> shape = FreeForm("shape", lattice, where=lattice.within(high=(0.5, None, None)), direction="z")
    """
    around = model.lattice
    if not around.frame.is_cartesian:
        raise InputError(
            f"{model.source}: the lattice goes around the axis of periodic sides, and is no box whose points are "
            f"variables; make one around what is to change by Lattice.box or Lattice.hexahedron"
        )
    (volume,) = around.mesh.volumes
    return Lattice(around.control_points.reshape(*around.shape, 3), knots=volume.knots, **options)
