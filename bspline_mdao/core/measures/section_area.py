"""Area of a section: the volume between its symmetry planes, divided by their distance.

Theory: ``docs/theory/geometry.rst``, "Sections as one curve".
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from ...errors import InputError
from ..mesh.surface import SurfaceGrid
from .volume import EnclosedVolume

__all__ = ["SectionArea"]


@dataclass(frozen=True, eq=False)
class SectionArea(EnclosedVolume):
    """Area of a section, independent of the span; make it by `of`.

    Parameters
    ----------
    surface, quads, apexes, origin, units, name
        As for `EnclosedVolume`.
    scale : float
        Divisor of the volume: the distance between the planes (m), or the volume on the baseline.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> from bspline_mdao.measures import SectionArea, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(section_o_grid(naca_section(0.12), 64, far=20.0)))
    >>> SectionArea.of(surface).evaluate(surface.points).round(3)  # of a chord of 1 m
    array([0.082])
    """

    @classmethod
    def of(cls, surface: SurfaceGrid, relative: bool = False, name: str = "section_area") -> SectionArea:
        """Measure a section between two symmetry planes, see `SurfaceGrid.is_section`.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        relative : bool
            Whether to divide by the area of the baseline.
        name : str
            Name of the output.

        Returns
        -------
        SectionArea
            In square metres, or relative to the baseline.

        Raises
        ------
        InputError
            As `EnclosedVolume.of`; also if the surface is not a section.
        """
        span = surface.section_span
        if span is None:
            raise InputError(
                f"{name}: the surface is no section, the same from one plane of symmetry to another one; take "
                f"EnclosedVolume"
            )
        volume = EnclosedVolume.of(surface, relative, name)
        area = cls(**{each.name: getattr(volume, each.name) for each in fields(volume)})
        return area if relative else replace(area, scale=span * area.scale, units="m**2")
