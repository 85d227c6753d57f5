"""Functions for JAX and PyTorch, each with the derivative that our own components give."""

from dataclasses import dataclass
from functools import cache

import numpy as np

import bspline_mdao as bm
from bspline_mdao.core.bridges.functions import grid_function, measures_function, quality_function
from bspline_mdao.design import ThicknessFactor, Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import EnclosedVolume, Thickness

ASKED = ("control_points", "variables", "asked", "asked_some", "quality", "measures", "measures_of_variables")


@cache
def wing(wall_layer=True):
    """A small wing, of unequal numbers in all directions."""
    return bm.DesignSurface.of(bm.fit_grid(onera_m6_grid((9, 8, 7)), n_control=(6, 5, 4), wall_layer=wall_layer))


@cache
def shape():
    of = wing()
    return of.parametrization([Twist("twist", of.axis, stations=3), ThicknessFactor("thick", of.axis, stations=2)])


@cache
def measured():
    surface = wing().surface
    return [EnclosedVolume.of(surface), Thickness.grid(surface, 3, 2)]


@dataclass(frozen=True)
class Case:
    """A function: how it is made of a namespace, what it is made of, and where it is looked at."""

    name: str
    make: object  # of a namespace
    batches: object  # what is beneath
    points: dict  # where


def case(name) -> Case:
    of, random = wing(), np.random.default_rng(len(name))
    model, surface = of.model, of.surface
    some = np.delete(np.arange(surface.n_points), slice(2, None, 3))[::-1]
    size = np.ptp(surface.points)
    arguments = {
        "control_points": ("grid", (model,), {}),
        "variables": ("grid", (model, shape()), {}),
        "asked": ("grid", (model,), {"surface": surface}),
        "asked_some": ("grid", (model,), {"surface": surface, "numbers": some}),
        "quality": ("quality", (model,), {"rho": 20.0, "rho_height": 30.0}),
        "measures": ("measures", (measured(),), {}),
        "measures_of_variables": ("measures", (measured(), model, shape()), {}),
    }
    starts = {
        "control_points": model.control_points,
        "asked": surface.points,
        "asked_some": surface.points[some],
        "quality": model.baseline.to_vector().reshape(-1, 3),
        "measures": surface.points,
    }
    kind, given, options = arguments[name]
    make = {"grid": grid_function, "quality": quality_function, "measures": measures_function}[kind]
    batches = make(*given, **options)
    if batches.takes_names:
        start = shape().initial
        points = {key: start[key] + 0.3 * random.uniform(-1.0, 1.0, start[key].shape) for key in batches.inputs}
    else:
        (key,) = batches.inputs
        turned = starts[name] + 0.02 * size * starts[name][:, [1]] ** 2 / np.ptp(starts[name]) ** 2 * [1.0, 0.0, 1.0]
        points = {key: turned}
    return Case(name, lambda space: getattr(space, kind)(*given, **options), batches, points)


def random_like(shapes, seed):
    random = np.random.default_rng(seed)
    return {name: random.uniform(-1.0, 1.0, shape) for name, shape in shapes.items()}


def largest_difference(found, expected):
    """Largest difference of several arrays, relative to the largest number of each."""
    return max(
        float(np.abs(np.asarray(a) - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), 1e-300))
        for a, b in zip(found, expected)
    )
