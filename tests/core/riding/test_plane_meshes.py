"""Meshes of two dimensions ride along with sections, as one layer of cells between their planes."""

import h5py
import numpy as np
import openmdao.api as om
import pytest
from riding_cases import add_elements, model, plane_mesh, plane_su2_text, section, write_plane_cgns

from bspline_mdao import InputError, MovementError, Ride
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.files import read_mesh
from bspline_mdao.meshes import EmbeddedMesh, SectionSpan, section_span
from bspline_mdao.movers import LinearElasticity, moving_mesh
from bspline_mdao.testing import central_difference


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "section.su2"
    path.write_text(plane_su2_text())
    return path


def moved(text):
    """Control points of the section after a deformation."""
    mesh, initial = moving_mesh(section()), section().control_points
    surface = parse_deformation([text], section(), mesh).apply(initial[mesh.surface_ids])
    return LinearElasticity(mesh, n_increments=1).move(initial, surface).points


def test_the_planes_are_those_of_symmetry_and_a_wing_has_none():
    span = section_span(section())
    assert (span.axis, span.in_plane, span.low, span.high) == (2, (0, 1), 0.0, pytest.approx(1.0, abs=1e-14))
    assert section_span(model()) is None


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_mesh_is_one_layer_of_cells_between_any_two_planes(file, axis):
    span = SectionSpan(axis, -0.5, 1.5)
    mesh, (points, triangles, quads, lines) = read_mesh(file, span).mesh, plane_mesh()
    n = len(points)
    assert {kind: len(cells) for kind, cells in mesh.cells.items()} == {
        "wedge": len(triangles),
        "hexahedron": len(quads),
    }
    for half, end in ((mesh.points[:n], -0.5), (mesh.points[n:], 1.5)):
        np.testing.assert_array_equal(half[:, span.in_plane], points)
        assert (half[:, axis] == end).all()
    assert not mesh.quality().is_inverted.any()
    x, y = (points[triangles][:, [1, 2]] - points[triangles][:, [0]]).swapaxes(0, 1)
    areas = 0.5 * np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0])
    np.testing.assert_allclose(mesh.quality().volumes[: len(triangles)], 2.0 * areas, rtol=1e-12)
    assert len(mesh.into_fluid(mesh.markers["airfoil"])) == len(lines)


def test_by_itself_the_layer_is_one_unit_deep_from_the_plane_of_the_file(file, tmp_path):
    meshio = pytest.importorskip("meshio")
    points, triangles, quads, _ = plane_mesh()
    alone, between = read_mesh(file).mesh, read_mesh(file, SectionSpan(2, 0.0, 1.0)).mesh
    np.testing.assert_array_equal(alone.points, between.points)
    for axis, level in ((0, 7.0), (1, -3.0), (2, 0.5)):
        nodes = np.insert(points, axis, level, axis=1)
        nodes[1:, axis] += 1e-15  # as a plane that was turned
        meshio.write_points_cells(tmp_path / "plane.vtu", nodes, [("triangle", triangles), ("quad", quads)])
        read = read_mesh(tmp_path / "plane.vtu")
        low, high = np.split(read.mesh.points, 2)
        assert np.abs(low - nodes).max() < 2e-15
        np.testing.assert_array_equal(high - low, np.broadcast_to(np.eye(3)[axis], low.shape))
        assert not read.mesh.quality().is_inverted.any()
        read.write(tmp_path / "moved.vtu", read.mesh.points * 2.0)
        written = meshio.read(tmp_path / "moved.vtu").points
        np.testing.assert_array_equal(np.delete(written, axis, axis=1), 2.0 * points)
        np.testing.assert_array_equal(written[:, axis], nodes[:, axis])


def test_parts_that_go_round_the_other_way_are_turned_and_folded_cells_stay_folded(tmp_path):
    meshio = pytest.importorskip("meshio")
    points = np.array([[x, y, 0.0] for y in range(4) for x in range(7)], dtype=float)
    cells = np.array([row for k in range(20) if k % 7 < 6 for row in ([k, k + 1, k + 8], [k, k + 8, k + 7])])
    cells = cells[np.random.default_rng(1).permutation(len(cells))]
    is_right = points[cells].mean(axis=1)[:, 0] > 2.0
    cells[is_right] = cells[is_right, ::-1]
    points[8] = [2.2, 1.2, 0.0]  # out of its six cells
    x, y = (points[cells][:, [1, 2]] - points[cells][:, [0]])[..., :2].swapaxes(0, 1)
    is_negative = (x[:, 0] * y[:, 1] < x[:, 1] * y[:, 0]) != is_right
    meshio.write_points_cells(tmp_path / "parts.vtu", points, [("triangle", cells)])
    np.testing.assert_array_equal(read_mesh(tmp_path / "parts.vtu").mesh.quality().is_inverted, is_negative)
    assert 0 < is_negative.sum() < 7


