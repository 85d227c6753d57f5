"""Files of SU2: what it writes is read in its format, what a user configured stays, and meshes are what it reads.

The excerpts have the form of files of SU2 8.0.0 (padded names in the history, restarts with ``PointID``), written by
``SU2_CFD/src/output/COutput.cpp`` and ``output/filewriter/CSU2FileWriter.cpp`` in su2code/SU2.
"""

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.errors import SolverError
from bspline_mdao.files import read_mesh
from bspline_mdao.flow.su2.config import EULER, Su2Config, listed
from bspline_mdao.flow.su2.frame import Su2Frame
from bspline_mdao.flow.su2.mesh_text import MeshToFly, Su2Mesh
from bspline_mdao.flow.su2.tables import NodeTable, last_of_history
from bspline_mdao.flow.su2.wall_pressures import WallPressures
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.meshes import MeshModel

HISTORY = """\
"Time_Iter","Outer_Iter","Inner_Iter",    "rms[Rho]"    ,       "CD"       ,       "CL"       ,       "CMz"
          0,           0,           0,      -1.770133351,      0.2343241561,      0.1275236512,      0.0311152342
          0,           0,           1,      -7.123456789, 0.001234567890123,      0.3265123413,     -0.0811152342
"""

ADJOINT = """\
"PointID","x","y","Adjoint_Density","Sensitivity_x","Sensitivity_y","Surface_Sensitivity"
2, 1.000000000000000e+00, 1.000000000000000e+00, -1.5e-01, 3.000000000000000e-02, -4.000000000000000e-02, 0.0e+00
0, 0.000000000000000e+00, 0.000000000000000e+00, -2.5e-01, 1.000000000000000e-02, -2.000000000000000e-02, 0.0e+00
1, 1.000000000000000e+00, 0.000000000000000e+00, -3.5e-01, 5.000000000000000e-02, -6.000000000000000e-02, 0.0e+00
"""

CONFIG = """\
% A section in the wind tunnel
SOLVER= RANS   % Spalart-Allmaras below
kind_turb_model= SA
MACH_NUMBER= 0.9
MARKER_HEATFLUX= ( airfoil, 0.0, \\
                   flap, 0.0 )
MARKER_FAR= ( far )
REF_AREA= 0.0
"""

SQUARE = """\
NDIME= 2
NELEM= 2
5 0 1 2 0
9 1 3 4 2 1
NPOIN= 5
0 0
1 0
0 1
2 0.1
1.5 1.25
NMARK= 2
MARKER_TAG= wall
MARKER_ELEMS= 2
3 0 1
3 1 3
MARKER_TAG= far
MARKER_ELEMS= 3
3 3 4
3 4 2
3 2 0
"""


def written(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    return path


def test_the_last_line_of_a_history_counts_whatever_pads_its_names(tmp_path):
    values = last_of_history(written(tmp_path, HISTORY))
    assert values["CD"] == 0.001234567890123
    assert values["CL"] == 0.3265123413
    assert values["CMz"] == -0.0811152342


def test_sensitivities_are_those_of_the_nodes_by_their_numbers(tmp_path):
    table = NodeTable.read(written(tmp_path, ADJOINT))
    np.testing.assert_array_equal(table.vectors("Sensitivity", 2, 3), [[0.01, -0.02], [0.05, -0.06], [0.03, -0.04]])
    with pytest.raises(SolverError, match=r"3 nodes, the mesh 4; it is of another run"):
        table.vectors("Sensitivity", 2, 4)
    with pytest.raises(SolverError, match="no column Sensitivity_z, only PointID"):
        table.vectors("Sensitivity", 3, 3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HISTORY.replace("0.3265123413", "         nan"), "CL is nan; the flow diverged"),
        (HISTORY.replace("0.3265123413", "  0.32.65123"), "is damaged"),
        (HISTORY.splitlines()[0] + "\n", "has no whole rows"),
        ("", "has no whole rows"),
    ],
)
def test_a_damaged_history_is_a_failure_of_the_solver(tmp_path, text, said):
    with pytest.raises(SolverError, match=said):
        last_of_history(written(tmp_path, text))
    with pytest.raises(SolverError, match="was not written"):
        last_of_history(tmp_path / "nothing.csv")


def test_a_configuration_stays_but_for_the_keys_that_are_set():
    config = Su2Config(CONFIG, "section.cfg")
    assert config.values["KIND_TURB_MODEL"] == "SA"
    assert listed(config.values["MARKER_HEATFLUX"]) == ["airfoil", "0.0", "flap", "0.0"]
    settings = {"MACH_NUMBER": "0.3", "REF_AREA": "0.0", "AOA": "2.0", "MARKER_HEATFLUX": "( airfoil, 0.0 )"}
    assert config.replaced_by(settings) == ["MACH_NUMBER", "MARKER_HEATFLUX"]
    text = config.with_settings(settings)
    assert Su2Config(text, "").values == {**config.values, **settings}
    assert "% replaced: MACH_NUMBER= 0.9" in text
    assert "% replaced:                    flap, 0.0 )" in text
    assert text.startswith("% A section in the wind tunnel\nSOLVER= RANS   % Spalart")


