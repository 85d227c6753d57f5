"""Airfoils: names, files of two columns, outlines that are refused, and O-grids about them."""

import os
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.generators import (
    Airfoil,
    airfoil,
    airfoil_grid,
    cst_airfoil,
    naca_airfoil,
    naca_section,
    read_airfoil,
    section_o_grid,
)
from bspline_mdao.grids.cells.wall_spacing import flat_plate_y_plus

CAMBERED = naca_airfoil("6412").points[::4]
UPPER, LOWER = CAMBERED[50::-1], CAMBERED[50:]
BLUNT = naca_airfoil("2412", blunt=True).points[::4]


def lines(points, form="{:.7f} {:.7f}"):
    return "".join(form.format(*point) + "\n" for point in points)


def read(folder, text, **options):
    path = Path(folder, "section.dat")
    path.write_bytes(text.encode())
    return read_airfoil(path, **options)


def distance_from(section: Airfoil, points: np.ndarray) -> float:
    """Largest distance of points (n, 2) from an outline, by its chord."""
    outline = section._curve(np.linspace(0.0, section._curve.x[-1], 20_001))
    ends = np.stack([outline[:-1], outline[1:]])
    step = ends[1] - ends[0]
    part = np.einsum("pnd,nd->pn", points[:, None] - ends[0], step) / np.einsum("nd,nd->n", step, step)
    off = points[:, None] - ends[0] - np.clip(part, 0.0, 1.0)[..., None] * step
    return float(np.linalg.norm(off, axis=2).min(axis=1).max()) / section.chord


def test_names_of_digits_are_the_published_sections():
    plain, line = airfoil("NACA 0012"), naca_airfoil("23012", blunt=True)
    section = naca_section(0.12)
    np.testing.assert_allclose(plain.points, np.concatenate([section.upper[::-1], section.lower[1:]]), atol=1e-15)
    # I. H. Abbott and A. E. von Doenhoff, "Theory of Wing Sections", 1959, appendix III: stations and ordinates
    published = np.array([[1.25, 2.67], [5.0, 4.91], [15.0, 7.19], [30.0, 7.55], [60.0, 5.47], [90.0, 1.68]]) / 100.0
    np.testing.assert_allclose(np.interp(published[:, 0], *line.points[200::-1].T), published[:, 1], atol=1.5e-4)
    assert naca_airfoil("0012", blunt=True).base == pytest.approx(0.00252, rel=1e-3)
    assert plain.nose_radius == pytest.approx(1.1019 * 0.12**2, rel=5e-3)


def test_reflexed_and_plain_camber_lines_join_smoothly():
    for digits in ("23112", "24012", "2412"):
        points = naca_airfoil(digits).points
        middle = 0.5 * (points[:201][::-1] + points[200:])
        slopes = np.diff(middle[20:-20, 1]) / np.diff(middle[20:-20, 0])
        assert np.abs(np.diff(slopes)).max() < 0.02


def test_coefficients_of_one_shape_are_the_class_function():
    section = airfoil("cst:0.2,0.2,0.2/-0.1,-0.1/0.004")
    x, y = section.points[200::-1].T
    np.testing.assert_allclose(y, 0.2 * np.sqrt(x) * (1.0 - x) + 0.002 * x, atol=1e-15)
    x, y = section.points[200:].T
    np.testing.assert_allclose(y, -0.1 * np.sqrt(x) * (1.0 - x) - 0.002 * x, atol=1e-15)
    assert section.base == pytest.approx(0.004, rel=1e-4)
    assert cst_airfoil([0.2], [-0.2]).nose_radius == pytest.approx(0.02, rel=5e-3)  # half of the square of the first


