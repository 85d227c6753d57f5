"""Damaged meshes and states: each is refused in one line, or read as another reader reads it; no crash, no waiting."""

import re
import shutil
import time
import tracemalloc
import warnings

import numpy as np
import pytest
from fuzz_cases import MUTATIONS_OF_LINES, N_MUTATIONS, mutate
from riding_cases import binary_folder, su2_text, write_boxes_cgns

from bspline_mdao import InputError
from bspline_mdao.files import read_mesh, write_polymesh
from bspline_mdao.flow.euler.states_file import StatesFile
from bspline_mdao.generators import brick_grid
from bspline_mdao.meshes import MixedMesh

pytestmark = pytest.mark.slow

N_OF_FORMAT = max(N_MUTATIONS, 100)
"""Mutations of each format, in all its kinds."""

SECONDS = 5.0
PEAK_BYTES = 200e6

TETRA = [[0, 1, 2, 8], [1, 2, 5, 9]]
HEXAHEDRA = [[0, 1, 2, 3, 4, 5, 6, 7], [4, 5, 6, 7, 10, 11, 8, 9]]
FACES = {"wing": [[0, 1, 2, 2], [0, 1, 5, 4]], "far": [[2, 3, 7, 6], [0, 2, 8, 8], [1, 2, 5, 5]]}


def small_mesh():
    """Two tetrahedra, two hexahedra, and two markers of triangles and quads."""
    points = np.random.default_rng(5).standard_normal((12, 3)).round(6)
    markers = {name: np.array(faces) for name, faces in FACES.items()}
    return MixedMesh(points, {"tetra": np.array(TETRA), "hexahedron": np.array(HEXAHEDRA)}, markers)


def content(mesh):
    """Nodes, cells and markers of a mesh, such that equal ones are alike."""
    parts = [tuple(map(tuple, mesh.points.tolist()))]
    parts.append({kind: corners.tolist() for kind, corners in mesh.cells.items() if len(corners)})
    parts.append({name: sorted(faces.tolist()) for name, faces in (mesh.markers or {}).items() if len(faces)})
    parts.append([part.tolist() for part in mesh.polyhedra or ()])
    return parts


def is_one_line(error, path):
    """Whether an error is one line about the file."""
    message = str(error)
    assert message.count("\n") == 0, message
    assert len(message) < 600
    assert str(path) in message
    return True


def check_mesh(path, original, other_reader):
    """Run one case; give whether it was read: then it is the original mesh, or what another reader makes of it."""
    try:
        read = read_mesh(path)
    except InputError as error:
        return not is_one_line(error, path)
    found = content(read.mesh)
    if found != original:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert found == content(other_reader(path))
    mesh = read.mesh
    if np.abs(mesh.points).max(initial=0.0) < 1e6:  # squares of areas stay finite
        mesh.quality()
        for faces in (mesh.markers or {"skin": mesh.skin}).values():
            mesh.into_fluid(faces)
        moved = path.parent / "moved" / path.name
        read.write(moved, 2.0 * mesh.points)  # at any precision the same digits
        np.testing.assert_array_equal(read_mesh(moved).mesh.points, 2.0 * mesh.points)
    return True


def check(files, path, n, seed, run, head=400):
    """Run mutations of one of some files; neither all nor none of them may be readable."""
    random, n_read = np.random.default_rng(seed), 0
    tracemalloc.start()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(n):
            file = files[random.integers(len(files))]
            whole = file.read_bytes()
            file.write_bytes(mutate(whole, random, MUTATIONS_OF_LINES, head))
            start = time.perf_counter()
            n_read += run(path)
            assert time.perf_counter() - start < SECONDS
            file.write_bytes(whole)
            shutil.rmtree(path.parent / "moved", ignore_errors=True)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < PEAK_BYTES
    assert 0 < n_read < n


def text_of(path):
    """Text of a file."""
    return path.read_bytes().decode(errors="backslashreplace")


def words_in(text):
    """Words of each line of a text but its comments."""
    return [line.split() for line in re.sub(r"%[^\n]*", "", text).split("\n") if line.split()]


