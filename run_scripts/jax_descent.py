"""Gradient descent in JAX.

Gradient descent on the twist of a wing, with a flow model written in JAX. The flow model is forty lines: a horseshoe
vortex for each strip of the wing, the angle of attack that gives the lift, and the induced drag in the Trefftz plane.
It sees the nodes of the wing's edges in the grid, which `bspline_mdao.jax.grid` makes from the twist; the penalty on
bad cells is a function of all nodes. One ``jax.grad`` differentiates all of it. The wing is the ONERA M6, and starts
with its tip twisted up. It takes half a minute. The output is the span efficiency at the start and at the end, which
the model overestimates by some 2 % because it has few strips, the twist, the descent, and the quality of the cells.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

import bspline_mdao as bm
from bspline_mdao.jax import grid, quality
from bspline_mdao.plotting import BLUE, GRAY, draw_ellipse, draw_span_load, draw_twist, figure
from bspline_mdao.scripts import run

LIFT = 0.3
"""Lift coefficient."""

N_STRIPS = 24
"""Strips of the half wing."""

START = (0.0, 3.0, 6.0, 9.0)
"""Twist at the stations at the start (degrees)."""

WORST_CORNER = 0.02
"""What the bound of the cells' corner triple products is to keep."""

DOWNSTREAM = jnp.array([1.0, 0.0, 0.0])


def edge_rows(wing: bm.DesignSurface) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the nodes of the leading and the trailing edge in the grid, from the root to the tip."""
    span_by_chord = wing.surface.rows[wing.surface.faces[0]]
    return span_by_chord[:, 0], span_by_chord[:, -1]


def leg(point: jax.Array, start: jax.Array) -> jax.Array:
    """Velocity at a point of a vortex of unit strength from a point downstream to infinity."""
    arm = point - start
    across = jnp.cross(DOWNSTREAM, arm)
    return across / (across @ across) * (1.0 + arm[0] / jnp.linalg.norm(arm)) / (4.0 * jnp.pi)


def bound(point: jax.Array, start: jax.Array, end: jax.Array) -> jax.Array:
    """Velocity at a point of a vortex of unit strength from one point to another."""
    a, b = point - start, point - end
    across = jnp.cross(a, b)
    along = (end - start) @ (a / jnp.linalg.norm(a) - b / jnp.linalg.norm(b))
    return across / (across @ across) * along / (4.0 * jnp.pi)


def horseshoe(point: jax.Array, start: jax.Array, end: jax.Array) -> jax.Array:
    """Velocity at a point of the horseshoe vortex of a strip, and of its image in the symmetry plane."""
    mirror = jnp.array([1.0, 1.0, -1.0])
    whole = bound(point, start, end) - leg(point, start) + leg(point, end)
    image = bound(point, mirror * end, mirror * start) - leg(point, mirror * end) + leg(point, mirror * start)
    return whole + image


def stations(edge: jax.Array) -> jax.Array:
    """Points of an edge at even distances along the span: nodes are much closer at the tip than strips should be."""
    z = jnp.linspace(0.0, edge[-1, 2], N_STRIPS + 1)
    return jnp.stack([jnp.interp(z, edge[:, 2], edge[:, 0]), jnp.interp(z, edge[:, 2], edge[:, 1]), z], axis=1)


def loading(leading: jax.Array, trailing: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Ends of the strips of a wing with these edges, their circulation at the lift asked for, and its efficiency.

    This is the ideal induced drag, of an elliptic load, divided by the wing's.
    """
    leading, trailing = stations(leading), stations(trailing)
    quarter = leading + 0.25 * (trailing - leading)
    chords = trailing - leading
    starts, ends = quarter[:-1], quarter[1:]
    middle = 0.5 * (leading[:-1] + leading[1:])
    chord = 0.5 * (chords[:-1] + chords[1:])
    normals = jnp.cross(ends - starts, chord)
    normals = normals / jnp.linalg.norm(normals, axis=1, keepdims=True)
    velocity = jax.vmap(lambda p: jax.vmap(lambda a, b: horseshoe(p, a, b))(starts, ends))(middle + 0.75 * chord)
    matrix = jnp.einsum("ijd,id->ij", velocity, normals)
    at_zero, by_angle = jnp.linalg.solve(matrix, -normals[:, :2]).T  # strengths; linear in small angles of attack
    z = leading[:, 2]
    width = z[1:] - z[:-1]
    area = jnp.sum(width * jnp.linalg.norm(chord, axis=1))
    lift_at_zero, lift_by_angle = (2.0 * jnp.sum(strength * width) / area for strength in (at_zero, by_angle))
    strength = at_zero + (LIFT - lift_at_zero) / lift_by_angle * by_angle
    shed = jnp.diff(jnp.concatenate([jnp.zeros(1), strength, jnp.zeros(1)]))
    shed = shed.at[0].set(0.0)  # there is none in the plane of symmetry
    between = 0.5 * (z[1:] + z[:-1])[:, None]
    downwash = ((1.0 / (between - z) - 1.0 / (between + z)) @ shed) / (2.0 * jnp.pi)
    drag = jnp.abs(jnp.sum(strength * downwash * width) / area)
    return z, strength, LIFT**2 / (jnp.pi * 2.0 * z[-1] ** 2 / area) / drag


