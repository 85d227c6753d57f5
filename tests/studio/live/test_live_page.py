"""The page of ``live`` in a real browser: sliders and control points move the grid, without an error, on loopback."""

import json
import re
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from http.client import HTTPConnection

import numpy as np
import pytest
from browser_cases import needs_browser, open_browser, pixels_of, require_no_error, wait_for

from bspline_mdao.errors import InputError
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.live.drawn import Drawn
from bspline_mdao.studio.live.page import require_trame
from bspline_mdao.studio.live.scene import COLOURS, Camera, Scene, View
from bspline_mdao.studio.live.session import Session


def test_one_line_names_the_extra_that_is_missing(wing_file, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "trame.app", None)
    with pytest.raises(InputError, match=r'pip install "bspline_mdao\[live\]"'):
        require_trame()
    assert run(["live", str(wing_file)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_session_keeps_the_last_shape_where_a_design_has_none(live, tmp_path):
    session = Session(live, tmp_path)
    session.picked = int(np.setdiff1d(np.arange(len(live.mesh.surface_ids)), live.mesh.in_plane_rows)[5])
    session.pull((0.0, 0.0, 5.0))
    before = session.shape
    assert not session.update()
    assert session.complaint
    assert session.shape is before
    assert session.history.undo()
    assert session.update()
    assert session.complaint == ""
    session.pull((1.0, 0.0, 0.0))
    assert session.update()
    assert "inverted" in session.warning
    assert any(row.is_bad for row in session.rows())
    assert session.command == ""
    session.reset()
    assert session.update()
    assert session.warning == ""
    assert session.write(".nonsense").startswith("nothing was written")
    assert session.write(".csv").endswith("written")


def test_a_session_nudges_along_the_normal_and_keeps_sliders_within_their_ranges(live, tmp_path):
    session = Session(live, tmp_path)
    session.nudge(0.1)
    assert session.design == live.neutral
    session.picked = 3
    session.nudge(0.002)
    session.nudge(0.001)
    np.testing.assert_allclose(session.displacement, 0.003 * live.normals[3], atol=1e-11)
    session.set(0, 100.0)
    assert session.design.values[0] == live.sliders[0].high
    assert session.update()
    assert session.complete()
    if live.lift.lattice is not None:
        assert session.shape.lift is not None


def test_a_session_makes_what_is_seen_and_then_the_rest(live, tmp_path):
    session, part = Session(live, tmp_path), live.part_of(Drawn.of(live.model.topology).cells)
    assert session.update(part)
    at_rest = session.rows()
    assert [row.value for row in at_rest[:4]] == [row.was for row in at_rest[:4]]
    session.set(2, 7.0)
    assert session.update(part)
    assert session.shape.part is part
    assert session.write(".xyz").endswith("written")
    assert session.shape.part is None
    expected = live.at(session.design)
    np.testing.assert_array_equal(session.shape.nodes, expected.nodes)
    assert session.shape.lift == expected.lift


def test_a_click_takes_the_control_point_that_is_seen_there():
    camera = Camera(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 30.0)
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [1.0, 0.5, -2.0]])
    shape = (800.0, 600.0)
    pixels, depths = camera.project(points, shape)
    np.testing.assert_allclose(pixels[0], [400.0, 300.0])
    assert pixels[1, 0] > 400.0 > 300.0 > pixels[1, 1]
    np.testing.assert_allclose(depths, [10.0, 10.0, 12.0])
    move = camera.displacement(points[1], np.array([30.0, -20.0]), shape)
    moved, _ = camera.project(points[1:2] + move, shape)
    np.testing.assert_allclose(moved[0] - pixels[1], [30.0, -20.0])


@pytest.fixture
def vtk():
    return pytest.importorskip("vtkmodules.vtkRenderingUI", reason="VTK is not installed")


def test_the_scene_draws_what_the_shape_has(live, vtk):
    scene, shape = Scene(live), live.at(live.neutral.with_value(2, 6.0), with_lift=False)
    for colour in COLOURS:
        low, high = scene.show(shape, View(colour))
        assert low < high
    scene.show(shape, View("quality", has_symmetry=True, direction=2, part=0.3))
    data = scene._sheets
    points = scene.vtk.numpy.vtk_to_numpy(data.GetPoints().GetData())
    np.testing.assert_allclose(points, shape.nodes[scene._drawn.rows], rtol=1e-6, atol=1e-6)
    colours = scene.vtk.numpy.vtk_to_numpy(data.GetCellData().GetScalars())
    np.testing.assert_allclose(colours, shape.q[scene._drawn.cells], rtol=1e-6, atol=1e-6)
    picture = (780.0, 700.0)
    pixels, _ = scene.camera.project(scene.surface, picture)
    assert (pixels > 0.0).all()
    assert (pixels < picture).all()
    row = scene.nearest(scene.camera, pixels[7] + 1.0, picture)
    assert np.linalg.norm(pixels[row] - pixels[7]) < 24.0
    assert scene.nearest(scene.camera, np.array([-500.0, -500.0]), picture) is None