def test_a_mesh_about_a_section_moves_alike_in_both_planes_and_none_of_its_cells_folds(file):
    found = read_mesh(file, section_span(section()))
    riding = EmbeddedMesh.of(section(), found.mesh)
    assert riding.walls.faces.names == ("airfoil",)
    state = riding.at(moved("pitch=5deg"))
    low, high = np.split(state.nodes, 2)
    assert np.abs(low[:, :2] - high[:, :2]).max() < 1e-12 < 0.02 < np.abs(low[:, :2] - plane_mesh()[0]).max()
    assert not found.mesh.quality(state.nodes).is_inverted.any()
    found.write(file.with_name("moved.su2"), state.nodes)
    old, new = (path.read_text().split("\n") for path in (file, file.with_name("moved.su2")))
    first = old.index(f"NPOIN= {len(low)}") + 1
    assert [(*old[:first], *old[first + len(low) :])] == [(*new[:first], *new[first + len(low) :])]
    back = read_mesh(file.with_name("moved.su2"), section_span(section())).mesh.points
    np.testing.assert_array_equal(back[: len(low), :2], low[:, :2])


def test_the_component_takes_it_along_with_exact_derivatives(file):
    found, rng = read_mesh(file, section_span(section())), np.random.default_rng(3)
    problem = om.Problem(reports=None)
    ride = problem.model.add_subsystem("ride", Ride(model=section(), mesh=found.mesh, asked=True), promotes=["*"])
    problem.setup(mode="rev")
    at, along = {"control_points": moved("pitch=5deg").ravel(), "wall": found.mesh.points[ride.wall_nodes].ravel()}, {}
    for name, value in at.items():
        along[name] = rng.standard_normal(value.size)
        problem.set_val(name, value)
    problem.run_model()
    low, high = np.split(problem.get_val("mesh").reshape(-1, 3), 2)
    assert np.abs(low[:, :2] - high[:, :2]).max() < 1e-12
    seed = {"mesh": rng.standard_normal(3 * found.mesh.n_points)}
    forward, reverse = (
        problem.compute_jacvec_product(["mesh"], list(at), mode, vectors)
        for mode, vectors in (("fwd", along), ("rev", seed))
    )
    products = forward["mesh"] @ seed["mesh"], sum(reverse[name] @ along[name] for name in at)
    assert abs(products[0] - products[1]) < 1e-12 * np.linalg.norm(forward["mesh"]) * np.linalg.norm(seed["mesh"])

    def off(step):
        for name, value in at.items():
            problem.set_val(name, value + step * along[name])
        problem.run_model()
        return problem.get_val("mesh").copy()

    exact = central_difference(off, 1e-5, levels=3)
    assert np.abs(forward["mesh"] - exact).max() < 1e-8 * np.abs(exact).max()


def test_a_body_of_another_shape_is_no_wall(file):
    points = plane_mesh()[0]
    thicker = points[:, 1] * (1.0 + 1.5 * np.exp(-np.hypot(*points.T)))
    lines = file.read_text().split("\n")
    first = next(n for n, line in enumerate(lines) if line.startswith("NPOIN")) + 1
    lines[first : first + len(points)] = [
        f"{x!r} {y!r} {n}" for n, (x, y) in enumerate(zip(points[:, 0].tolist(), thicker.tolist()))
    ]
    file.write_text("\n".join(lines))
    other = read_mesh(file, section_span(section())).mesh
    assert EmbeddedMesh.of(section(), other).walls is None
    assert EmbeddedMesh.of(section(), other, walls=("airfoil",)).walls.faces.names == ("airfoil",)


def test_parameters_in_planes_stay_where_they_were_found(file):
    riding = EmbeddedMesh.of(section(), read_mesh(file, section_span(section())).mesh)
    missed = np.abs(riding.evaluator.forward(section().control_points) - riding.mesh.points)
    assert np.quantile(missed, 0.99) < 1e-12  # but for nodes of the wall, inside the body by the error of the fit


def test_gmsh_and_vtk_meshes_in_any_plane_ride_as_well(tmp_path):
    meshio = pytest.importorskip("meshio")
    points, triangles, quads, lines = plane_mesh()
    for name, axes in (("plane.msh", [0, 1]), ("plane.vtu", [0, 2])):
        nodes = np.zeros((len(points), 3))
        nodes[:, axes] = points
        cells, data = [("triangle", triangles), ("quad", quads)], {}
        if name.endswith("msh"):
            cells.append(("line", lines))
            data = {"gmsh:physical": [np.full(len(block), n, dtype=np.int32) for n, (_, block) in enumerate(cells, 1)]}
            data["gmsh:geometrical"] = data["gmsh:physical"]
        content = meshio.Mesh(nodes, cells, cell_data=data, field_data={"airfoil": np.array([3, 1])} if data else {})
        content.write(tmp_path / name, file_format="gmsh22" if data else "vtu")
        found = read_mesh(tmp_path / name, section_span(section()))
        assert list(found.mesh.markers) == (["airfoil"] if data else [])
        found.write(tmp_path / f"moved_{name}", found.mesh.points * [1.5, 2.0, 1.0])
        written = meshio.read(tmp_path / f"moved_{name}").points
        np.testing.assert_array_equal(written[:, axes], points * [1.5, 2.0])
        assert not np.delete(written, axes, axis=1).any()


