"""Least squares: the weighted mean square of what a vector misses of a target."""

from __future__ import annotations

import numpy as np
import openmdao.api as om


class Mismatch(om.ExplicitComponent):
    """Weighted sum of the squares of the differences between a vector and a target.

    ============  ======  ======  =======  =======================================
    name          role    shape   units    meaning
    ============  ======  ======  =======  =======================================
    option        input   (n,)    option   the vector
    ``mismatch``  output  (1,)             ``sum weights (vector - target)^2``
    ============  ======  ======  =======  =======================================

    Options
    -------
    source : str
        Name of the vector.
    units : str or None
        Its units.
    target : ndarray, shape (n,)
        The target.
    weights : float or ndarray, shape (n,)
        Weights, in inverse units squared.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("source", types=str, desc="name of the vector")
        self.options.declare("units", default=None, desc="units of the vector")
        self.options.declare("target", types=np.ndarray, recordable=False, desc="what is to be matched")
        self.options.declare("weights", types=(float, np.ndarray), recordable=False, desc="weights of the squares")

    def setup(self):
        """Declare the variables."""
        source = self.options["source"]
        self.add_input(source, val=self.options["target"], units=self.options["units"])
        self.add_output("mismatch")
        self.declare_partials("mismatch", source)

    def compute(self, inputs, outputs):
        """Square the differences."""
        outputs["mismatch"] = np.sum(self.options["weights"] * self._differences(inputs) ** 2)

    def compute_partials(self, inputs, partials):
        """Differentiate the squares."""
        partials["mismatch", self.options["source"]] = 2.0 * self.options["weights"] * self._differences(inputs)

    def _differences(self, inputs) -> np.ndarray:
        return inputs[self.options["source"]] - self.options["target"]