@pytest.mark.parametrize(
    "text",
    [
        "NACA 6412\n" + lines(CAMBERED),
        "6412\r\n" + lines(CAMBERED, "{:.7f}\t{:.7f}").replace("\n", "\r\n"),
        "64 12\n" + lines(CAMBERED),
        "NACA 6412\n 51. 51.\n\n" + lines(UPPER) + "\n" + lines(LOWER),
        "NACA 6412\n51 51\n" + lines(LOWER) + "\n" + lines(UPPER),
        lines(UPPER) + lines(LOWER),
        "upper side\n" + lines(UPPER) + "lower side\n" + lines(LOWER) + "in 1990 it flew\n",
        "# a comment\n" + lines(CAMBERED, "{:.7f}, {:.7f} ! a point"),
        lines(CAMBERED[::-1]),
        lines(np.concatenate([CAMBERED[50:], CAMBERED[1:51]])),
        lines(CAMBERED, "{:.7f} {:.7f} 0.25"),
        lines(CAMBERED, "{:.7f}D+00 {:.7f}d+00"),
    ],
)
def test_files_of_any_order_title_and_separator_give_one_outline(tmp_path, text):
    np.testing.assert_allclose(read(tmp_path, text).points, CAMBERED, atol=6e-8)


@pytest.mark.parametrize("points", [BLUNT, np.vstack([BLUNT, BLUNT[:1]]), np.vstack([[1.0, 0.0], BLUNT, [1.0, 0.0]])])
def test_points_on_the_base_are_left_out_of_the_outline(tmp_path, points):
    found = read(tmp_path, lines(points))
    np.testing.assert_allclose(found.points, BLUNT, atol=6e-8)
    assert found.base == pytest.approx(0.00252, rel=1e-2)


def test_one_side_of_a_symmetric_section_is_mirrored_when_asked(tmp_path):
    side = naca_airfoil("0015", blunt=True).points[200::-5]
    found = read(tmp_path, lines(side), symmetric=True)
    np.testing.assert_allclose(found.points, found.points[::-1] * [1.0, -1.0], atol=1e-15)
    np.testing.assert_allclose(found.points[:41], side[::-1], atol=6e-8)
    with pytest.raises(InputError, match=r"open: it begins at .* line 41, and ends at .* line 1; .*symmetric=True"):
        read(tmp_path, lines(side))


def changed(row, point):
    points = CAMBERED.copy()
    points[row] = point
    return lines(points)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t\n" + changed(10, np.nan), "line 12: nan nan is not finite"),
        ("t\n" + lines(CAMBERED[[*range(10), 11, 10, *range(12, 101)]]), "line 13: .* goes back towards line 11"),
        ("t\n" + lines(np.insert(CAMBERED, 10, CAMBERED[10], axis=0)), "line 13: .* repeats line 12"),
        (lines(CAMBERED[::20]), "6 points are too few"),
        (lines(CAMBERED[:60]), "open: it begins at .* line 1, and ends at .* line 60"),
        (
            lines(CAMBERED[:-5]),
            r"end at \(1, 0\), line 1, and ahead of it at \(0.974869, .*\), line 96: the last point",
        ),
        (lines(CAMBERED[5:]), r"end at \(1, 0\), line 96, and ahead of it at .*, line 1: .* is missing; add it there"),
        (lines(UPPER) + lines(LOWER[:-5]), r"ahead of it at .*, line 97: .* \(1, 0\) for a sharp trailing edge"),
        (changed(40, [CAMBERED[40, 0], -0.1]), "line 41: .* 0.08 chords beyond the other side: the sides cross"),
        (lines(CAMBERED[:20]) + "0.5 O.1\n" + lines(CAMBERED[20:]), "line 21: '0.5 O.1' is not a point"),
        (lines(CAMBERED[:20]) + "0.5\n" + lines(CAMBERED[20:]), "line 21: '0.5' is not a point"),
        ("t\n 30. 30.\n" + lines(CAMBERED), "line 2: says that there are 30 and 30 points, and 101 follow"),
        (lines(CAMBERED * [1.0, 0.0]), "its sides coincide"),
        (lines([1.0, 0.0] - CAMBERED * [1.0, -1.0]), "its sharp end is at .* and its blunt one at .*; turn it"),
        (lines(CAMBERED) + "999.0 999.0\n" + lines(CAMBERED), "line 102: '999.0 999.0' separates elements"),
        (lines(np.column_stack([CAMBERED, CAMBERED[:, 0]]), "{} {} {}"), r"three columns, and the third one varies"),
        ("hello\n", "has no points"),
        ("a\0b", "is not text in two columns"),
    ],
)
def test_faults_of_files_name_the_line(tmp_path, text, message):
    with pytest.raises(InputError, match=rf"section\.dat: .*{message}"):
        read(tmp_path, text)


