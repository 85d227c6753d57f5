"""Pictures of a grid of blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.model.model import Model
from ...errors import InputError
from ...flow.om.snapshots import Snapshot
from ...grids.topology.grid import Grid
from ...grids.topology.index_space import Window
from .field_styles import FIELD_STYLES, FieldStyle
from .surfaces import AnySheet, Sheet, control_sheets, flow_sheets, grid_sheets, worst_cells
from .view import View, view_of

__all__ = ["BlockView"]


class BlockView(View):
    """A grid of blocks, its control mesh, and a flow about it."""

    styles = FIELD_STYLES

    def __init__(self, state: Snapshot):
        super().__init__(state)
        self.model = state.model if isinstance(state.model, Model) else None
        self.defaults = ("walls", "symmetry") if self.model is None else ("walls", "symmetry", "control mesh")

    @property
    def kinds(self) -> Mapping[str, str]:
        """Kinds of the patches."""
        return {patch.name: patch.kind for patch in self.state.grid.patches}

    @property
    def is_planar(self) -> bool:
        """Whether a block is one node deep."""
        return 1 in {n for shape in self.state.grid.shapes for n in shape}

    def knows(self, name: str) -> bool:
        """False: no other surfaces have names."""
        return False

    def sheets(self, surfaces: Sequence[str], look: FieldStyle | None) -> list[AnySheet]:
        """Boundary, control mesh, and the lattice of a flow."""
        state, model = self.state, self.model
        topology = None if model is None else model.topology
        every: list[AnySheet] = []
        if look is not None and look.field == "delta_Cp":
            every += [*_lattice_sheets(state), *grid_sheets(state.grid, topology=topology)]
        elif look is not None and look.is_of_flow:
            if model is None or state.pressures is None:
                raise InputError(
                    f"{state.title}: there is no flow to show; give a problem with an EulerFlow that has run, such as "
                    f"plot(problem, 'Cp')"
                )
            every += flow_sheets(model, state.grid, state.pressures, state.states, state.mach)
        else:
            every += grid_sheets(state.grid, look is not None, topology)
        if "control mesh" in surfaces:
            if model is None:
                raise InputError(
                    f"{state.title}: a grid has no control mesh; fit it first: fit_grid(grid).plot('control mesh')"
                )
            every += control_sheets(model, state.control_points)
        return every

    def marks(self, look: FieldStyle | None, most: int) -> np.ndarray:
        """Cells with the smallest corners, in pictures of the quality."""
        if look is not None and look.field in ("Q", "smallest_corner") and most:
            return worst_cells(self.state.grid, most)
        return np.zeros((0, 3))


def _lattice_sheets(state: Snapshot) -> list[Sheet]:
    """The lattice of a wing, with the pressure differences across its panels."""
    if state.lattice is None or state.panel_pressures is None:
        raise InputError(
            f"{state.title}: there is no lattice to show; give a problem with a LatticeFlow that has run, such as "
            f"plot(problem, 'delta_Cp')"
        )
    window = Window(0, (0, 0, 0), (state.lattice.shape[0] - 1, state.lattice.shape[1] - 1, 0))
    return [Sheet("lattice", "lattice", state.lattice, window, {"delta_Cp": state.panel_pressures})]


@view_of.register
def _of_grid(grid: Grid, state: Snapshot) -> BlockView:
    return BlockView(state)
