"""No mover may carry points far beyond what the surface does."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import openmdao.api as om
import pytest
from mover_cases import MOVERS, bent_surface, channel, made, mesh_of, wing
from topology_cases import box, grid_of, patch

from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.movement.fixed_interior import FixedInterior
from bspline_mdao.core.movement.increments import IncrementalMover
from bspline_mdao.core.movement.mover import MAX_AMPLIFICATION
from bspline_mdao.core.movement.radial_basis import RadialBasis
from bspline_mdao.core.om.control_mesh_move import ControlMeshMove
from bspline_mdao.errors import MovementError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.names import SURFACE_CONTROL_POINTS

KINDS = {
    **{kind.__name__: partial(made, kind, n_increments=2) for kind in MOVERS},
    "elasticity": partial(LinearElasticity, n_increments=2),
    "elasticity, nu = -0.95": partial(LinearElasticity, poisson_ratio=-0.95, n_increments=2),
    "elasticity, nu = 0.45": partial(LinearElasticity, poisson_ratio=0.45, n_increments=2),
    "radial, volume": partial(RadialBasis, kernel="volume", n_increments=2),
}


def amplification(mover, surface):
    """Largest displacement of a point by that of the surface."""
    mesh = mover.mesh
    moved = mover.move(mesh.points, surface).points
    asked = np.linalg.norm(surface - mesh.points[mesh.surface_ids], axis=1).max()
    return np.linalg.norm(moved - mesh.points, axis=1).max() / asked


@pytest.mark.parametrize("kind", KINDS)
def test_movers_stay_far_within_the_bound_on_meshes_that_are_valid(kind):
    for mesh in (channel(), wing()):
        _, surface = bent_surface(mesh, size=0.05, seed=4)
        assert 0.99 < amplification(KINDS[kind](mesh), surface) < 0.2 * MAX_AMPLIFICATION


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["elasticity", "elasticity, nu = 0.45"])
def test_a_folded_mesh_that_runs_away_is_refused_with_a_cause_and_advice_that_helps(kind):
    grid = onera_m6_grid((5, 5, 5))
    for method in ("least_squares", "valid"):
        model = fit_grid(grid, n_control=(5, 5, 5), method=method)
        mesh = moving_mesh(model)
        surface = parse_deformation("twist=20deg", model, mesh).apply(mesh.points[mesh.surface_ids])
        mover = KINDS[kind](mesh, n_increments=1)
        if model.report.n_invalid:
            with pytest.raises(
                MovementError, match=r"moved .* m away by a surface that moves by 0.181 m at most"
            ) as error:
                mover.move(mesh.points, surface)
            assert f"{mesh.n_invalid:,} of {len(mesh.elements):,} elements invalid before the move" in str(error.value)
            assert 'method="valid"' in str(error.value)
        else:
            assert amplification(mover, surface) < 5.0
    assert model.report.n_invalid == 0


@dataclass(frozen=True)
class Runaway(IncrementalMover):
    """Carries one point away: by as much as asked, or to nowhere."""

    mesh: MovingMesh
    factor: float
    n_increments: int = 2

    def _step(self, initial, before, surface):
        step = FixedInterior(self.mesh)._step(initial, before, surface)
        step.points[7] += self.factor * (surface - before[self.mesh.surface_ids]).max(axis=0)
        return step


@pytest.mark.parametrize(("factor", "is_refused"), [(90.0, False), (110.0, True), (np.nan, True)])
def test_what_one_point_may_do_is_bounded_in_the_component(factor, is_refused):
    line = np.linspace(0.0, 1.0, 5)
    mesh = mesh_of(grid_of(box(line, line, line), patches=[patch("wall", Window(0, (0, 0, 0), (4, 4, 0)))]))
    problem = om.Problem(reports=False)
    move = ControlMeshMove(mover=Runaway(mesh, factor))
    problem.model.add_subsystem("move", move, promotes=["*"])
    problem.setup()
    problem.set_val(SURFACE_CONTROL_POINTS, (mesh.points[mesh.surface_ids] + [0.0, 0.0, 0.01]).ravel())
    if is_refused:
        with pytest.raises(om.AnalysisError, match=r"'move'.*point \(1, 2, 3\) of block 1 would be moved"):
            problem.run_model()
    else:
        problem.run_model()


def test_round_off_of_a_mesh_that_stays_is_not_judged():
    mesh = channel()
    surface = mesh.points[mesh.surface_ids] + 1e-13
    assert amplification(Runaway(mesh, 1e4), surface) > 10 * MAX_AMPLIFICATION
