"""Families and bases of CGNS files, and names of patches in new ones."""

import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from grid_cases import assert_same_grid, smooth_grid

from bspline_mdao.errors import InputError
from bspline_mdao.grids.io.cgns import read_cgns, write_cgns
from bspline_mdao.grids.io.cgns_nodes import add_node, set_attributes
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Grid, Patch
from bspline_mdao.grids.topology.index_space import Window


def nested_families(path, families, conditions):
    """Write two blocks whose conditions, by (block, face), have families, and a tree of families with their types."""
    write_cgns(path, smooth_grid(((4, 5, 6), (6, 4, 5))))
    with h5py.File(path, "a") as file:
        for where, bc_type in families.items():
            family = add_node(file[f"Base/{where}".rpartition("/")[0]], where.rpartition("/")[2], "Family_t")
            if bc_type:
                add_node(family, "FamilyBC", "FamilyBC_t", bc_type)
        for number, (name, bc_type, names) in enumerate(conditions):
            zone = file[f"Base/block {number // 6 + 1}"]
            zone_bc = zone["ZoneBC"] if "ZoneBC" in zone else add_node(zone, "ZoneBC", "ZoneBC_t")
            condition = add_node(zone_bc, name, "BC_t", bc_type)
            window = Window.whole(0, tuple(zone[" data"][0])).face(number % 6)
            add_node(condition, "PointRange", "IndexRange_t", np.array([window.lo, window.hi], np.int32) + 1)
            for n, family in enumerate(names):
                label = "AdditionalFamilyName_t" if n else "FamilyName_t"
                add_node(condition, f"FamilyName{n}", label, family)
    return path


def test_families_in_families_are_known_by_their_paths_and_are_of_the_kind_around_them(tmp_path):
    families = {
        **{"wing": "BCWallViscous", "wing/upper": "", "wing/lower": "BCWallInviscid", "wing/lower/tip": ""},
        **{"planes": "", "planes/upper": "BCSymmetryPlane", "rest": "BCFarfield"},
    }
    conditions = [
        ("a", "FamilySpecified", ["wing/upper"]),
        ("b", "FamilySpecified", ["/Base/wing/lower/tip"]),
        ("c", "FamilySpecified", ["planes/upper"]),
        ("d", "FamilySpecified", ["Base/rest"]),
        ("e", "BCInflow", ["wing/upper"]),  # says for itself what it is
        ("f", "FamilySpecified", ["gone/symm"]),
    ]
    read = read_cgns(nested_families(tmp_path / "grid.cgns", families, conditions))
    assert {(patch.name, patch.kind) for patch in read.patches} == {
        ("wing/upper", "wall"),
        ("wing/upper (farfield)", "farfield"),
        ("wing/lower/tip", "wall"),
        ("planes/upper", "symmetry"),
        ("rest", "farfield"),
        ("gone/symm", "other"),
    }
    assert any("'wing/upper' has conditions of several kinds" in line for line in read.dialect.ignored)


def test_further_families_say_what_the_first_one_does_not_and_are_told_of(tmp_path):
    families = {"part 7": "", "skin": "BCWall", "zones": "UserDefined"}
    conditions = [("a", "FamilySpecified", ["part 7", "zones", "skin"]), ("b", "BCFarfield", ["zones"])]
    read = read_cgns(nested_families(tmp_path / "grid.cgns", families, conditions))
    assert [(patch.name, patch.kind) for patch in read.patches] == [("part 7", "wall"), ("zones", "farfield")]
    (said,) = (line for line in read.dialect.ignored if "further families" in line)
    assert "skin, zones" in said


def test_families_that_go_in_a_circle_are_refused(tmp_path):
    path = nested_families(tmp_path / "grid.cgns", {"a": "BCWall"}, [("x", "FamilySpecified", ["a"])])
    with h5py.File(path, "a") as file:
        inner = add_node(file["Base/a"], "a", "Family_t")
        set_attributes(inner, "a", "Family_t", "LK")
        inner[" link"] = h5py.SoftLink("/Base/a")
    with pytest.raises(InputError, match="families at a/a/a"):
        read_cgns(path)


def two_bases(path, dimensions):
    """Write a file with two bases that have a zone of the same name."""
    grid = smooth_grid(((4, 5, 6), (6, 4, 5)))
    for number, block in enumerate(grid.blocks):
        part = replace(block, name="zone", nodes=block.nodes[..., : (6 if dimensions[number] == 3 else 1), :])
        write_cgns(path.with_name(f"{number}.cgns"), Grid((part,)))
    shutil.copy(path.with_name("0.cgns"), path)
    with h5py.File(path.with_name("1.cgns")) as other, h5py.File(path, "a") as file:
        other.copy("Base", file, "Other")
        file["Other"].attrs.modify("name", np.bytes_("Other"))
    return grid


def test_two_bases_of_the_same_dimensions_are_both_read(tmp_path):
    grid = two_bases(tmp_path / "grid.cgns", (3, 3))
    read = read_cgns(tmp_path / "grid.cgns")
    assert [block.name for block in read.blocks] == ["Base/zone", "Other/zone"]
    assert_same_grid(read, grid)
    assert read.dialect.ignored == ()
    moved = replace(read, blocks=tuple(replace(block, nodes=2.0 * block.nodes) for block in read.blocks))
    write_cgns(tmp_path / "again.cgns", moved)
    assert_same_grid(read_cgns(tmp_path / "again.cgns"), moved)


def test_a_base_of_fewer_dimensions_is_not_left_out_in_silence(tmp_path):
    two_bases(tmp_path / "grid.cgns", (2, 3))
    read = read_cgns(tmp_path / "grid.cgns")
    assert [block.name for block in read.blocks] == ["zone"]
    (said,) = read.dialect.ignored
    assert said.startswith("base 'Base' (1 zone of 2-dimensional cells) is not read")
    assert any("base 'Base'" in line for line in find_topology(read).warnings)


def test_names_that_are_none_for_nodes_come_back_from_a_new_file(tmp_path):
    names = ["wing/upper", "wing/lower", "Flügel oben", "x" * 40 + "a", "x" * 40 + "b", "Tür"]
    grid = smooth_grid(((4, 5, 6),))
    whole = Window.whole(0, (4, 5, 6))
    kinds = ["wall", "wall", "wall", "symmetry", "farfield", "other"]
    patches = tuple(Patch(name, kind, (whole.face(n),)) for n, (name, kind) in enumerate(zip(names, kinds)))
    write_cgns(tmp_path / "grid.cgns", replace(grid, patches=patches))
    assert read_cgns(tmp_path / "grid.cgns").patches == patches