def read_su2_plainly(path):
    """Read an SU2 mesh line by line."""
    lines = iter(words_in(re.sub(r"=[ \t]*", "= ", text_of(path))))
    points, cells, markers = [], {}, {}
    for line in lines:
        if line[0] == "NPOIN=":
            points = [[float(word) for word in next(lines)[:3]] for _ in range(int(line[1]))]
        elif line[0] == "NELEM=":
            kinds = {"10": ("tetra", 4), "12": ("hexahedron", 8), "13": ("wedge", 6), "14": ("pyramid", 5)}
            for _ in range(int(line[1])):
                kind, *ids = next(lines)
                name, n = kinds[kind]
                cells.setdefault(name, []).append([int(word) for word in ids[:n]])
        elif line[0] == "MARKER_TAG=":
            faces = markers.setdefault(line[1], [])
        elif line[0] == "MARKER_ELEMS=":
            for _ in range(int(line[1])):
                kind, *ids = next(lines)
                face = [int(word) for word in ids[: {"5": 3, "9": 4, "1": 1}[kind]]]
                faces += [] if kind == "1" else [(face + face[-1:])[:4]]
    cells = {name: np.array(cells[name]) for name in ("tetra", "hexahedron", "wedge", "pyramid") if name in cells}
    return MixedMesh(np.array(points), cells, {name: np.array(faces) for name, faces in markers.items() if faces})


def test_damaged_su2_is_refused_or_read_as_another_reader_does(tmp_path):
    path = tmp_path / "wing.su2"
    path.write_text(su2_text(small_mesh()))
    original = content(read_mesh(path).mesh)
    assert original == content(read_su2_plainly(path)) == content(small_mesh())
    check([path], path, N_OF_FORMAT, 11, lambda path: check_mesh(path, original, read_su2_plainly))


def read_with_meshio(path):
    """Read a mesh by meshio."""
    meshio, data = pytest.importorskip("meshio"), path.read_bytes()
    copy = path.with_name(f"copy{path.suffix}")
    data = re.sub(rb"<PointData>.*?</PointData>", b"", data, flags=re.S)  # what it refuses: fields that are damaged,
    data = re.sub(rb"(<VTKFile[^>]*version=\")[^\"]*", rb"\g<1>1.0", data)  # versions that it does not know,
    if found := re.search(rb"\$PhysicalNames.*?\$EndPhysicalNames", data, re.S):  # and names in Latin-1
        data = data.replace(found[0], found[0].decode(errors="backslashreplace").encode())
    copy.write_bytes(data)
    found = {".msh": meshio.gmsh, ".vtu": meshio.vtu}[path.suffix].read(copy)
    names = {int(number): name for name, (number, of) in found.field_data.items() if of == 2}
    cells, markers = {}, {}
    for block, ids in zip(found.cells, found.cell_data.get("gmsh:physical", [()] * len(found.cells))):
        if block.type in ("tetra", "hexahedron", "wedge", "pyramid"):
            cells.setdefault(block.type, []).extend(np.asarray(block.data).tolist())
        for face, number in zip(block.data.tolist(), ids):
            if number and block.type in ("triangle", "quad"):
                markers.setdefault(names.get(abs(number), str(abs(number))), []).append((face + face[-1:])[:4])
    cells = {kind: np.array(corners) for kind, corners in cells.items()}
    markers = {name: np.array(faces) for name, faces in markers.items()}
    return MixedMesh(np.asarray(found.points, dtype=float), cells, markers)


def write_with_meshio(path, **how):
    """Write the small mesh by meshio."""
    meshio, mesh = pytest.importorskip("meshio"), small_mesh()
    cells, numbers = [(kind, corners) for kind, corners in mesh.cells.items()], [np.full(2, 1), np.full(2, 1)]
    if path.suffix == ".vtu":
        return meshio.write(path, meshio.Mesh(mesh.points, cells, {"p": np.arange(12.0)}), **how)
    for number, faces in enumerate(mesh.markers.values(), start=2):
        is_triangle = faces[:, 2] == faces[:, 3]
        cells += [("triangle", faces[is_triangle, :3]), ("quad", faces[~is_triangle])]
        numbers += [np.full(is_triangle.sum(), number), np.full((~is_triangle).sum(), number)]
    entities = [np.full(len(part), entity) for entity, part in enumerate(numbers, start=1)]
    data = {"gmsh:physical": numbers, "gmsh:geometrical": entities}
    tags = (
        {"gmsh:dim_tags": np.repeat([(2, 3), (2, 4), (2, 5), (2, 6), (3, 1), (3, 2)], 2, axis=0)}
        if how["file_format"] == "gmsh"
        else {}
    )
    fields = {"wing": np.array([2, 2]), "far": np.array([3, 2])}
    return meshio.write(path, meshio.Mesh(mesh.points, cells, tags, data, fields), **how)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("form", ["gmsh", "gmsh22"])