def descend(function, start: np.ndarray, n_steps: int) -> tuple[np.ndarray, list[float]]:
    """Go down the gradient: longer steps after each that is better, shorter ones where none is."""
    value_and_gradient = jax.jit(jax.value_and_grad(function))
    x, step = jnp.asarray(start), 1.0
    value, gradient = value_and_gradient(x)
    history = [float(value)]
    for _ in range(n_steps):
        tried = x - step * gradient / jnp.linalg.norm(gradient)
        found, slope = value_and_gradient(tried)
        if found < value:
            x, value, gradient, step = tried, found, slope, 1.5 * step
            history.append(float(value))
        else:
            step *= 0.4
    return np.asarray(x), history


def main(figures=None, n_steps: int = 25) -> dict:
    """Twist the wing.

    Parameters
    ----------
    figures : path-like, optional
        Folder for ``jax_descent.png``.
    n_steps : int
        Steps that are tried.

    Returns
    -------
    dict
        ``efficiency`` at the start and at the end, ``twist`` (degrees), ``history`` of what is minimised, the number
        of ``inverted`` cells and ``corner``, the bound of the corner triple products, at the end.
    """
    jax.config.update("jax_enable_x64", True)
    wing = bm.DesignSurface.of(bm.fit_grid(bm.generators.onera_m6_grid((9, 8, 13)), n_control=(6, 5, 6)))
    shape = wing.parametrization([bm.design.Twist("twist", wing.axis, stations=len(START))])
    nodes, cells = grid(wing.model, shape), quality(wing.model, ["corner_ks"])
    leading, trailing = edge_rows(wing)

    def loss(twist: jax.Array) -> jax.Array:
        x = nodes({"twist": twist})
        short = jnp.maximum(0.0, WORST_CORNER - cells(x)["corner_ks"])
        return 1.0 / loading(x[leading], x[trailing])[2] + (short / WORST_CORNER) ** 2

    twist, history = descend(loss, np.array(START), n_steps)
    wings = {"start": nodes({"twist": np.array(START)}), "end": (moved := nodes({"twist": twist}))}
    loads = {name: loading(x[leading], x[trailing]) for name, x in wings.items()}
    found = bm.grids.report_quality(bm.grids.GridQuality.of_baseline(wing.model.baseline), np.asarray(moved))
    numbers = {
        "efficiency": {name: float(found[2]) for name, found in loads.items()},
        "twist": twist.tolist(),
        "history": history,
        "inverted": found.n_inverted,
        "corner": float(cells(moved)["corner_ks"]),
    }
    if figures is not None:
        with figure(figures, "jax_descent", (9.6, 3.0)) as canvas:
            descent, load, angles = canvas.subplots(1, 3)
            descent.plot(history, ".-", color=BLUE)
            descent.set(xlabel="step that was taken", ylabel="1 / efficiency, and penalty")
            descent.xaxis.get_major_locator().set_params(integer=True)
            for (name, (ends, strength, _)), color in zip(loads.items(), (GRAY, BLUE)):
                draw_span_load(load, np.asarray(ends), np.asarray(strength), color=color, label=name)
                draw_twist(angles, wing.model, np.asarray(wings[name]), color=color)
            draw_ellipse(load)
    return numbers


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/jax_descent.png'