@pytest.mark.parametrize("base", [0.003, 0.02, 0.05])
@pytest.mark.parametrize("digits", ["0012", "2412", "6421", "9706"])
@pytest.mark.parametrize("slant", [-0.5, 0.0, 0.5])  # offset of the corners along the chord, by the height of the base
def test_bases_across_the_mean_line_across_the_chord_and_slanted_are_no_missing_points(digits, base, slant):
    outline = naca_airfoil(digits).points[::10]
    x, side = outline[:, 0], np.where(np.arange(len(outline)) < 20, 0.5, -0.5) * base
    slope = (outline[0, 1] - 0.5 * (outline[1] + outline[-2])[1]) / (1.0 - 0.5 * (outline[1] + outline[-2])[0])
    for lean in (0.0, -slope):
        opened = outline + np.column_stack([(lean + slant) * x**4 * side, x * side])
        for angle in np.radians([-10.0, 0.0, 10.0]):
            turned = opened @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
            assert Airfoil(turned).base > 0.9 * base
    with pytest.raises(InputError, match=r"point 38: the last point of a side is missing"):
        Airfoil(outline[:-2])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("naca123", "four or five digits"),
        ("naca64a010", "four or five digits"),
        ("naca27012", "no such camber line"),
        ("naca2012", "both 0 or neither"),
        ("cst:0.1", "write coefficients as cst:UPPER/LOWER"),
        ("cst:0.1,x/0.2", "write coefficients"),
        ("cst:0.1/-0.1/-1", "a\\s+base of 0 or more"),
        ("nowhere.dat", "nowhere.dat: .*; an airfoil is a file, NACA digits"),
    ],
)
def test_names_that_are_none_are_refused(name, message):
    with pytest.raises(InputError, match=message):
        airfoil(name)


def test_an_outline_in_python_is_refused_by_the_number_of_the_point():
    with pytest.raises(InputError, match=r"airfoil 'mine': point 7: .* is not finite"):
        Airfoil(np.where(np.arange(101)[:, None] == 7, np.inf, CAMBERED), "mine")
    with pytest.raises(InputError, match="runs along the lower side first"):
        Airfoil(CAMBERED[::-1])


