"""Boundary layers and wakes: elements a million times as long as they are high, whose volumes span twelve decades."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mover_cases import in_symmetry, rotation

from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.movement import equilibrium, equilibrium_mover
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.movement.springs import TorsionalSprings
from bspline_mdao.core.movement.young_modulus import RegularisedMeasures
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.testing import central_difference

C_GRID, RAE, O_GRID = "cfl3d_naca0012_cgrid.fmt", "aither_rae2822.xyz", "mach_naca0012.cgns"


@cache
def plate_in_its_wake(is_turned=False):
    """Elements about a flat plate and its wake, 1e-6 to 600 high and 0.005 to 8 long.

    The plate is the surface, the wake is as free as all else; the sides slide in their planes, the rest is held.
    """
    heights = 1e-6 * 5.5 ** np.arange(13)
    x = np.concatenate([[-4.0, -1.0, 0.0, 0.005, 0.03, 0.2, 0.6, 1.0], 1.0 + 0.05 * 3.0 ** np.arange(1, 6)])
    y, z = np.concatenate([-heights[::-1], [0.0], heights]), np.array([0.0, 0.3, 1.0])
    lattice = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    ids = np.arange(lattice[..., 0].size, dtype=np.int32).reshape(lattice.shape[:3])
    points, turn = lattice.reshape(-1, 3), turn_of(is_turned)
    is_plate = (points[:, 1] == 0.0) & (points[:, 0] >= 0.0) & (points[:, 0] <= 1.0)
    is_held = np.isin(points[:, 0], x[[0, -1]]) | np.isin(points[:, 1], y[[0, -1]])
    is_free = np.repeat(~(is_plate | is_held)[:, None], 3, axis=1)
    is_free[:, 2] &= ~np.isin(points[:, 2], z[[0, -1]])
    surface_ids = np.flatnonzero(is_plate).astype(np.int32)
    on_planes = np.flatnonzero(np.isin(points[surface_ids, 2], z[[0, -1]]))
    frames = np.repeat(turn.T[None], len(points), axis=0)
    normals = np.repeat(turn[None, :, 2], len(on_planes), axis=0)
    return MovingMesh((ids,), ("block 1",), points @ turn.T, surface_ids, is_free, frames, on_planes, normals)


def turn_of(is_turned):
    """Rotation out of all axes, or none."""
    return rotation() if is_turned else np.eye(3)


def pitched(mesh, is_turned=False, angle=0.1):
    """Surface of `plate_in_its_wake` turned about its leading edge and bent a little."""
    x = mesh.points[mesh.surface_ids] @ turn_of(is_turned)
    y = np.sin(angle) * x[:, 0] + 0.02 * x[:, 0] ** 2
    return np.stack([np.cos(angle) * x[:, 0], y, x[:, 2]], axis=1) @ turn_of(is_turned).T


def section(folder, name, method):
    """Control mesh of a section of a wing with its wake, and its surface pitched by 5 degrees."""
    grid = read_grid(folder / name)
    windows = [face.window for face in find_topology(grid).boundary if face.patch is None]
    model = fit_grid(replace(grid, patches=(*grid.patches, *guess_patches(grid, windows))), method=method)
    mesh = moving_mesh(model)
    return mesh, parse_deformation("pitch=5", model, mesh).apply(mesh.points[mesh.surface_ids])


def lost_in_products(mesh, movement, seed=0):
    """What dot tests of random changes of the surface and of waves of all points miss, by the terms of the product."""
    random = np.random.default_rng(seed)
    bar, d_initial = random.normal(size=mesh.points.shape), np.sin(mesh.points @ random.normal(size=(3, 3)))
    d_surface = in_symmetry(mesh, random.normal(size=(len(mesh.surface_ids), 3)))
    initial_bar, surface_bar = movement.vjp(bar)
    by_surface = bar * movement.jvp(0.0 * d_initial, d_surface)
    by_initial = bar * movement.jvp(d_initial, 0.0 * d_surface)
    return (
        abs(by_surface.sum() - (surface_bar * d_surface).sum()) / np.linalg.norm(by_surface),
        abs(by_initial.sum() - (initial_bar * d_initial).sum()) / np.linalg.norm(by_initial),
    )


def lost_in_differences(mover, surface, d_surface, h):
    """How far a central difference of fourth order along a change of the surface is from the derivative."""
    initial = mover.mesh.points
    difference = central_difference(lambda t: mover.move(initial, surface + t * d_surface).points, 2.0 * h, levels=2)
    exact = mover.move(initial, surface).jvp(np.zeros_like(initial), d_surface)
    return np.abs(difference - exact).max() / np.abs(exact).max()


def noise(mover, surface):
    """How far a relative change of 1e-15 of the surface moves points, by the size of the mesh."""
    mesh = mover.mesh
    shaken = in_symmetry(mesh, 1e-15 * surface * np.random.default_rng(3).uniform(-1.0, 1.0, surface.shape))
    moved = (mover.move(mesh.points, at).points for at in (surface, surface + shaken))
    return np.abs(np.subtract(*moved)).max() / mesh.size


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mover", "n_increments"),
    [(LinearElasticity, 1), (LinearElasticity, 3), (TorsionalSprings, 1), (TorsionalSprings, 3)],
)
def test_products_of_slivers_are_transposed_to_round_off(mover, n_increments):
    mesh = plate_in_its_wake()
    volumes = np.exp(RegularisedMeasures.at(mesh, mesh.points).log_volume)
    assert volumes.max() / volumes.min() > 1e12
    movement = mover(mesh, n_increments=n_increments).move(mesh.points, pitched(mesh))
    lost = [lost_in_products(mesh, movement, seed) for seed in range(5)]  # which differ by chance, by a factor of ten
    assert np.median(lost, axis=0).max() < 1e-11
    assert movement.report.digits > 11.0


def test_products_by_the_surface_are_exact_for_slivers_along_no_axis():
    mesh = plate_in_its_wake(True)
    movement = LinearElasticity(mesh, n_increments=3).move(mesh.points, pitched(mesh, True))
    by_surface, by_initial = lost_in_products(mesh, movement)
    assert by_surface < 1e-12
    assert by_initial < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("is_turned", [False, True])
def test_derivatives_of_slivers_agree_with_differences(is_turned):
    mesh = plate_in_its_wake(is_turned)
    mover, surface = LinearElasticity(mesh, n_increments=3), pitched(mesh, is_turned)
    assert lost_in_differences(mover, surface, surface - mesh.points[mesh.surface_ids], h=3e-3) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("is_turned", [False, True])
def test_round_off_of_the_surface_stays_round_off_among_slivers(is_turned):
    mesh = plate_in_its_wake(is_turned)
    assert noise(LinearElasticity(mesh, n_increments=5), pitched(mesh, is_turned)) < 1e-15


def test_the_plain_factor_would_leave_few_digits_of_slivers(monkeypatch):
    mesh = plate_in_its_wake()
    monkeypatch.setattr(equilibrium_mover, "REFINE_ABOVE", np.inf)
    monkeypatch.setattr(equilibrium_mover, "REFINE_PRODUCTS_ABOVE", np.inf)
    movement = LinearElasticity(mesh, n_increments=1).move(mesh.points, pitched(mesh))
    assert max(lost_in_products(mesh, movement)) > 1e-10
    assert movement.report.digits < 9.0
    assert movement.report.increments[0].solve.iterations == 0


def test_corrections_that_do_not_converge_are_told_by_the_digits(monkeypatch):
    mesh = plate_in_its_wake()
    monkeypatch.setattr(equilibrium, "MAX_CORRECTIONS", 1)
    assert 3.0 < LinearElasticity(mesh, n_increments=1).move(mesh.points, pitched(mesh)).report.digits < 13.0
    monkeypatch.setattr(equilibrium, "LEAST_GAIN", 0.0)
    assert LinearElasticity(mesh, n_increments=1).move(mesh.points, pitched(mesh)).report.digits < 9.0


@pytest.mark.slow
@pytest.mark.parametrize("method", ["least_squares", "valid"])
@pytest.mark.parametrize("name", [C_GRID, RAE, O_GRID])
def test_products_and_differences_on_viscous_sections_are_exact(real_grids, name, method):
    mesh, surface = section(real_grids, name, method)
    mover = LinearElasticity(mesh, n_increments=2, keep_factors=True)
    movement = mover.move(mesh.points, surface)
    assert max(lost_in_products(mesh, movement)) < 1e-11
    assert lost_in_differences(mover, surface, surface - mesh.points[mesh.surface_ids], h=3e-3) < 1e-7
    assert noise(mover, surface) < 1e-13
