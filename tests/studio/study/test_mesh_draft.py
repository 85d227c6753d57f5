"""Drafts of studies of meshes without structure: by the walls of the mesh, and nothing that cannot run."""

import numpy as np
import pytest
from mesh_cases import TETRAHEDRA, body_model, mesh_around_a_body, section_model
from riding_cases import joined
from study_cases import study_of

from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.meshes import LatticeSettings, MeshModel, MixedMesh
from bspline_mdao.studio.study.draft import study_draft
from bspline_mdao.studio.study.draft_body import MeshBody


@pytest.fixture
def drafted(tmp_path):
    """Draft a study of a model, and read it."""

    def draft(model):
        model.save(tmp_path / "mesh.h5")
        text = study_draft("mesh.h5", None, MeshBody(model))
        return study_of(tmp_path, text), text

    return draft


def wing_model(has_tip=False, shift=0.0):
    """A wing in tetrahedra on a plane of symmetry, whose outer part may be a wall of its own."""
    points, cells = joined(onera_m6_grid((5, 7, 5)))
    corners = cells[:, TETRAHEDRA].reshape(-1, 4)
    skin = MixedMesh(points, {"tetra": corners}).skin
    in_plane, is_far = (points[skin][..., 2] == 0.0).all(axis=1), np.abs(points[skin]).max(axis=(1, 2)) > 3.0
    is_tip = points[skin][..., 2].min(axis=1) > 1.1
    markers = {"symmetry": skin[in_plane], "far": skin[is_far & ~in_plane]}
    is_wall = ~in_plane & ~is_far
    markers |= {"wing": skin[is_wall & ~is_tip], "tip": skin[is_wall & is_tip]} if has_tip else {"wing": skin[is_wall]}
    kinds = {"wing": "wall", "symmetry": "symmetry", "far": "farfield"} | ({"tip": "wall"} if has_tip else {})
    return MeshModel.of(MixedMesh(points + [0.0, 0.0, shift], {"tetra": corners}, markers), kinds)


@pytest.mark.slow
def test_a_wing_on_a_plane_of_symmetry_gets_a_vortex_lattice_at_its_lift(drafted):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    study, text = drafted(wing_model(has_tip=True))
    assert (study.flow["kind"], study.objective["of"], study.grid["design"]) == ("lattice", "CD_induced", None)
    assert study.constraints["CL"]["equals"] == pytest.approx(0.19, abs=0.03)
    assert study.variables["twist"]["values"] == [2, 3]
    assert "volume_ks" in study.constraints
    assert "Euler flow needs a grid of blocks" in text
    assert '# design = ["wing", "tip"]' in text


@pytest.mark.slow
def test_a_wing_off_the_origin_gets_what_its_shape_has_alone(drafted):
    study, text = drafted(wing_model(shift=0.3))
    assert study.flow is None
    assert "the walls do not end on one plane of symmetry through the origin" in text
    assert (study.objective["of"], study.variables["shape"]["direction"]) == ("surface_area", "y")
    assert set(study.constraints) == {"volume", "planform_area", "volume_ks"}


def test_a_section_gets_points_that_keep_its_chord_and_its_plane(drafted):
    study, text = drafted(section_model())
    assert (study.flow, study.objective["of"]) == (None, "surface_area")
    shape = study.variables["shape"]
    assert (shape["n"], shape["where"], shape["direction"]) == ([6, 2, 2], "1:-1, 0, :", "z")
    assert shape["upper"] == 0.01
    assert set(study.constraints) == {"volume", "volume_ks"}
    assert "its area" in text


def test_a_body_that_is_no_wing_gets_points_of_a_box_around_it(drafted):
    study, text = drafted(body_model())
    assert (study.flow, study.variables["shape"]["kind"]) == (None, "lattice")
    assert set(study.constraints) == {"volume", "volume_ks"}
    assert "the walls are no wing" in text


def test_of_a_wing_beside_a_body_the_wing_is_designed_and_all_is_measured(drafted):
    """The lid of a block is flat, and taken for the wing."""
    mesh, kinds = mesh_around_a_body()
    faces = mesh.markers["body"]
    is_top = (mesh.points[faces][..., 2] > 0.25).all(axis=1)
    markers = {**mesh.markers, "body": faces[~is_top], "lid": faces[is_top]}
    model = MeshModel.of(MixedMesh(mesh.points, mesh.cells, markers), {**kinds, "lid": "wall"}, LatticeSettings(0.4))
    study, text = drafted(model)
    assert study.grid["design"] == ["lid"]
    assert study.measures["volume"]["patches"] == ["body", "lid"]
    assert study.measures["surface_area"]["patches"] is None
    assert study.variables["shape"]["where"] == "1:-1, 2:, :"
    assert "fixed: body" in text