def test_damaged_msh_is_refused_or_read_as_meshio_does(tmp_path, form, binary):
    path = tmp_path / "wing.msh"
    write_with_meshio(path, file_format=form, binary=binary)
    original = content(read_mesh(path).mesh)
    assert original == content(read_with_meshio(path)) == content(small_mesh())
    check([path], path, -(-N_OF_FORMAT // 4), 12, lambda path: check_mesh(path, original, read_with_meshio))


@pytest.mark.parametrize("how", [{"binary": False}, {"compression": None}, {"compression": "zlib"}], ids=str)
def test_damaged_vtu_is_refused_or_read_as_meshio_does(tmp_path, how):
    path = tmp_path / "wing.vtu"
    write_with_meshio(path, **how)
    original = content(read_mesh(path).mesh)
    assert original == content(read_with_meshio(path))
    check([path], path, -(-N_OF_FORMAT // 3), 13, lambda path: check_mesh(path, original, read_with_meshio))


def read_foam_plainly(folder):
    """Read a polyMesh in ASCII word by word."""
    lists, gone = {}, re.compile(r"\A\s*FoamFile\s*\{[^}]*\}")
    for name in ("points", "faces", "owner", "neighbour", "boundary"):
        text = re.sub(r"/\*.*?\*/|//[^\n]*", "", text_of(folder / name), flags=re.S)
        lists[name] = re.findall(r"[^\s()]+", gone.sub("", text))
    points = np.array(lists["points"][1:]).astype(float).reshape(int(lists["points"][0]), 3)
    owner, neighbour = ([int(word) for word in lists[name][1:]] for name in ("owner", "neighbour"))
    assert (len(owner), len(neighbour)) == (int(lists["owner"][0]), int(lists["neighbour"][0]))
    words, faces = iter(lists["faces"][1:]), []
    faces += [[int(next(words)) for _ in range(int(n))] for n in words]
    assert len(faces) == int(lists["faces"][0]) == len(owner)
    quads = [(face + face[-1:])[:4] for face in faces]
    seen = quads + [quad[::-1] for quad in quads[: len(neighbour)]]
    text, markers = " ".join(lists["boundary"]), {}
    for name, entries in re.findall(r"([^\s{};]+) *\{([^{}]*)\}", text):
        first, n = (int(re.search(rf"\b{key}\s+(\d+)", entries)[1]) for key in ("startFace", "nFaces"))
        markers[name] = np.array(quads[first : first + n], dtype=int).reshape(-1, 4)
    return MixedMesh(points, {}, markers, (np.array(seen), np.array(owner + neighbour)))


@pytest.mark.parametrize("is_binary", [False, True])
def test_damaged_polymesh_is_refused_or_read_as_another_reader_does(tmp_path, is_binary):
    folder = tmp_path / "polyMesh"
    write_polymesh(folder, brick_grid((3, 3, 3, 3)))
    original = content(read_mesh(folder).mesh)
    assert original == content(read_foam_plainly(folder))
    if is_binary:
        folder = binary_folder(folder, "LSB;label=32;scalar=64")

    def other_reader(path):
        if is_binary:  # any bytes are numbers, of which the mesh has as many
            shutil.rmtree(tmp_path / "ascii", ignore_errors=True)
            return read_mesh(path).mesh
        return read_foam_plainly(path)

    files = [folder / name for name in ("points", "faces", "owner", "neighbour", "boundary")]
    n = -(-N_OF_FORMAT // 2)
    check(files, folder, n, 14, lambda path: check_mesh(path, original, other_reader))


def test_damaged_cgns_mesh_is_refused_or_read(tmp_path):
    path = tmp_path / "boxes.cgns"
    write_boxes_cgns(path)
    original = content(read_mesh(path).mesh)

    def same(path):  # any bytes are numbers in HDF5 as well
        return read_mesh(path).mesh

    check([path], path, N_OF_FORMAT // 4, 16, lambda path: check_mesh(path, original, same), head=4000)


def test_damaged_states_are_refused_or_those_that_were_saved(tmp_path):
    random, path = np.random.default_rng(3), tmp_path / "states.h5"
    states = np.abs(random.standard_normal((2 * 3 * 4, 5))) + 0.1
    StatesFile(states, ((3, 4, 5),), 3.0, 0.4, 1e-10).save(path)

    def run(path):
        try:
            found = StatesFile.load(path)
        except InputError as error:
            return not is_one_line(error, path)
        np.testing.assert_array_equal(found.states, states)
        assert (found.shapes, found.alpha, found.mach, found.residual) == (((3, 4, 5),), 3.0, 0.4, 1e-10)
        return True

    check([path], path, N_OF_FORMAT, 15, run)
