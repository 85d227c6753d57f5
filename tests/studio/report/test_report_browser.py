"""The page works in a real browser: no error, a drawing in space that is not blank, two widths, light and dark."""

import numpy as np
import pytest
from browser_cases import needs_browser, open_browser, pixels_of, require_no_error, wait_for
from report_cases import recorded_wing, small_model

from bspline_mdao import write_report

pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")
pytest.importorskip("plotly", reason="plotly is not installed")
pytest.importorskip("jinja2", reason="jinja2 is not installed")

pytestmark = [pytest.mark.slow, needs_browser]

WIDTHS = {"phone": 390, "desktop": 1280}


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("browser")
    model = small_model()
    path = folder / "wing.html"
    write_report(path, recorded_wing(folder, model), model, title="Wing")
    return path.as_uri()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    driver = open_browser(tmp_path_factory.mktemp("profile"))
    yield driver
    driver.quit()


def emulate(browser, width, scheme):
    """Be a screen of a width and a colour scheme."""
    sizes = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", sizes)
    prefer = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", prefer)


def opened(browser, address, width, scheme):
    emulate(browser, width, scheme)
    browser.get(address)
    wait_for(browser, "document.documentElement.dataset.ready === 'yes'")
    require_no_error(browser)


def picture(browser):
    """Pixels of the drawing in space, shape (height, width, 3)."""
    browser.execute_script(
        "document.getElementById('plot-space').scrollIntoView({block: 'center', behavior: 'instant'})"
    )
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))")
    return pixels_of(browser.find_element("id", "plot-space"))


def walls_in(pixels):
    """Part of the pixels that have the hue of walls: more blue than red, and neither grey nor ground."""
    return np.mean((pixels[..., 2] - pixels[..., 0] > 0.12) & (pixels[..., 2] > 0.25))


def choose(browser, selector, value):
    """Choose something in the tools above the drawing, as a user does."""
    browser.execute_script(
        "const e = document.querySelector(arguments[0]);"
        "if (e.tagName === 'SELECT') e.value = arguments[1]; else e.checked = arguments[1];"
        "e.dispatchEvent(new Event('change'));",
        selector,
        value,
    )


@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
def test_the_page_is_drawn_in_light_and_dark(browser, address, width):
    opened(browser, address, width, "light")
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    light = picture(browser)
    assert walls_in(light) > 0.01
    assert light[5, 5].min() > 0.95
    emulate(browser, width, "dark")
    wait_for(
        browser, "getComputedStyle(document.querySelector('#plot-quality .xtick text')).fill !== 'rgb(28, 37, 48)'"
    )
    dark = picture(browser)
    assert walls_in(dark) > 0.01
    assert dark[5, 5].max() < 0.25
    charts = "const charts = Array.from(document.querySelectorAll('.charts .plot'));"
    empty = "return charts.filter(chart => !chart.querySelector('.trace')).map(chart => chart.id)"
    assert browser.execute_script(charts + empty) == []
    require_no_error(browser)


def test_tools_change_the_drawing_and_the_diagram_opens(browser, address):
    opened(browser, address, WIDTHS["desktop"], "light")
    after = picture(browser)
    choose(browser, "input[name=shape][value='0']", True)
    before = picture(browser)
    assert np.mean(np.abs(after - before).max(axis=-1) > 0.1) > 0.002
    choose(browser, "#color", "Cp")
    pressures = picture(browser)
    assert np.mean(np.abs(pressures - before).max(axis=-1) > 0.1) > 0.01
    choose(browser, "input[name=layer][value='control']", True)
    assert np.mean(np.abs(picture(browser) - pressures).max(axis=-1) > 0.1) > 0.001
    browser.execute_script("document.getElementById('show-diagram').click()")
    browser.switch_to.frame(browser.find_element("css selector", "#diagram-place iframe"))
    wait_for(
        browser,
        "document.querySelector('#svgId, svg') && document.querySelector('svg').querySelectorAll('rect').length > 20",
    )
    browser.switch_to.default_content()
    require_no_error(browser)
    asked = "return performance.getEntriesByType('resource').map(e => e.name).filter(n => /^https?:/.test(n))"
    assert browser.execute_script(asked) == []


def test_a_wipe_shows_both_shapes_from_one_place(browser, address):
    opened(browser, address, WIDTHS["desktop"], "light")
    camera = {"eye": {"x": -0.7, "y": 1.1, "z": 0.9}, "up": {"x": 0.0, "y": 1.0, "z": 0.0}}
    turn = "Plotly.relayout(arguments[0], {'scene.camera': arguments[1]}).then(() => setTimeout(arguments[2], 400))"
    choose(browser, "input[name=shape][value='wipe']", True)
    wait_for(browser, "document.querySelector('#plot-other canvas') && !wipe.hidden")
    wait_for(browser, "other._fullLayout && other._fullLayout.scene.xaxis.autorange === false")
    for moved, follower in (("plot-space", "plot-other"), ("plot-other", "plot-space")):
        camera["eye"]["x"] -= 0.2
        browser.execute_async_script(turn, browser.find_element("id", moved), camera)
        found = browser.execute_script(f"return document.getElementById('{follower}').layout.scene.camera.eye")
        assert found == pytest.approx(camera["eye"], abs=1e-6)
    ranges = "return [space, other].map(d => ['x', 'y', 'z'].map(n => d._fullLayout.scene[n + 'axis'].range))"
    first, second = np.array(browser.execute_script(ranges))
    np.testing.assert_array_equal(first, second)
    halves = []
    for part in ("0", "100"):
        slide = "wipe.value = arguments[0]; wipe.dispatchEvent(new Event('input'))"
        browser.execute_script(slide, part)
        halves.append(pixels_of(browser.find_element("id", "stage")))
    assert np.mean(np.abs(halves[0] - halves[1]).max(axis=-1) > 0.1) > 0.002  # one shape each
    assert min(walls_in(half) for half in halves) > 0.01
    choose(browser, "input[name=shape][value='0']", True)
    wait_for(browser, "wipe.hidden && other.hidden")
    require_no_error(browser)
