"""Files of curved hexahedra: node orders of the formats, and what independent readers make of the files."""

import sys

import h5py
import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid, read_grid, write_grid
from bspline_mdao.files import write_curved_grid
from bspline_mdao.generators import ball_grid
from bspline_mdao.grids.io.cgns_elements import read_cgns_elements
from bspline_mdao.grids.io.element_order import cgns_order, gmsh_order
from bspline_mdao.splines import curved_grid

DEGREES = [1, 2, 3, 4]
CGNS_TYPES = {1: (17, 7), 2: (19, 9), 3: (39, 28), 4: (56, 44)}
GMSH_TYPES = {1: (5, 3), 2: (12, 10), 3: (92, 36), 4: (93, 37)}


@pytest.fixture(scope="module")
def ball():
    return fit_grid(ball_grid((5, 4, 5, 4), far=3.0), keep_residual=False)


@pytest.fixture(scope="module")
def gmsh():
    """Gmsh's own reader; its wheel needs libraries of the system, so that it is no part of the test environment."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        pytest.skip(f"gmsh, the independent reader, is not there: {error}")
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield gmsh
    gmsh.finalize()


def lattice(order, degree, n_dimensions):
    return np.stack(np.unravel_index(order, (degree + 1,) * n_dimensions), axis=1)


@pytest.mark.parametrize("order", [cgns_order, gmsh_order])
@pytest.mark.parametrize("n_dimensions", [2, 3])
@pytest.mark.parametrize("degree", DEGREES)
def test_every_node_is_listed_once(order, n_dimensions, degree):
    np.testing.assert_array_equal(np.sort(order(degree, n_dimensions)), np.arange((degree + 1) ** n_dimensions))


def test_nodes_of_cgns_are_where_the_standard_has_them():
    """Figures of SIDS 3.3.3: node numbers from 1 and their places, by edges, faces (5 lies on x = 0) and inside."""
    places = {
        2: {9: (1, 0, 0), 13: (0, 0, 1), 20: (0, 1, 2), 21: (1, 1, 0), 22: (1, 0, 1), 25: (0, 1, 1), 27: (1, 1, 1)},
        3: {13: (2, 3, 0), 16: (0, 1, 0), 32: (0, 1, 3), 35: (2, 2, 0), 38: (2, 0, 1), 49: (0, 2, 1), 50: (0, 1, 1)}
        | {57: (1, 1, 1), 59: (2, 2, 1), 60: (1, 2, 1), 61: (1, 1, 2)},
        4: {9: (1, 0, 0), 20: (0, 1, 0), 45: (1, 1, 0), 53: (2, 2, 0), 81: (0, 3, 1), 83: (0, 1, 1), 89: (0, 2, 2)}
        | {99: (1, 1, 1), 100: (2, 1, 1), 107: (2, 2, 1), 116: (2, 2, 2), 125: (2, 2, 3)},
    }
    for degree, expected in places.items():
        found = lattice(cgns_order(degree), degree, 3)
        assert {number: tuple(found[number - 1].tolist()) for number in expected} == expected


def test_orders_of_gmsh_are_its_own(gmsh):
    for degree, types in GMSH_TYPES.items():
        for kind, n in zip(types, (3, 2)):
            places = np.reshape(gmsh.model.mesh.getElementProperties(kind)[4], (-1, n))
            np.testing.assert_allclose(lattice(gmsh_order(degree, n), degree, n), (places + 1) / 2 * degree)


@pytest.mark.parametrize("suffix", ["cgns", "msh"])
@pytest.mark.parametrize("degree", DEGREES)
def test_an_independent_reader_finds_the_same_valid_elements(ball, gmsh, tmp_path, degree, suffix):
    """Volumes by Gmsh's own shape functions are ours only if each node is where its format wants it."""
    grid = curved_grid(ball, degree, 0.5)
    write_curved_grid(tmp_path / f"ball.{suffix}", grid)
    gmsh.clear()
    gmsh.open(str(tmp_path / f"ball.{suffix}"))
    kinds, tags, _ = gmsh.model.mesh.getElements(3)
    assert list(kinds) == [GMSH_TYPES[degree][0]]
    volumes = gmsh.model.mesh.getElementQualities(tags[0], "volume")
    np.testing.assert_allclose(volumes, grid.volumes(), rtol=1e-6 if degree == 4 else 1e-11)
    if degree < 4:  # which takes Gmsh a second an element
        assert (gmsh.model.mesh.getElementQualities(tags[0], "minDetJac") > 0).all()
    faces = {}
    for entity in gmsh.model.getEntities(2):
        groups = gmsh.model.getPhysicalGroupsForEntity(*entity)
        name = gmsh.model.getPhysicalName(2, groups[0]) if len(groups) else gmsh.model.getEntityName(*entity)
        (kind,), (numbers,), _ = gmsh.model.mesh.getElements(*entity)
        assert kind == GMSH_TYPES[degree][1]
        faces[name] = len(numbers)
    assert faces == {patch.name: len(patch.faces) for patch in grid.patches}