@pytest.mark.parametrize("digits", ["0006", "0021", "2412", "23012"])
def test_points_that_are_too_few_for_the_thickness_are_said_to_be(digits):
    whole = naca_airfoil(digits)
    for n, off, is_dense in (
        (11, 0.11, True),
        (21, 0.01, True),
        (31, 1e-3, True),
        (31, 1e-3, False),
        (101, 1e-4, True),
    ):
        x = np.linspace(0.0, 1.0, (n + 1) // 2)
        x = 0.5 * (1.0 - np.cos(np.pi * x)) if is_dense else x
        upper, lower = (
            np.column_stack([x, np.interp(x, *side.T)]) for side in (whole.section.upper, whole.section.lower)
        )
        section = Airfoil(np.concatenate([upper[::-1], lower[1:]]), "few")
        assert bool(section.few_points) == (n == 11)
        assert abs(section.thickness / whole.thickness - 1.0) < off
        if n == 11:
            assert section.few_points.startswith("11 points are too few")
            assert section.thickness > 1.04 * whole.thickness
    assert whole.few_points == ""


def test_the_section_of_an_outline_is_itself_when_it_is_sharp_and_less_a_wedge_when_blunt():
    sharp, blunt = naca_airfoil("4415"), naca_airfoil("4415", blunt=True)
    assert distance_from(sharp, sharp.place(sharp.section.upper)) < 1e-7
    off = distance_from(blunt, blunt.place(blunt.section.lower))
    assert 0.9 * blunt.base < 2.0 * off < 1.01 * blunt.base


@pytest.mark.parametrize("name", ["naca23012", "naca6412", "naca0021", "naca0006", "cst:0.17,0.16,0.3/-0.17,-0.1,0.05"])
@pytest.mark.parametrize("layers", [{}, {"y_plus": 1.0, "reynolds": 6e6}])
def test_nodes_are_on_the_airfoil_and_no_cell_is_inverted(name, layers):
    (block,) = airfoil_grid(name, 64, **layers).blocks
    wall = block.nodes[:, 0, 0, :2]
    assert distance_from(airfoil(name), wall) < 2e-7
    along, away = np.diff(block.nodes[:, :, 0, :2], axis=0), np.diff(block.nodes[:, :, 0, :2], axis=1)
    for i, j in np.ndindex(2, 2):
        a, b = along[:, j : along.shape[1] - 1 + j], away[i : away.shape[0] - 1 + i]
        assert (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).min() > 0.0


def test_an_upper_side_that_begins_below_the_chord_has_a_grid():
    reflexed = airfoil("cst:0.2,0.15,0.1,-0.05/-0.1,-0.1,-0.1,-0.12")
    assert reflexed.points[1, 1] < 0.0
    assert airfoil_grid(reflexed, 32).shapes == ((33, 49, 2),)


def test_first_cells_have_the_height_of_y_plus_at_any_chord():
    nodes = airfoil_grid("naca0012", 64, y_plus=2.0, reynolds=4e6, chord=0.3).blocks[0].nodes
    heights = np.linalg.norm(nodes[:, 1, 0] - nodes[:, 0, 0], axis=1)
    assert np.ptp(nodes[:, 0, 0, 0]) == pytest.approx(0.3, rel=1e-9)
    for height in (heights.min(), heights.max()):
        assert flat_plate_y_plus(height, 4e6 / 0.3, 0.3) == pytest.approx(2.0, rel=1e-3)
    asked = airfoil_grid("naca0012", 64, first_cell=1e-4, chord=0.3).blocks[0].nodes
    assert np.linalg.norm(asked[5, 1, 0] - asked[5, 0, 0]) == pytest.approx(1e-4, rel=1e-3)


def test_a_file_of_any_unit_is_scaled_to_the_chord_and_one_of_unit_chord_stays(tmp_path):
    same = airfoil_grid(read(tmp_path, lines(CAMBERED)), 32).blocks[0].nodes
    millimetres = airfoil_grid(read(tmp_path, lines(250.0 * CAMBERED + [30.0, 5.0])), 32, chord=2.0).blocks[0].nodes
    assert same[0, 0, 0, :2] == pytest.approx([1.0, 0.0], abs=1e-12)
    at_nose = np.linalg.norm(millimetres[:, 0, 0, :2], axis=1).min()
    assert at_nose < 5e-3
    assert np.linalg.norm(millimetres[0, 0, 0, :2]) == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"y_plus": 1.0}, "go together"),
        ({"reynolds": 1e6}, "go together"),
        ({"y_plus": 1.0, "reynolds": 1e6, "first_cell": 1e-5}, "give one of both"),
        ({"first_cell": -1.0}, "first_cell of -1.0; give a positive number"),
        ({"chord": 0.0}, "a chord of 0 m"),
        ({"n_around": 7}, "airfoil 'naca0012': .* 7 cells around"),
        ({"far": 0.3}, "airfoil 'naca0012': "),
    ],
)
def test_grids_that_cannot_be_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        airfoil_grid("naca0012", **options)


def test_a_fitted_grid_of_the_naca_0012_keeps_its_wall_to_three_millionths_of_the_chord():
    grid = airfoil_grid("naca0012", 256, 64)
    model = fit_grid(grid, n_control=[(130, 18, 2)], keep_residual=False)
    wall = model.regenerate().blocks[0].nodes[:, 0, 0, :2]
    assert distance_from(airfoil("naca0012"), wall) < 3e-6


def test_the_onera_d_section_of_a_file_is_that_of_the_generators():
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    path = Path(folder or "", "..", "geometry", "onera_d_airfoil.txt")
    if not folder or not path.is_file():
        pytest.skip("needs the ONERA D section beside the folder BSPLINE_MDAO_GRIDS")
    found = read_airfoil(path, symmetric=True)
    assert found.base == pytest.approx(0.00141, rel=1e-3)
    assert found.thickness == pytest.approx(0.0973, abs=1e-4)
    assert section_o_grid(found.section, 64, far=20.0).shapes[0][0] == 65
