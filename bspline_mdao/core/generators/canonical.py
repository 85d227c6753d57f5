"""The paper's examples (section IV): grids about the ONERA M6 wing and a flat plate, and target shapes for the M6.

Theory: ``docs/theory/generators.rst``.

References
----------
V. Schmitt and F. Charpin, "Pressure distributions on the ONERA-M6-wing at transonic Mach numbers", AGARD Advisory
Report 138, 1979, report B1: section (the symmetric ONERA D, given by its upper half) and planform.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from ...grids.topology.grid import Grid
from .hh_wing import hh_wing_grid
from .wing import Planform, Section, Wing, flat_section, naca_section
from .wing_spacing import FarField, Spacing

ONERA_D_UPPER = np.array(
    [
        (0.0000000, 0.0000000), (0.0000165, 0.0006914), (0.0000696, 0.0014416), (0.0001675, 0.0022554),
        (0.0003232, 0.0031382), (0.0005508, 0.0040959), (0.0008657, 0.0051343), (0.0012868, 0.0062598),
        (0.0018364, 0.0074784), (0.0025441, 0.0087958), (0.0034428, 0.0102163), (0.0045704, 0.0117419),
        (0.0059751, 0.0133708), (0.0077112, 0.0150951), (0.0098413, 0.0168984), (0.0124479, 0.0187537),
        (0.0156171, 0.0206220), (0.0194609, 0.0224545), (0.0241067, 0.0242004), (0.0297008, 0.0258245),
        (0.0364261, 0.0273317), (0.0444852, 0.0287912), (0.0541248, 0.0303278), (0.0656303, 0.0320138),
        (0.0793366, 0.0338372), (0.0956354, 0.0357742), (0.1149796, 0.0377923), (0.1378963, 0.0398522),
        (0.1649976, 0.0419089), (0.1919327, 0.0436214), (0.2187096, 0.0450507), (0.2453310, 0.0462358),
        (0.2717978, 0.0471987), (0.2981113, 0.0479494), (0.3242726, 0.0484902), (0.3502830, 0.0488183),
        (0.3761446, 0.0489296), (0.4018567, 0.0488202), (0.4274223, 0.0484833), (0.4528441, 0.0479351),
        (0.4781197, 0.0471661), (0.5032514, 0.0461903), (0.5282426, 0.0450209), (0.5530937, 0.0436741),
        (0.5778043, 0.0421684), (0.6023757, 0.0405241), (0.6268104, 0.0387613), (0.6511093, 0.0368990),
        (0.6752726, 0.0349542), (0.6993027, 0.0329402), (0.7231995, 0.0308662), (0.7469658, 0.0287365),
        (0.7705998, 0.0265505), (0.7941055, 0.0243027), (0.8174828, 0.0219842), (0.8407324, 0.0195838),
        (0.8638564, 0.0170915), (0.8868235, 0.0145051), (0.9061905, 0.0122389), (0.9225336, 0.0102727),
        (0.9363346, 0.0085827), (0.9479946, 0.0071423), (0.9578511, 0.0059224), (0.9661860, 0.0048907),
        (0.9732361, 0.0040180), (0.9792020, 0.0032796), (0.9842508, 0.0026547), (0.9885252, 0.0021257),
        (0.9921438, 0.0016778), (0.9952080, 0.0012985), (0.9978030, 0.0009773), (1.0000000, 0.0007052),
    ]
)  # fmt: skip
"""Upper half of the section, shape (72, 2), from the leading edge; half the trailing edge is 0.0007052 thick."""

_NOSE_RADIUS = 0.0145
"""Nose radius of the section in chords: z^2 / 2 x of the first published points."""


def onera_m6_grid(
    shape: Sequence[int] = (45, 65, 33), spacing: Spacing | None = None, far_field: FarField | None = None
) -> Grid:
    """Make the H-H grid of section IV.A about the ONERA M6 wing of unit root chord.

    Parameters
    ----------
    shape : tuple
        Nodes per block along the stream, away from the wing and along the span; see `hh_wing_grid`.
    spacing : Spacing, optional
        By default the paper's (0.001 off the wall, at the leading edge, the trailing edge and the tip), wider in
        proportion on coarser grids.
    far_field : FarField, optional
        Outer boundary, 10 root chords away by default.

    Returns
    -------
    Grid
        Twelve blocks.

    Examples
    --------
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> onera_m6_grid((5, 5, 5))
    Grid(H-H wing grid: 12 blocks, 1,500 nodes, 4 patches)
    """
    return hh_wing_grid(_onera_m6(), shape, spacing, far_field)


@cache
def _onera_m6() -> Wing:
    """The wing of the paper, cached with the arc lengths of its sections."""
    return Wing(onera_m6_planform(), onera_d_section())


def flat_plate_grid(
    shape: Sequence[int] = (45, 45, 45), spacing: Spacing | None = None, far_field: FarField | None = None
) -> Grid:
    """Make the H-H grid of section IV.B about a flat plate of unit chord and semi-span 2.

    Parameters
    ----------
    shape : tuple
        Nodes per block along the stream, away from the wing and along the span; see `hh_wing_grid`.
    spacing : Spacing, optional
        By default the paper's (0.001 off the wall, 0.005 at the leading edge, the trailing edge and the tip), wider in
        proportion on coarser grids.
    far_field : FarField, optional
        Outer boundary, 10 chords away by default.

    Returns
    -------
    Grid
        Twelve blocks. The two sides of the plate coincide and are declared as walls.

    Examples
    --------
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> flat_plate_grid((5, 5, 5))
    Grid(H-H wing grid: 12 blocks, 1,500 nodes, 4 patches)
    """
    wing = Wing(Planform(root_chord=1.0, semi_span=2.0), flat_section())
    paper = Spacing(off_wall=1e-3, leading=5e-3, trailing=5e-3, tip=5e-3)
    return hh_wing_grid(wing, shape, spacing or paper.coarsened(shape, (45, 45, 45)), far_field)


def rectangular_wing() -> Wing:
    """Make the wing that the ONERA M6 becomes in section IV.A, in root chords of the M6.

    Returns
    -------
    Wing
        Rectangular, with NACA 0012 sections and chord 0.49664, the leading edge at x = 0. The span is the M6's, which
        makes the semi-span 2.989 chords: the move changes sweep, scale and section.

    Examples
    --------
    >>> from bspline_mdao.generators import rectangular_wing
    >>> rectangular_wing().planform
    Planform(root_chord=0.4966, semi_span=1.484, taper=1, leading_edge_sweep=0)
    """
    return Wing(Planform(root_chord=0.49664, semi_span=onera_m6_planform().semi_span), naca_section(0.12))


def onera_d_section() -> Section:
    """Make the ONERA D section with its trailing edge closed.

    Returns
    -------
    Section
        The published half-thickness less ``0.0007052 x``. The wedge closes the blunt trailing edge to a point without
        changing the nose, and moves no point of the section by more than 0.07 % of the chord.

    Examples
    --------
    >>> from bspline_mdao.generators import onera_d_section
    >>> round(float(onera_d_section().thickness), 3)
    0.097
    """
    x, y = ONERA_D_UPPER.T
    return Section.symmetric(np.column_stack([x, y - y[-1] * x]), nose_radius=_NOSE_RADIUS)


def onera_m6_planform() -> Planform:
    """Make the planform with unit root chord.

    Returns
    -------
    Planform
        Leading-edge sweep 30 deg, taper 0.562, semi-span 1.1963 m / 0.8059 m = 1.4843. The trailing-edge sweep
        follows as 15.76 deg (published: 15.8) and the aspect ratio as 3.80.

    Examples
    --------
    >>> from bspline_mdao.generators import onera_m6_planform
    >>> planform = onera_m6_planform()
    >>> round(planform.semi_span, 3), round(planform.aspect_ratio, 2)
    (1.484, 3.8)
    """
    return Planform(root_chord=1.0, semi_span=1.4843, taper=0.562, leading_edge_sweep=30.0)
