"""Pressure differences across the panels of a lattice: what they sum up to, and their derivatives."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import LatticeFlow, fit_grid
from bspline_mdao.errors import InputError
from bspline_mdao.flow import Snapshot
from bspline_mdao.flow.loads.panel_pressures import panel_pressures, panel_pressures_jvp, panel_pressures_vjp
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.plotting import sheets_of


def lattice(seed=3):
    """Forces on the panels of a lattice that is bent at random, and its nodes."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 4), np.linspace(-2.0, 0.0, 6), indexing="ij")
    nodes = np.stack([x, y, 0.1 * x], axis=-1) + 0.03 * rng.standard_normal((4, 6, 3))
    return rng, rng.standard_normal((3, 5, 3)), nodes


def test_derivatives_agree_with_complex_steps_and_in_both_modes():
    rng, forces, nodes = lattice()
    d_forces, d_nodes = rng.standard_normal(forces.shape), rng.standard_normal(nodes.shape)
    found = panel_pressures_jvp(forces, nodes, d_forces, d_nodes)
    step = 1e-30
    stepped = panel_pressures(forces + 1j * step * d_forces, nodes + 1j * step * d_nodes)
    np.testing.assert_allclose(found, stepped.imag / step, rtol=1e-12)
    bar = rng.standard_normal(found.shape)
    forces_bar, nodes_bar = panel_pressures_vjp(forces, nodes, bar)
    assert np.sum(bar * found) == pytest.approx(np.sum(forces_bar * d_forces) + np.sum(nodes_bar * d_nodes), rel=1e-12)


def test_a_force_along_the_normal_is_the_difference_times_the_area():
    _, _, nodes = lattice()
    normals = 0.5 * np.cross(nodes[1:, 1:] - nodes[:-1, :-1], nodes[:-1, 1:] - nodes[1:, :-1])
    assert (normals[..., 2] > 0.0).all()
    np.testing.assert_allclose(panel_pressures(0.7 * normals, nodes), 0.7, rtol=1e-13)


def test_the_lattice_of_a_wing_can_be_looked_at_and_its_differences_are_its_lift():
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    model = fit_grid(onera_m6_grid((9, 8, 7)))
    problem = om.Problem(LatticeFlow(model=model, reference_area=0.75, n_span=7), reports=None)
    problem.setup()
    problem.set_val("grid", model.regenerate().to_vector())
    problem.set_val("alpha", 3.0, units="deg")
    problem.run_model()
    (sheet,) = sheets_of(problem, ("lattice",), "delta_Cp")
    difference = sheet.values["delta_Cp"]
    assert sheet.points.shape == (5, 7, 3)
    normals = 0.5 * np.cross(
        sheet.points[1:, 1:] - sheet.points[:-1, :-1], sheet.points[:-1, 1:] - sheet.points[1:, :-1]
    )
    lift = np.sum(difference * np.abs(normals[..., 1])) / 0.75
    assert lift == pytest.approx(problem.get_val("CL").item(), rel=2e-3)  # suction along the chord is no pressure
    walls = model.regenerate().to_vector().reshape(-1, 3)
    assert walls[:, 2].min() - 1e-9 <= sheet.points[..., 2].min() < sheet.points[..., 2].max() < walls[:, 2].max()
    with pytest.raises(InputError, match="no lattice to show; give a problem with a LatticeFlow that has run"):
        sheets_of(Snapshot.of(model), ("lattice",), "delta_Cp")
