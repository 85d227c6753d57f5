"""Central differences that are extrapolated to a step of zero."""

import numpy as np


def extrapolated_difference(function, step, levels):
    """Central differences of a function of one number at halved steps, extrapolated to step zero (Richardson)."""
    table = [(function(h) - function(-h)) / (2 * h) for h in step / 2.0 ** np.arange(levels)]
    for power in range(1, levels):
        table = [(4**power * fine - coarse) / (4**power - 1) for coarse, fine in zip(table, table[1:])]
    return table[0]


def extrapolated_runs(problem, name, direction, outputs):
    """Derivatives of some outputs of a problem, one after another, along a direction in an input."""
    start = problem.get_val(name).copy()

    def run(step):
        problem.set_val(name, start + step * direction)
        problem.run_model()
        return np.concatenate([problem.get_val(of).ravel() for of in outputs])

    found = extrapolated_difference(run, 4e-3, levels=3)
    problem.set_val(name, start)
    return found
