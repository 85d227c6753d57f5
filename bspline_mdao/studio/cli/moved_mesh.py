"""A moved unstructured mesh in commands: cells, heights at walls, and the certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...core.evaluation.spline_validity import certify_splines
from ...grids.cells.certificate import BlockCertificate, Certificate
from ...grids.cells.mixed_bounds import certify_mixed
from ...grids.cells.mixed_cells import MixedMesh
from .moved_cells import MovedCells
from .output import certificate_numbers, print_lines, show_certificate, unproved_lines

__all__ = ["MovedMesh"]


@dataclass(frozen=True, eq=False)
class MovedMesh:
    """Cells of a mesh before and after a move, and the certificate of cells and of a Cartesian lattice."""

    mesh: MixedMesh
    cells: MovedCells
    certificate: Certificate | None

    @classmethod
    def of(
        cls,
        model: MeshModel,  # the mesh
        control_points: np.ndarray,  # (n_control_points, 3), their present places
        nodes: np.ndarray,  # (n_nodes, 3), present places of the nodes
        *,
        is_proved: bool = True,  # whether to prove which cells are valid everywhere
    ) -> MovedMesh:
        """Measure a mesh that was moved."""
        walls = model.node_map.embedded.walls
        assert walls is not None
        ratios = walls.heights(nodes) / walls.heights(model.mesh.points)
        cells = MovedCells.of(model.mesh, nodes, ratios)
        if not is_proved:
            return cls(model.mesh, cells, None)
        splines: tuple[BlockCertificate, ...] = ()
        if model.lattice.frame.is_cartesian:  # in other frames the map is not one volume
            splines = certify_splines(*model.splines_at(control_points), model.spline_names, what="lattice element")
        return cls(model.mesh, cells, Certificate(certify_mixed(model.mesh, nodes), splines))

    def numbers(self) -> dict:
        """Collect them for JSON."""
        return {**self.cells.numbers(), "certificate": self.certificate and certificate_numbers(self.certificate)}

    def show(self) -> None:
        """Print them."""
        self.cells.show()
        if self.certificate is not None:
            show_certificate(self.certificate)
            print_lines(unproved_lines(self.mesh))
        self.cells.show_heights()

    def warnings(self) -> list[str]:
        """List problems of the cells."""
        return self.cells.warnings()
