"""Named options of `fit_grid`, also for the help of the command, which should not wait for NumPy and numba."""

from __future__ import annotations

METHODS = {
    "valid": "least squares, and a quasi-interpolant where these fold the control mesh",
    "least_squares": "lets it fold",
    "quasi_interpolant": "solves nothing",
}
"""Methods of finding control points, see `bspline_mdao.fit_grid`, with a short description of each."""

EXPONENTS = {"chord_length": 1.0, "centripetal": 0.5, "uniform": 0.0}
"""Kinds of parametrization with the power of the chord lengths; uniform parameters are proportional to the index."""
