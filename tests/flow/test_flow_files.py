"""Files of a flow: fields that ParaView reads, and states to start from again."""

import json
from functools import cache

import h5py
import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, InputError, fit_grid
from bspline_mdao.core.model.model_file import checksum_of
from bspline_mdao.flow.euler.fields import field_values, node_means
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.generators import infinite_wing_grid, naca_section, onera_m6_grid
from bspline_mdao.grids.topology.node_numbering import node_copies


@cache
def wing():
    """A wing of 1,024 cells."""
    return fit_grid(onera_m6_grid((5, 5, 5)), keep_residual=False)


def problem(model=None, **options):
    problem = om.Problem(reports=False)
    options = {"reference_area": 1.16, "iprint": 0} | options
    problem.model.add_subsystem("flow", EulerFlow(model=model or wing(), **options), promotes=["*"])
    problem.setup()
    return problem


def run(problem, **values):
    for name, value in values.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


@pytest.fixture(scope="module")
def flown():
    return run(problem(), alpha=3.0, Mach_number=0.4)


def n_products(problem):
    return sum(step.n_products for step in problem.model.flow.state.solution.history)


def test_uniform_stream_has_the_fields_of_the_stream():
    axes = np.eye(3)[[0, 2, 1]]
    found = field_values(np.tile(free_stream(0.4, 0.1, axes), (3, 1)), 0.4)
    for name in ("Cp", "entropy", "total_pressure_loss"):
        np.testing.assert_allclose(found[name], 0.0, atol=1e-14)
    np.testing.assert_allclose(found["Mach"], 0.4)
    np.testing.assert_allclose(np.linalg.norm(found["velocity"], axis=1), 1.0)


def test_isentropic_state_has_a_pressure_but_neither_entropy_nor_loss():
    mach, speed = 0.5, 0.7
    temperature = 1.0 + 0.2 * (mach**2 - speed**2)
    state = [[temperature**2.5, speed, 0.0, 0.0, temperature**3.5 / 1.4]]
    found = field_values(np.array(state), mach)
    assert found["Cp"].item() < -0.5
    assert found["Mach"].item() == pytest.approx(speed / np.sqrt(temperature))
    assert abs(found["entropy"].item()) < 1e-14
    assert abs(found["total_pressure_loss"].item()) < 1e-14


def test_node_means_of_a_constant_are_it_and_agree_where_blocks_meet():
    topology = wing().topology
    cells = np.random.default_rng(0).standard_normal((sum(np.prod(np.subtract(s, 1)) for s in topology.shapes), 2))
    np.testing.assert_allclose(node_means(topology, np.ones_like(cells)), 1.0, rtol=1e-14)
    means = node_means(topology, cells)
    for row, source in node_copies(topology):
        np.testing.assert_array_equal(means[row], means[source])


def test_fields_are_read_back_on_nodes_cells_and_walls(flown, tmp_path, pyvista):
    flown.model.flow.write_fields(tmp_path / "flow.vtm")
    blocks = pyvista.read(tmp_path / "flow.vtm")
    states = flown.get_val("states").reshape(-1, 5)
    expected = field_values(states, 0.4)
    n_cells = 0
    for block in blocks:
        for name, values in expected.items():
            of_block = values[n_cells : n_cells + block.n_cells]
            shape = tuple(n - 1 for n in block.dimensions)
            flat = of_block.reshape(*shape, *values.shape[1:]).swapaxes(0, 2).reshape(of_block.shape)
            np.testing.assert_allclose(block.cell_data[name], flat, rtol=1e-12)
            assert np.isfinite(block.point_data[name]).all()
        n_cells += block.n_cells
    assert n_cells == len(states)
    walls, pressures = pyvista.read(tmp_path / "flow_walls.vtm"), flown.get_val("Cp")
    assert sum(wall.n_cells for wall in walls) == len(pressures)
    areas = [wall.compute_cell_sizes()["Area"] * wall.cell_data["Cp"] for wall in walls]
    corners, points = flown.model.flow.forces._forces.walls.corners, flown.get_val("grid").reshape(-1, 3)
    a, b, c, d = points[corners].swapaxes(0, 1)
    sizes = 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1)
    assert sum(map(np.sum, areas)) == pytest.approx(sizes @ pressures, rel=0.02)
    assert min(wall.point_data["Cp"].min() for wall in walls) >= pressures.min()


def test_fields_and_states_of_no_flow_are_refused(tmp_path):
    for write in ("write_fields", "save_states"):
        with pytest.raises(InputError, match="no flow yet; run the model first"):
            getattr(problem().model.flow, write)(tmp_path / "flow.vtm")


def test_flow_goes_on_from_saved_states(flown, tmp_path):
    flown.model.flow.save_states(tmp_path / "states.h5")
    again = run(problem(restart=tmp_path / "states.h5"), alpha=3.0, Mach_number=0.4)
    assert n_products(again) == 0
    np.testing.assert_array_equal(again.get_val("states"), flown.get_val("states"))
    later = problem()
    later.model.flow.load_states(tmp_path / "states.h5")
    run(later, alpha=3.0, Mach_number=0.4)
    assert n_products(later) == 0


