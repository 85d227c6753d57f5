"""OpenAeroStruct's beam of tubes as the structure of MPhys.

Theory: ``docs/theory/aerostructure.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import openmdao.api as om
from mphys import Builder

from ....base.checks import as_finite_points
from ....core.om.model_option import Copied
from ....core.om.mphys.conventions import COORDINATES, COUPLING, INPUT, RESULT, U_STRUCT, X_STRUCT, names_of
from ....core.om.mphys.renamed import Renamed, Renaming
from ....errors import InputError
from ...loads.rigid_links import N_DOF
from ..aerostructure import Spar
from ..vortex_lattice import lattice_surface, openaerostruct

__all__ = ["Beam", "BeamBuilder"]


class BeamBuilder(Builder):
    """A beam of tubes as the structural solver of aerostructural scenarios, by OpenAeroStruct.

    Parameters
    ----------
    nodes : ndarray, shape (n_nodes, 3)
        Nodes on the baseline (m), from the tip to the root, where the beam is clamped.
    spar : Spar
        Material, and thickness of the wall.
    radius : sequence of float
        Outer radius at the control points of a B-spline, from the tip to the root (m).
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.

    Raises
    ------
    InputError
        If there are fewer than two nodes, or two neighbours coincide.

    Examples
    --------
    >>> import numpy as np
    >>> import openmdao.api as om
    >>> from bspline_mdao.mphys import BeamBuilder
    >>> from bspline_mdao.flow.om.aerostructure import Spar
    >>> builder = BeamBuilder(np.array([[0.3, 0.0, 1.0], [0.3, 0.0, 0.0]]), Spar((0.004,)), radius=(0.04,))
    >>> builder.get_number_of_nodes(), builder.get_ndof()
    (2, 6)
    """

    def __init__(self, nodes: np.ndarray, spar: Spar, radius: Sequence[float], generation: int | None = None):
        self._nodes, self._generation = as_finite_points(nodes, len(nodes), "nodes of the beam"), generation
        self._options = {"nodes": self._nodes, "spar": spar, "radius": tuple(radius), "generation": generation}
        _distances_from_root(self._nodes)

    def get_mesh_coordinate_subsystem(self, scenario_name: str | None = None) -> om.IndepVarComp:
        """Make the component that provides the nodes of the baseline, ``x_struct0_mesh`` (``x_struct0``)."""
        mesh = om.IndepVarComp()
        name = names_of(self._generation, type(self).__name__).struct_mesh
        mesh.add_output(name, val=self._nodes.ravel(), tags=COORDINATES)
        return mesh

    def get_coupling_group_subsystem(self, scenario_name: str | None = None) -> Beam:
        """Make the group that solves for the displacements."""
        return Beam(**self._options)

    def get_number_of_nodes(self) -> int:
        """Count the nodes."""
        return len(self._nodes)

    def get_ndof(self) -> int:
        """Count the displacements and rotations of a node."""
        return N_DOF


class Beam(Copied, om.Group):
    """Displacements, mass and stress of a beam of tubes under loads on its nodes; linear, by OpenAeroStruct.

    ===================  ======  ===============  =====  ===============================================================
    name                 role    shape            units  meaning
    ===================  ======  ===============  =====  ===============================================================
    ``x_struct0``        input   (3 n_nodes)             nodes (m), from the tip to the root, where it is clamped
    ``f_aero_struct``    input   (6 n_nodes)             forces (N) and moments (N m); ``f_struct`` in MPhys 1.x
    ``spar_thickness``   input   (n_control)      m      of the wall, see `Spar`
    ``u_struct``         output  (6 n_nodes)             displacements (m) and rotations (rad)
    ``structural_mass``  output  (1,)             kg     of both halves of the wing
    ``wall_thickness``   output  (n_nodes - 1)    m      of every element
    ``failure``          output  (1,)                    largest stress relative to the allowable one, less 1, by a KS
                                                         function
    ===================  ======  ===============  =====  ===============================================================

    Options
    -------
    nodes : ndarray, shape (n_nodes, 3)
        Nodes on the baseline (m): their distances along the beam parametrize the splines.
    spar : Spar
        Material, and thickness of the wall.
    radius : tuple of float
        Outer radius at the control points of a B-spline, from the tip to the root (m).
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.

    Raises
    ------
    InputError
        In ``setup``, if OpenAeroStruct is not installed.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("nodes", types=np.ndarray, recordable=False, desc="nodes on the baseline")
        self.options.declare("spar", types=Spar, recordable=False, desc="material, and thickness of the wall")
        self.options.declare("radius", types=tuple, recordable=False, desc="outer radius, m")
        self.options.declare("generation", default=None, desc="MPhys whose names are used")

    def setup(self) -> None:
        """Put OpenAeroStruct's groups between two components that translate names."""
        nodes, spar, n = self.options["nodes"], self.options["spar"], len(self.options["nodes"])
        loads = names_of(self.options["generation"], self.msginfo).struct_loads
        surface = lattice_surface(2, n, **spar.settings, radius_cp=np.array(self.options["radius"]))
        surface["mesh"][..., 1] = -_distances_from_root(nodes)
        thickness, metres, parts = surface["thickness_cp"], {"units": "m"}, om.Group()
        given = [
            Renaming(X_STRUCT, "nodes", {"val": nodes.ravel(), "tags": COORDINATES}, {"val": nodes, **metres}),
            Renaming(loads, "loads", {"shape": N_DOF * n, "tags": COUPLING}, {"shape": (n, N_DOF), "units": "N"}),
            Renaming(SPAR, "thickness_cp", {"val": thickness, **metres, "tags": INPUT}, {"val": thickness, **metres}),
        ]
        found = [
            Renaming("disp", U_STRUCT, {"shape": (n, N_DOF), **metres}, {"val": np.zeros(N_DOF * n), "tags": COUPLING}),
            Renaming("thickness", WALL, {"shape": (1, n - 1), **metres}, {"shape": n - 1, **metres, "tags": RESULT}),
            Renaming("mass_of_beam", "structural_mass", {"units": "kg"}, {"units": "kg", "tags": RESULT}),
            Renaming("failure_of_beam", "failure", {}, {"tags": RESULT}),
        ]
        for name, module, kind in _PARTS:
            parts.add_subsystem(name, getattr(openaerostruct(module), kind)(surface=surface), promotes=["*"])
        self.add_subsystem("given", Renamed(pairs=given), promotes_inputs=["*"])
        self.add_subsystem("parts", parts)
        self.add_subsystem("found", Renamed(pairs=found), promotes_outputs=["*"])
        for pair in given:
            self.connect(f"given.{pair.target}", f"parts.{pair.target}")
        for name, pair in zip(("disp", "thickness", "structural_mass", "failure"), found):
            self.connect(f"parts.{name}", f"found.{pair.source}")


SPAR, WALL = "spar_thickness", "wall_thickness"
"""Thickness of the wall at the control points of a spline and at every element."""

_PARTS = (
    ("tube", "structures.tube_group", "TubeGroup"),
    ("stiffness", "structures.assemble_k_group", "AssembleKGroup"),
    ("mass", "structures.weight", "Weight"),
    ("states", "structures.spatial_beam_states", "SpatialBeamStates"),
    ("stress", "structures.spatial_beam_functionals", "SpatialBeamFunctionals"),
)
"""Names of OpenAeroStruct's parts here, their modules and classes, in the order in which they run."""


def _distances_from_root(nodes: np.ndarray) -> np.ndarray:
    """Lengths of the beam between each node and the last one, relative to its whole length."""
    lengths = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    if not len(lengths) or not lengths.all():
        raise InputError("beam: give two nodes at least, from the tip to the root, and none at the place of another")
    return np.append(np.cumsum(lengths[::-1])[::-1], 0.0) / lengths.sum()
