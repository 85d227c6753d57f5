"""A flexible wing in Euler flow.

A flexible wing in Euler flow: MPhys couples the flow, OpenAeroStruct's beam and rigid links between them. It takes a
minute, and half an hour on the finer grid. The output is lift, drag, bending and wash-out of the rigid wing and at two
dynamic pressures, how the coupling converged, a check of the totals of the coupled wing against differences, and a
picture of span load and bending.
"""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from mphys import Multipoint
from mphys.scenarios import ScenarioAeroStructural

import bspline_mdao as bm
from bspline_mdao.flow import Spar
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals

SIZES = {False: (9, 7, 6), True: (17, 17, 13)}
"""Nodes of every block along the chord, the span and off the wall; and of the finer wing (True)."""

AREA = 0.753
"""Of the half wing (m^2)."""

SPAR, RADIUS = Spar((0.003, 0.004, 0.005, 0.006)), (0.02, 0.04)
"""Wall thickness and outer radius of the beam from the tip to the root (m)."""

CHORDWISE, ELEMENTS = 0.35, 6
"""Where in the chord the beam lies, and of how many elements it is."""

PRESSURES = (1.0, 1e4, 2e4)
"""Dynamic pressures (Pa): the first bends nothing."""

STYLES = dict(zip(PRESSURES, (GRAY, BLUE, ORANGE)))


def lay_beam(surface: bm.measures.SurfaceGrid) -> np.ndarray:
    """Nodes from the tip to the root, at a part of the chord, shape (ELEMENTS + 1, 3)."""
    ends = []
    for station in (surface.points[:, 2].max(), 0.0):
        section = surface.points[np.isclose(surface.points[:, 2], station, atol=1e-9)]
        front, rear = section[section[:, 0].argmin()], section[section[:, 0].argmax()]
        ends.append(front + CHORDWISE * (rear - front))
    return np.linspace(*ends, ELEMENTS + 1)


class FlexibleWing(Multipoint):
    """One flight condition: twist moves the jig and the beam in it, which bends under the loads of the flow."""

    def initialize(self):
        """Declare the option."""
        self.options.declare("fine", types=bool)

    def setup(self):
        """Make the builders, the geometry and the scenario, and connect them by the names of MPhys."""
        model = bm.fit_grid(bm.generators.onera_m6_grid(SIZES[self.options["fine"]]))
        surface, mesh = bm.measures.SurfaceGrid.of(model), bm.movers.moving_mesh(model)
        nodes = lay_beam(surface)
        aero = bm.mphys.EulerBuilder(model, scenario="aerostructural", reference_area=AREA, iprint=0)
        beam = bm.mphys.BeamBuilder(nodes, SPAR, RADIUS)
        links = bm.mphys.RigidLinkBuilder(bm.flow.RigidLinks.to_beam(surface.points, nodes, along=[0.0, 0.0, 1.0]))
        twist = bm.design.Twist("twist", bm.design.ReferenceAxis.of(mesh, at=CHORDWISE), stations=3)
        variables = bm.design.Parametrization(mesh, [twist])
        geometry = bm.mphys.SurfaceGeometry(model=model, parametrization=variables, point_sets={"x_struct0": nodes})
        self.add_subsystem("mesh", aero.get_mesh_coordinate_subsystem())
        self.add_subsystem("beam_mesh", beam.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", geometry, promotes_inputs=["twist"])
        scenario = ScenarioAeroStructural(aero_builder=aero, struct_builder=beam, ldxfer_builder=links)
        nonlinear = om.NonlinearBlockGS(maxiter=30, rtol=1e-12, atol=1e-12, use_aitken=True, iprint=-1)
        linear = om.LinearBlockGS(maxiter=9, rtol=1e-8, atol=1e-12, use_aitken=True, iprint=-1)
        self.mphys_add_scenario("cruise", scenario, nonlinear, linear)
        self.connect("mesh.x_aero0_mesh", "geometry.x_aero0_geometry_input")
        self.connect("geometry.x_aero0_geometry_output", "cruise.x_aero0")
        self.connect("beam_mesh.x_struct0_mesh", "geometry.x_struct0_geometry_input")
        self.connect("geometry.x_struct0_geometry_output", "cruise.x_struct0")


def pose(fine: bool) -> om.Problem:
    """Pose the problem and set it up."""
    problem = om.Problem(FlexibleWing(fine=fine), reports=None)
    problem.model.add_design_var("twist", units="deg")
    problem.model.add_design_var("cruise.spar_thickness", ref=1e-3, units="m")
    problem.model.add_objective("cruise.CD", ref=1e-2)
    problem.model.add_constraint("cruise.CL", equals=0.3)
    problem.model.add_constraint("cruise.failure", upper=0.0)
    problem.setup(mode="rev")
    problem.set_val("cruise.angle_of_attack", 3.06, units="deg")
    problem.set_val("cruise.mach_number", 0.3)
    return problem


def fly(problem: om.Problem, pressure: float) -> dict:
    """Run the wing at a dynamic pressure (Pa), and sum it up: coefficients, tip (m, deg), iterations of the coupling.

    The tip's wash-out is positive where the nose goes down.
    """
    problem.set_val("cruise.dynamic_pressure", pressure, units="Pa")
    problem.run_model()
    tip = problem.get_val("cruise.u_struct").reshape(-1, 6)[0]
    numbers = {name: problem.get_val(f"cruise.{name}").item() for name in ("CL", "CD", "CD_induced", "failure")}
    bent = {"tip": tip[1], "washout": np.degrees(tip[5]), "span_load": problem.get_val("cruise.span_load").copy()}
    beam = {"bending": problem.get_val("cruise.u_struct").reshape(-1, 6)[:, 1].copy()}
    return numbers | bent | beam | {"iterations": problem.model.cruise.coupling.nonlinear_solver._iter_count}


def main(fine: bool = False, figures=None) -> dict:
    """Solve the wing at rising dynamic pressures, and check the totals at the last.

    Parameters
    ----------
    fine : bool
        17 x 17 x 13 nodes per block in place of 9 x 7 x 6.
    figures : path-like, optional
        Folder for ``euler_aerostructural.png``.

    Returns
    -------
    dict
        ``flights``: what `fly` returns by dynamic pressure; ``totals``, see `check_totals`.
    """
    problem = pose(fine)
    flights = {pressure: fly(problem, pressure) for pressure in PRESSURES}
    if figures:
        draw(figures, flights)
    problem.set_val("twist", [0.0, 0.5, 1.0], units="deg")
    problem.run_model()
    return {"flights": flights, "totals": check_totals(problem, n_directions=1, step=0.05, levels=3)._asdict()}


def draw(folder, flights: dict[float, dict]) -> None:
    """Draw span load and bending."""
    with figure(folder, "euler_aerostructural", size=(8.0, 3.2)) as canvas:
        load, bending = canvas.subplots(1, 2)
        for pressure, flight in flights.items():
            style = {"color": STYLES[pressure], "label": f"{pressure / 1e3:g} kPa"}
            load.plot(flight["span_load"], "o-", **style)
            bending.plot(np.linspace(1.0, 0.0, ELEMENTS + 1), 1e3 * flight["bending"], **style)
        load.set(xlabel="strip, from the tip", ylabel="chord times lift coefficient (m)")
        bending.set(xlabel="$2 y / b$", ylabel="bending of the beam (mm)", xlim=(0.0, 1.0))
        load.legend()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/euler_aerostructural.png'