@pytest.mark.parametrize(("axes", "n_axes"), [([0, 1], 2), ([0, 1], 3), ([0, 2], 3)])
def test_cgns_of_two_dimensions_is_the_same_layer_in_two_or_three_coordinates(file, tmp_path, axes, n_axes):
    span, path, moved_path = section_span(section()), tmp_path / "plane.cgns", tmp_path / "moved.cgns"
    write_plane_cgns(path, axes, n_axes)
    found, same = read_mesh(path, span), read_mesh(file, span).mesh
    np.testing.assert_array_equal(found.mesh.points, same.points)
    for kind in same.cells:
        np.testing.assert_array_equal(found.mesh.cells[kind], same.cells[kind])
    np.testing.assert_array_equal(found.mesh.markers["airfoil"], same.markers["airfoil"])
    found.write(moved_path, found.mesh.points)
    assert moved_path.read_bytes() == path.read_bytes()
    found.write(moved_path, found.mesh.points * [1.5, 2.0, 1.0])
    np.testing.assert_array_equal(read_mesh(moved_path, span).mesh.points, same.points * [1.5, 2.0, 1.0])


def test_cgns_of_gmsh_of_two_dimensions_is_read_and_written(tmp_path):
    gmsh, path = pytest.importorskip("gmsh"), tmp_path / "hole.cgns"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        disk, hole = (gmsh.model.occ.addDisk(0.0, 0.0, 0.0, *radii) for radii in ((4.0, 4.0), (1.0, 0.5)))
        gmsh.model.occ.cut([(2, disk)], [(2, hole)])
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
        _, elements, _ = gmsh.model.mesh.getElements(2)
    finally:
        gmsh.finalize()
    if not path.exists():
        pytest.skip("this gmsh writes no CGNS")
    found = read_mesh(path, SectionSpan(1, 0.0, 2.0))
    assert len(found.mesh.cells["wedge"]) == len(elements[0])
    volumes = found.mesh.quality().volumes
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(2.0 * np.pi * (16.0 - 0.5), rel=0.1)
    found.write(tmp_path / "moved.cgns", found.mesh.points * [2.0, 1.0, 1.0])
    moved = read_mesh(tmp_path / "moved.cgns", SectionSpan(1, 0.0, 2.0)).mesh
    assert moved.quality().volumes.sum() == pytest.approx(2.0 * volumes.sum(), rel=1e-12)


def test_what_cgns_of_two_dimensions_cannot_be_is_said(tmp_path):
    path, span = tmp_path / "plane.cgns", SectionSpan(2, 0.0, 1.0)
    write_plane_cgns(path, [0, 1], 2)
    for kind, message in ((22, "has polygons; of two dimensions"), (10, "has a tetra in a base of two dimensions")):
        write_plane_cgns(path, [0, 1], 2)
        with h5py.File(path, "r+", track_order=True) as content:
            add_elements(content["Base/zone"], "other", kind, (9001, 9001), [1, 2, 3, 4])
        with pytest.raises(InputError, match=f"zone 'zone', section 'other': {message}"):
            read_mesh(path, span)


def test_what_a_file_of_two_dimensions_cannot_hold_is_refused(file):
    with pytest.raises(InputError, match=r"section\.su2: is two-dimensional, and moves with a section only"):
        EmbeddedMesh.of(model(), read_mesh(file).mesh)
    with pytest.raises(InputError, match=r"section\.su2: .* not taken between the planes of the section"):
        EmbeddedMesh.of(section(), read_mesh(file, SectionSpan(2, 0.0, 2.0)).mesh)
    found = read_mesh(file, section_span(section()))
    sheared = found.mesh.points + np.where(found.mesh.points[:, 2:] > 0.0, [0.0, 1e-3, 0.0], 0.0)
    with pytest.raises(MovementError, match=r"node \d+ is 0\.001 m farther in one plane of the section"):
        found.write(file, sheared)
    assert file.read_text() == plane_su2_text()
    meshio = pytest.importorskip("meshio")
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.0, 1.0, 0.2]])
    meshio.write_points_cells(file.with_suffix(".vtu"), points, [("triangle", np.array([[0, 1, 2]]))])
    with pytest.raises(InputError, match="is a surface that is in no plane of two axes"):
        read_mesh(file.with_suffix(".vtu"), SectionSpan(2, 0.0, 1.0))