@pytest.mark.parametrize("degree", DEGREES)
def test_cgns_sections_and_conditions_are_those_of_the_patches(ball, tmp_path, degree):
    grid = curved_grid(ball, degree)
    write_curved_grid(tmp_path / "ball.cgns", grid)
    with h5py.File(tmp_path / "ball.cgns") as file:
        zone, last = file["Base/Zone"], len(grid.elements)
        assert zone[" data"][:, 0].tolist() == [len(grid.nodes), last, 0]
        assert zone["Hexahedra/ data"][0] == CGNS_TYPES[degree][0]
        connectivity = zone["Hexahedra/ElementConnectivity/ data"][()].reshape(last, -1) - 1
        np.testing.assert_array_equal(connectivity[:, np.argsort(cgns_order(degree))], grid.elements.reshape(last, -1))
        for patch in grid.patches:
            assert zone[f"{patch.name}/ data"][0] == CGNS_TYPES[degree][1]
            ends = zone[f"{patch.name}/ElementRange/ data"][()].tolist()
            assert ends == [last + 1, last + len(patch.faces)]
            assert zone[f"ZoneBC/{patch.name}/PointRange/ data"][:, 0].tolist() == ends
            assert "FamilyBC" in file[f"Base/{patch.name}"]
            last = ends[1]


@pytest.mark.parametrize("degree", DEGREES)
def test_meshio_reads_what_was_written_for_gmsh(ball, tmp_path, degree):
    meshio = pytest.importorskip("meshio")
    grid = curved_grid(ball, degree)
    write_curved_grid(tmp_path / "ball.msh", grid)
    mesh = meshio.read(tmp_path / "ball.msh")
    assert len(mesh.points) == len(grid.nodes)
    order = np.argsort(gmsh_order(degree, 2))
    assert {name: int(dim) for name, (_, dim) in mesh.field_data.items()} == {"fluid": 3} | {
        patch.name: 2 for patch in grid.patches
    }
    for number, patch in enumerate(grid.patches, start=1):
        faces = mesh.cells[number].data[:, order].reshape(patch.faces.shape)
        np.testing.assert_array_equal(mesh.points[faces], grid.nodes[patch.faces])


@pytest.mark.parametrize("degree", DEGREES)
def test_elements_of_cgns_are_read_as_they_were_written(ball, tmp_path, degree):
    grid = curved_grid(ball, degree)
    write_curved_grid(tmp_path / "ball.cgns", grid)
    found = read_cgns_elements(tmp_path / "ball.cgns")
    assert (found.degree, found.patches) == (degree, ())
    np.testing.assert_array_equal(found.nodes, grid.nodes)
    np.testing.assert_array_equal(found.elements, grid.elements)
    np.testing.assert_array_equal(found.worst_jacobians(), grid.worst_jacobians())
    np.testing.assert_array_equal(found.places[:, 1], np.arange(len(grid.elements)))


def test_what_has_no_curved_elements_is_told_from_damage(ball, tmp_path):
    path = tmp_path / "ball.cgns"
    write_grid(path, ball_grid((5, 4, 5, 4), far=3.0))
    assert read_cgns_elements(path) is None
    for place, replacement, is_damage in (
        ("Base/Zone/Hexahedra/ data", np.array([22, 0], np.int32), False),
        ("Base/Zone/ZoneType/ data", np.frombuffer(b"Structured", np.int8), False),
        ("Base/Zone/Hexahedra/ElementConnectivity/ data", np.full(54, 10**6), True),
        ("Base/Zone/Hexahedra/ElementConnectivity/ data", np.ones(53, np.int32), True),
    ):
        write_curved_grid(path, curved_grid(ball, 2))
        with h5py.File(path, "r+") as file:
            del file[place]
            file[place] = replacement
        if is_damage:
            with pytest.raises(InputError, match=r"ball.cgns: .*; write it again"):
                read_cgns_elements(path)
        else:
            assert read_cgns_elements(path) is None


@pytest.mark.parametrize("degree", DEGREES)
def test_curved_cgns_is_named_where_a_structured_grid_is_read(ball, tmp_path, degree):
    grid = curved_grid(ball, degree)
    write_curved_grid(tmp_path / "ball.cgns", grid)
    curved = f" of degree {degree}, curved as 'refine --degree {degree}' writes them" if degree > 1 else ""
    what = f"ball.cgns: zone 'Zone' is not structured, it is a mesh of {len(grid.elements):,} hexahedra{curved}; give"
    with pytest.raises(
        InputError, match=rf"{what} a grid of structured blocks; 'bspline-mdao ride MODEL.h5 .*ball.cgns'"
    ):
        read_grid(tmp_path / "ball.cgns")


def test_a_name_without_a_format_is_refused(ball, tmp_path):
    with pytest.raises(InputError, match=r"curved elements are written as .cgns or .msh \(Gmsh\); name such a file"):
        write_curved_grid(tmp_path / "ball.xyz", curved_grid(ball, 2))


def test_without_meshio_the_way_out_is_named(ball, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(InputError, match=r'need meshio: pip install "bspline_mdao\[gmsh\]", or write CGNS'):
        write_curved_grid(tmp_path / "ball.msh", curved_grid(ball, 2))
    assert not list(tmp_path.iterdir())