@contextmanager
def served(file, folder):
    """Address of the page of a model or a study, by the command."""
    call = [sys.executable, "-m", "bspline_mdao", "live", str(file), "--no-browser", "-o", str(folder)]
    server = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        for line in server.stdout:
            found = re.search(r"http://127\.0\.0\.1:\d+/", line)
            if found:
                break
        else:
            pytest.fail("the page was not served")
        yield found[0]
    finally:
        server.terminate()
        server.communicate(timeout=60)


@pytest.fixture(scope="module")
def address(wing_file):
    pytest.importorskip("trame.app", reason="trame is not installed")
    pytest.importorskip("trame.widgets.vtk", reason="trame-vtk is not installed")
    with served(wing_file, wing_file.parent / "written") as address:
        yield address


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")
    driver = open_browser(tmp_path_factory.mktemp("profile"))
    driver.set_window_size(1440, 900)
    yield driver
    driver.quit()


def state(browser, name):
    return browser.execute_script("return window.trame.state.get(arguments[0])", name)


def displacement(browser):
    return float(state(browser, "numbers")[0]["value"])


def picture(browser):
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))")
    time.sleep(0.5)
    return pixels_of(browser.find_element("css selector", "canvas"))


def differs(a, b):
    return np.mean(np.abs(a - b).max(axis=-1) > 0.1)


MOVED = "Number(window.trame.state.get('numbers')[0].value) > 0"
AT_REST = "Number(window.trame.state.get('numbers')[0].value) === 0"


@pytest.mark.slow
@needs_browser
def test_sliders_and_control_points_move_the_grid_in_the_browser(browser, address, live):
    from selenium.webdriver import ActionChains, Keys

    browser.get(address)
    wait_for(browser, "document.querySelector('canvas') && document.querySelector('#numbers')")
    time.sleep(2.0)  # the scene is drawn when its arrays have come
    before = picture(browser)
    assert np.mean(before[..., 2] - before[..., 0] > 0.1) > 0.02  # the blue to green of the wing
    # a slider, by the keyboard
    browser.find_elements("css selector", ".v-slider-thumb")[2].send_keys(Keys.END)
    wait_for(browser, MOVED)
    assert state(browser, "slider_2") == live.sliders[2].high
    assert state(browser, "command") == f"--deform {live.words(live.neutral.with_value(2, live.sliders[2].high))}"
    assert differs(picture(browser), before) > 0.005
    wait_for(browser, "window.trame.state.get('is_part') === false")  # the hand rests
    twisted = displacement(browser)
    expected = live.at(live.neutral.with_value(2, live.sliders[2].high), with_lift=False)
    assert twisted == pytest.approx(np.linalg.norm(expected.nodes - live.baseline, axis=1).max(), rel=1e-3)
    browser.find_element("id", "undo").click()
    wait_for(browser, AT_REST)
    assert state(browser, "slider_2") == 0.0
    browser.find_element("id", "redo").click()
    wait_for(browser, MOVED)
    browser.find_element("id", "reset").click()
    wait_for(browser, AT_REST)
    # a control point, by the mouse, across the line of sight
    browser.find_element("id", "is_pulling").click()
    wait_for(browser, "document.querySelector('#sheet')")
    sheet = browser.find_element("id", "sheet")
    shape = sheet.size["width"], sheet.size["height"]
    scene = Scene(live)
    scene.show(live.at(live.neutral, with_lift=False), View())
    pixels, _ = scene.camera.project(scene.surface, shape)
    inner = np.setdiff1d(np.arange(len(pixels)), live.mesh.in_plane_rows)
    row = int(inner[np.argmin(np.linalg.norm(pixels[inner] - 0.5 * np.array(shape), axis=1))])
    x, y = (pixels[row] - 0.5 * np.array(shape)).round().astype(int).tolist()
    still = picture(browser)
    hand = ActionChains(browser).move_to_element_with_offset(sheet, x, y).click_and_hold()
    hand.move_by_offset(0, -12).move_by_offset(0, -12).release().perform()
    wait_for(browser, MOVED)
    wait_for(browser, "window.trame.state.get('picked') !== null")
    pulled = np.array([state(browser, f"pull_{axis}") for axis in "xyz"])
    picked = int(state(browser, "picked")) - 1
    asked = scene.camera.displacement(scene.surface[picked], np.array([0.0, -24.0]), shape)
    np.testing.assert_allclose(pulled, asked, rtol=0.05, atol=1e-3)
    assert differs(picture(browser), still) > 1e-4
    assert state(browser, "command") == ""
    # along its normal, by a button; and a picture by another measure
    browser.find_element("id", "nudge-out").click()
    wait_for(browser, f"window.trame.state.get('pull_y') !== {pulled[1]}")
    browser.execute_script("window.trame.state.set('colour', 'displacement')")
    wait_for(browser, "window.trame.state.get('ends')[1] !== '1'")
    # a grid that tangles is said to, and nothing breaks
    at_tip = int(inner[5])
    field = browser.find_element("css selector", "input#picked")
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys(str(at_tip + 1))
    wait_for(browser, f"window.trame.state.get('picked') === {at_tip + 1}")
    browser.execute_script("window.trame.state.set('pull_x', -0.4)")
    wait_for(browser, "document.querySelector('#warning')")
    browser.find_element("id", "reset").click()
    wait_for(browser, "!document.querySelector('#warning')")
    # files
    browser.find_element("id", "write-csv").click()
    wait_for(browser, "/written$/.test(window.trame.state.get('message'))")
    require_no_error(browser)
    asked = "return performance.getEntriesByType('resource').map(e => e.name)"
    assert {name.split("/")[2] for name in browser.execute_script(asked)} == {address.split("/")[2]}


