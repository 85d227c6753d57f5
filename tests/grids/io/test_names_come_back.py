"""Names, kinds and windows of patches go through fit, move, file and reader as they were, in every format."""

import re
from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import FittedModel, family_member, fit_grid, read_grid, write_grid
from bspline_mdao.files import read_mesh
from bspline_mdao.generators import ball_grid
from bspline_mdao.grids.io.cgns import CgnsDialect
from bspline_mdao.grids.io.patch_guess import draft_patches
from bspline_mdao.grids.io.patches import read_patches
from bspline_mdao.grids.topology.grid import Patch

NAMES = ["Flügel oben", "wing/upper", 'a "quoted" name', "x" * 40 + "a", "x" * 40 + "b", "BC_Symm 1", "tip's end"]


@pytest.fixture(scope="module")
def named_grid():
    """A ball whose patches, one for each window, have names of all sorts; kinds are not those of the names."""
    grid = ball_grid((4, 4, 4, 3), far=4.0)
    windows = [(patch.kind, window) for patch in grid.patches for window in patch.windows]
    names = NAMES + [f"patch {n}" for n in range(len(NAMES), len(windows))]
    return replace(grid, patches=tuple(Patch(name, kind, (window,)) for name, (kind, window) in zip(names, windows)))


@pytest.fixture(scope="module")
def moved(named_grid, tmp_path_factory):
    """The grid as a stored model regenerates it from moved control points."""
    file = tmp_path_factory.mktemp("model") / "ball.h5"
    fit_grid(named_grid).save(file)
    model = FittedModel.load(file)
    return model.regenerate(1.01 * model.control_points)


def as_sets(patches):
    return {patch.name: (patch.kind, set(patch.windows)) for patch in patches}


def test_a_model_and_its_family_keep_names(named_grid, moved):
    assert moved.patches == named_grid.patches
    fine = family_member(fit_grid(named_grid), 2.0)
    assert [(patch.name, patch.kind) for patch in fine.patches] == [(p.name, p.kind) for p in named_grid.patches]


@pytest.mark.slow
def test_cgns_from_elsewhere_and_from_cgns_keeps_names(named_grid, moved, tmp_path):
    write_grid(tmp_path / "new.cgns", moved)
    read = read_grid(tmp_path / "new.cgns")
    assert as_sets(read.patches) == as_sets(named_grid.patches)
    model = fit_grid(read)
    again = model.regenerate(1.01 * model.control_points)
    assert isinstance(again.dialect, CgnsDialect)
    write_grid(tmp_path / "copy.cgns", again)
    assert as_sets(read_grid(tmp_path / "copy.cgns").patches) == as_sets(named_grid.patches)
    fine = family_member(model, 2.0)  # a new file, of a grid that came from CGNS
    write_grid(tmp_path / "fine.cgns", fine)
    assert as_sets(read_grid(tmp_path / "fine.cgns").patches) == as_sets(fine.patches)


@pytest.mark.parametrize("name", ["ball.xyz", "ball.fmt.xz"])
def test_plot3d_with_a_patches_file_keeps_names(named_grid, moved, tmp_path, name):
    write_grid(tmp_path / name, moved)
    numbered = read_grid(tmp_path / name)  # PLOT3D has no names for blocks
    (tmp_path / "patches.toml").write_text(draft_patches(numbered, moved.patches), encoding="utf-8")
    read = read_patches(tmp_path / "patches.toml", numbered)
    assert as_sets(read.patches) == as_sets(named_grid.patches)


def test_openfoam_has_names_that_it_takes_and_their_types(named_grid, moved, tmp_path):
    write_grid(tmp_path / "polyMesh", moved)
    words = [re.sub(r"[^\x21-\x7e]|[\"'/;{}()$#]", "_", patch.name) for patch in named_grid.patches]
    markers = read_mesh(tmp_path / "polyMesh").mesh.markers
    assert [name for name in markers if name != "unassigned"] == words
    for patch, word in zip(named_grid.patches, words):
        sizes = [n - 1 for n in patch.windows[0].shape if n > 1]
        assert len(markers[word]) == np.prod(sizes)
        entry = re.search(
            rf"^ *{re.escape(word)}\s+{{\s*type (\w+);", (tmp_path / "polyMesh/boundary").read_text(), re.M
        )
        assert entry[1] == (patch.kind if patch.kind in ("wall", "symmetry") else "patch")


def test_paraview_and_tecplot_name_the_patches(named_grid, moved, tmp_path):
    write_grid(tmp_path / "ball.dat", moved)
    text = (tmp_path / "ball.dat").read_text(encoding="utf-8")
    assert len(re.findall("DATASETAUXDATA patch_", text)) == len(named_grid.patches)
    assert "x" * 40 + "b" in text
    write_grid(tmp_path / "ball.vtm", moved)
    block = (tmp_path / "ball" / "0001.vts").read_bytes()
    assert b'Name="patches"' in block