def test_trimmed_flow_goes_on_from_saved_states_and_their_angle(flown, tmp_path):
    flown.model.flow.save_states(tmp_path / "states.h5")
    lift = flown.get_val("CL").item()
    again = run(problem(restart=tmp_path / "states.h5", trim=True), CL_target=lift, Mach_number=0.4)
    assert again.get_val("alpha").item() == pytest.approx(3.0, abs=1e-6)
    assert n_products(again) < 20


@pytest.mark.parametrize(("factor", "gain"), [(2.0, 1.1), (1.5, 1.3)])  # from 1,024 cells there is little to know
def test_another_member_of_the_family_starts_from_the_states(flown, factor, gain, tmp_path):
    flown.model.flow.save_states(tmp_path / "states.h5")
    finer = wing().member(factor)
    cold = problem(finer)
    warm = problem(finer, restart=tmp_path / "states.h5")
    warm.final_setup()
    states = warm.get_val("states").reshape(-1, 5)
    assert flown.get_val("states").min() <= states.min() <= states.max() <= flown.get_val("states").max()
    run(cold, alpha=3.0, Mach_number=0.4)
    run(warm, alpha=3.0, Mach_number=0.4)
    assert n_products(warm) <= gain * n_products(cold)
    assert warm.model.flow.state.solution.history[0].residual != 1.0
    np.testing.assert_allclose(warm.get_val("CL"), cold.get_val("CL"), rtol=1e-8)


def test_files_that_cannot_be_used_are_refused_in_one_line(flown, tmp_path):
    path = tmp_path / "states.h5"
    flown.model.flow.save_states(path)
    whole = path.read_bytes()

    def refused(words, model=None):
        with pytest.raises(InputError, match=words) as error:
            problem(model, restart=path)
        assert "\n" not in str(error.value)

    refused("no member of the family", fit_grid(infinite_wing_grid(naca_section(0.12), (9, 7))))
    path.write_bytes(whole[: len(whole) // 2])
    refused("the states are damaged; run the flow without them")
    path.write_bytes(b"half a file")
    refused("is no file of states")
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file["states"][3, 2] += 1e-3
    refused("the states are damaged")
    wing().save(path)
    refused("is an HDF5 file, but no file of states")
    path.unlink()
    refused("there is no such file; save states by save_states")


def test_a_flow_shows_what_it_is_in_few_words(flown):
    assert repr(wing()).startswith("FittedModel(12 blocks, 1,500 nodes, 177 control points, RMS ")
    options = {name: value for name, value in flown.model.flow.options.items() if name != "model_in_records"}  # a path
    assert all(len(repr(value)) < 100 for value in options.values())
    assert all(desc["desc"] for _, desc in flown.model.list_outputs(desc=True, out_stream=None))


def put(states, row, column, value):
    """States with another number in a place."""
    changed = states.copy()
    changed[row, column] = value
    return changed


@pytest.mark.parametrize(
    ("change", "document", "words"),
    [
        (lambda states: put(states, 6, 2, np.nan), {}, r"the state of cell 7 is .*nan.*, no gas of positive density"),
        (lambda states: put(states, 3, 0, -1.0), {}, r"the state of cell 4 is \[-1\.0"),
        (lambda states: put(states, 0, 4, 0.0), {}, "the state of cell 1 is .*, no gas"),
        (lambda states: states + 0j, {}, r"the states are complex128 of shape \(768, 5\), no reals"),
        (lambda states: states.astype("S8"), {}, r"the states are \|S8 of shape"),
        (lambda states: states.astype(int), {}, "the states are int64 of shape"),
        (lambda states: states[:-1], {}, r"no reals of shape \(768, 5\)"),
        (np.copy, {"alpha": "3"}, "the states have alpha '3', which is no number"),
        (np.copy, {"alpha": float("nan")}, "the states have alpha nan"),
        (np.copy, {"Mach_number": None}, "the states have Mach number None"),
        (np.copy, {"residual": [1.0]}, r"the states have residual \[1\.0\]"),
        (np.copy, {"shapes": [[5, 5]]}, "have no three numbers of nodes of two and more"),
        (np.copy, {"shapes": [[1, 5, 5]]}, "have no three numbers of nodes of two and more"),
        (np.copy, {"shapes": [["5", 5, 5]]}, "have no three numbers of nodes of two and more"),
        (np.copy, {"shapes": 7}, "the states are damaged"),
    ],
)
def test_states_of_no_gas_are_refused_under_a_right_checksum(flown, tmp_path, change, document, words):
    path = tmp_path / "states.h5"
    flown.model.flow.save_states(path)
    with h5py.File(path, "r+") as file:
        states = change(file["states"][()])
        text = json.dumps(json.loads(file["document"][()].tobytes()) | document).encode()
        del file["states"], file["document"]
        file["states"], file["document"] = states, np.frombuffer(text, np.uint8)
        file.attrs["checksum"] = checksum_of(text, {"states": states})
    with pytest.raises(InputError, match=words) as error:
        problem(restart=path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_states_that_claim_more_than_their_file_holds_are_refused_unread(flown, tmp_path):
    path = tmp_path / "states.h5"
    flown.model.flow.save_states(path)
    with h5py.File(path, "r+") as file:
        del file["states"]
        file.create_dataset("states", (2**33, 5), np.float64, compression="gzip", chunks=(1024, 5))  # 320 GiB of zeros
    with pytest.raises(InputError, match="the states are damaged"):
        problem(restart=path)