@pytest.mark.slow
@needs_browser
def test_the_variables_of_a_study_are_sliders_and_it_is_written_with_their_values(browser, wing_file, tmp_path):
    from selenium.webdriver import Keys

    study, written = tmp_path / "study.toml", tmp_path / "written"
    model = wing_file.as_posix()
    study.write_text(
        f"""
        grid.file = "{model}"
        variables.twist = {{stations = 2, lower = -4.0, upper = 6.0, start = [0.0, 1.5]}}
        objective.of = "volume"
        """
    )
    with served(study, written) as address:
        browser.get(address)
        wait_for(browser, "document.querySelector('canvas') && document.querySelector('#numbers')")
        time.sleep(2.0)
        assert len(browser.find_elements("css selector", ".v-navigation-drawer--left .v-slider-thumb")) == 2
        assert displacement(browser) > 0.0  # where the study starts
        browser.find_elements("css selector", ".v-slider-thumb")[0].send_keys(Keys.END)
        wait_for(browser, "window.trame.state.get('slider_0') === 6 && window.trame.state.get('can_undo')")
        browser.find_element("id", "write-toml").click()
        wait_for(browser, "/written$/.test(window.trame.state.get('message'))")
        require_no_error(browser)
    assert "start = [6.0, 1.5]" in (written / "study_live_1.toml").read_text()


@pytest.mark.slow
def test_the_secret_of_the_socket_is_told_to_this_machine_by_its_address_alone(address):
    port = int(re.search(r":(\d+)/", address)[1])
    answers = []
    for host in (f"127.0.0.1:{port}", f"elsewhere.example:{port}"):
        connection = HTTPConnection("127.0.0.1", port, timeout=20.0)
        connection.request("POST", "/paraview/", body="{}", headers={"Host": host})
        answers.append(connection.getresponse())
    assert [answer.status for answer in answers] == [200, 403]
    told = json.loads(answers[0].read())
    assert told["sessionURL"] == f"ws://127.0.0.1:{port}/ws"
    assert len(told["secret"]) > 20
    assert answers[0].headers.get("Access-Control-Allow-Origin") is None


@pytest.mark.slow
def test_the_page_is_served_on_the_loopback_address_alone(address):
    port = int(re.search(r":(\d+)/", address)[1])
    with socket.create_connection(("127.0.0.1", port), timeout=10.0):
        pass
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for other in others - {"127.0.0.1"}:
        if other.startswith("127."):
            continue
        with pytest.raises(OSError):
            socket.create_connection((other, port), timeout=10.0)
