"""Intervals next to a wing, and the outer boundary of its grid.

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine

__all__ = ["FarField", "Spacing", "default_spacing"]

_ENOUGH = 45, 65, 33
"""Nodes per block along the stream, away from the wing and along the span for the paper's intervals next to the M6."""


@dataclass(frozen=True)
class Spacing(OneLine):
    """Intervals next to the wing (m).

    Parameters
    ----------
    off_wall : float
        First interval along the grid lines that leave the wing; near a blunt edge it is up to 5 % shorter.
    leading, trailing, tip : float
        Intervals on both sides of the leading edge, the trailing edge and the tip, along the surface and away from it.
    root : float, optional
        Interval along the span at the symmetry plane; twice the mean interval by default.

    Examples
    --------
    >>> from bspline_mdao.generators import Spacing, hh_wing_grid, rectangular_wing
    >>> hh_wing_grid(rectangular_wing(), (5, 5, 5), spacing=Spacing(off_wall=1e-2)).n_nodes
    1500
    >>> Spacing(off_wall=1e-2).widened(2.0).off_wall
    0.02
    """

    off_wall: float = 1e-3
    leading: float = 1e-3
    trailing: float = 1e-3
    tip: float = 1e-3
    root: float | None = None

    def widened(self, factor: float) -> Spacing:
        """Widen all intervals except the root's by a factor."""
        return self._scaled(factor, factor, factor)

    def coarsened(self, shape: Sequence[int | Sequence[int]], enough: Sequence[int]) -> Spacing:
        """Widen in proportion if a grid has fewer intervals in a direction than another one for which these are right.

        Parameters
        ----------
        shape, enough : tuple
            Nodes per block of the two grids, as in `hh_wing_grid`.

        Examples
        --------
        >>> from bspline_mdao.generators import Spacing
        >>> Spacing(leading=1e-3).coarsened((12, 65, 33), (45, 65, 33)).widened(0.5)
        Spacing(off_wall=0.0005, leading=0.002, trailing=0.002, tip=0.0005, root=None)
        """
        stream, normal, span = (max((m - 1) / max(np.min(n) - 1, 1), 1.0) for n, m in zip(shape, enough))
        return self._scaled(normal, stream, span)

    def _scaled(self, normal: float, stream: float, span: float) -> Spacing:
        leading, trailing = stream * self.leading, stream * self.trailing
        return Spacing(normal * self.off_wall, leading, trailing, span * self.tip, self.root)


@dataclass(frozen=True)
class FarField(OneLine):
    """The outer boundary and the grid there.

    Parameters
    ----------
    distance : float
        Distance from the wing to the outer boundary on all sides (m).
    spread : float
        Outward displacement, at the outer boundary, of the lines that leave the edges of the wing (m).
    relaxation : float
        Intervals at the outer boundary divided by those next to the wing. If it is not 1, the grid lines curve.

    Examples
    --------
    >>> from bspline_mdao.generators import FarField, hh_wing_grid, rectangular_wing
    >>> hh_wing_grid(rectangular_wing(), (5, 5, 5), far_field=FarField(distance=5.0)).n_nodes
    1500
    """

    distance: float = 10.0
    spread: float = 0.05
    relaxation: float = 2.0


def default_spacing(root_chord: float, shape: Sequence[int | Sequence[int]]) -> Spacing:
    """Intervals next to a wing from its root chord (m) and the nodes per block: the paper's, wider on coarser grids."""
    return Spacing().widened(root_chord).coarsened(shape, _ENOUGH)