def test_conditions_of_a_configuration_stay_and_others_follow_from_kinds():
    kinds = {"wing": "wall", "tail": "wall", "mirror": "symmetry", "far": "farfield"}
    assert Su2Config(CONFIG, "").boundaries(kinds) == {}
    assert Su2Config(EULER, "").boundaries(kinds) == {
        "MARKER_EULER": "( wing, tail )",
        "MARKER_SYM": "( mirror )",
        "MARKER_FAR": "( far )",
    }
    assert Su2Config("SOLVER= RANS", "").boundaries(kinds)["MARKER_HEATFLUX"] == "( wing, 0.0, tail, 0.0 )"
    with pytest.raises(InputError, match="marker 'sides' is of kind periodic, for which SU2 has several conditions"):
        Su2Config(EULER, "").boundaries({"sides": "periodic"})


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("SOLVER= INC_EULER", r"SOLVER= INC_EULER; set one of EULER, NAVIER_STOKES, RANS"),
        ("SOLVER= EULER\nFIXED_CL_MODE= YES", "the angle of attack is an input here"),
        ("SOLVER= EULER\nTIME_DOMAIN= YES", "flows are steady here"),
        ("SOLVER= EULER\nMARKER_MONITORING= ( tail )", "has no 'wing', so that forces would lack that wall"),
        ("", "SOLVER= nothing"),
    ],
)
def test_configurations_of_other_problems_are_refused(line, said):
    with pytest.raises(InputError, match=said):
        Su2Config(line, "case.cfg").check(["wing"])


def test_the_mach_number_is_alone_without_a_reynolds_number():
    assert Su2Config(EULER, "").mach_is_alone
    assert not Su2Config(CONFIG, "").mach_is_alone
    assert Su2Config(CONFIG + "INIT_OPTION= TD_CONDITIONS\n", "").mach_is_alone


@pytest.mark.parametrize("axes", ["xzy", "xyz", "zxy", "yxz"])
def test_the_frame_is_a_rotation_with_the_stream_along_x_and_up_along_z(axes):
    frame = Su2Frame.of(axes, None, "flow")
    downstream, _, up = np.eye(3)[["xyz".index(axis) for axis in axes]]
    np.testing.assert_allclose(np.linalg.det(frame.rows), 1.0)
    np.testing.assert_allclose(frame.rows @ downstream, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(frame.rows @ up, [0.0, 0.0, 1.0])
    weights, by_alpha = frame.lift_and_drag(30.0)
    np.testing.assert_allclose(weights, [[np.sqrt(0.75), 0.0, 0.5], [-0.5, 0.0, np.sqrt(0.75)]], atol=1e-15)
    ahead, _ = frame.lift_and_drag(30.001)
    np.testing.assert_allclose((ahead - weights) / 0.001, by_alpha, atol=1e-6)


def test_a_mesh_of_two_dimensions_is_written_as_it_was_read(tmp_path):
    (tmp_path / "square.su2").write_text(SQUARE)
    model = MeshModel.of(read_mesh(tmp_path / "square.su2").mesh, {"wall": "wall", "far": "farfield"})
    flown = MeshToFly.of(model)
    frame = Su2Frame.of("xzy", flown.across, "flow")
    text = Su2Mesh.of(flown, frame).text(model.mesh.points[flown.rows])
    assert text.index("NPOIN") < text.index("NMARK")  # SU2 reads no other order
    (tmp_path / "again.su2").write_text(text)
    again = read_mesh(tmp_path / "again.su2").mesh
    np.testing.assert_array_equal(again.points, model.mesh.points)
    for kind, corners in model.mesh.cells.items():
        np.testing.assert_array_equal(np.sort(again.cells[kind]), np.sort(corners))
    assert set(again.markers) == {"wall", "far"}
    with pytest.raises(InputError, match="the second axis is that across the plane"):
        Su2Frame.of("xyz", flown.across, "flow")


def test_a_grid_of_blocks_is_written_with_each_node_once(tmp_path):
    model = fit_grid(onera_m6_grid((5, 6, 5)))
    flown, frame = MeshToFly.of(model), Su2Frame.of("xzy", None, "flow")
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    (tmp_path / "wing.su2").write_text(Su2Mesh.of(flown, frame).text(nodes[flown.rows]))
    again = read_mesh(tmp_path / "wing.su2").mesh
    np.testing.assert_allclose(again.points @ frame.rows, flown.mesh.points, atol=1e-12)
    assert again.n_points == len(np.unique(nodes, axis=0))
    assert not again.quality().is_inverted.any()
    assert {name: len(faces) for name, faces in again.markers.items()} == {
        name: len(faces) for name, faces in flown.mesh.markers.items()
    }


def test_a_pressure_of_one_on_a_part_of_a_box_is_the_force_of_its_area():
    corners = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.5, 3.0]])
    walls = WallPressures(np.array([[0, 1, 2, 3], [0, 4, 1, 1]]), 5, 1.0)
    quad, triangle = np.array([0.0, 0.0, 2.0]), 0.5 * np.cross(corners[4] - corners[0], corners[1] - corners[0])
    np.testing.assert_allclose(walls.force(corners, np.ones(5)), -quad - triangle)
    at_tip = np.eye(5)[4]
    np.testing.assert_allclose(walls.force(corners, at_tip), -triangle / 3.0)
