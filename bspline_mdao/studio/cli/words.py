"""Texts of help and messages that are used in more than one place."""

PROGRAM = "bspline-mdao"

TRACEBACK = "BSPLINE_MDAO_TRACEBACK"
"""Environment variable for ``--verbose``."""

DEFINITIONS = """\b
Corner: triple product of the unit edges at a corner of a cell; 1 for right
  angles, 0 for a flat corner, negative for a folded one. A cell is inverted if
  its smallest corner is not positive.
Corner Jacobian: the same with the full edges (m^3).
Q: orthogonality of a cell, the product of the triple products of all its
  corners; 1 for a box, near 0 for a flat cell, Eq. (9) of the paper.
KS: Kreisselmeier-Steinhauser aggregate, a smooth bound below the smallest
  value; the outputs corner_ks and quality_ks of Quality, for constraints."""
"""Definitions of the measures of cells."""
