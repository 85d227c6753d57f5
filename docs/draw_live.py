"""Draw the page of ``live`` for the documentation: four pictures of a wing that is deformed, in one file.

``python docs/draw_live.py`` opens a wing in Chromium without a window, and writes ``docs/_static/live.png``.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from bspline_mdao import fit_grid
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.studio.live.scene import Scene
from bspline_mdao.studio.live.shape import LiveModel

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "_static" / "live.png"
WIDTH, HEIGHT, COLOURS = 1280, 760, 128

sys.path.insert(0, str(ROOT / "tests"))


def main() -> None:
    """Take the pictures and join them."""
    from browser_cases import open_browser, wait_for
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder, "wing.h5")
        fitted = fit_grid(onera_m6_grid((25, 21, 17)), n_control=(9, 7, 7))
        fitted.save(model)
        call = [sys.executable, "-m", "bspline_mdao", "live", str(model), "--no-browser"]
        server = subprocess.Popen(call, cwd=folder, stdout=subprocess.PIPE, text=True)
        browser = open_browser(Path(folder, "profile"))
        try:
            address = next(filter(None, (re.search(r"http://\S+", line) for line in server.stdout)))[0]
            browser.execute_cdp_cmd(
                "Emulation.setDeviceMetricsOverride",
                {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False},
            )
            browser.get(address)
            wait_for(browser, "document.querySelector('canvas') && document.querySelector('#numbers')")
            frames = [_frame(browser, **state) for state in STATES]
            frames += _pulled(browser, LiveModel(fitted))
        finally:
            browser.quit()
            server.terminate()
            server.wait()
    pictures = [np.asarray(Image.open(io.BytesIO(frame)).convert("RGB")) for frame in frames]
    rows = [np.concatenate(pictures[at : at + 2], axis=1) for at in (0, 2)]
    whole = Image.fromarray(np.concatenate(rows, axis=0))
    small = whole.resize((whole.width * 5 // 8, whole.height * 5 // 8), Image.Resampling.LANCZOS)
    small.quantize(COLOURS, dither=Image.Dither.NONE).save(PICTURE, optimize=True)
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1e3:.0f} kB")


STATES = ({}, {"slider_2": 8.0, "slider_3": 12.0, "colour": "displacement"})
"""What the page is put to for the first pictures."""


def _frame(browser, **state) -> bytes:
    """Put the page to a state and take a picture of it."""
    for name, value in state.items():
        browser.execute_script("window.trame.state.set(arguments[0], arguments[1])", name, value)
    time.sleep(4.0)
    return browser.get_screenshot_as_png()


def _pulled(browser, live: LiveModel) -> list[bytes]:
    """Pull a control point on the upper side with the mouse, and one at the tip until cells are inverted."""
    from selenium.webdriver import ActionChains, Keys

    browser.find_element("id", "reset").click()
    browser.find_element("id", "is_pulling").click()
    time.sleep(2.0)
    sheet = browser.find_element("id", "sheet")
    shape, scene = (sheet.size["width"], sheet.size["height"]), Scene(live)
    from_middle = scene.camera.project(scene.surface, shape)[0] - 0.5 * np.array(shape)
    is_above = live.normals[:, 1] > 0.5
    row = int(np.argmin(np.where(is_above, np.linalg.norm(from_middle, axis=1), np.inf)))
    hand = ActionChains(browser).move_to_element_with_offset(sheet, *from_middle[row].round().astype(int).tolist())
    hand.click_and_hold().move_by_offset(0, -30).move_by_offset(0, -30).release().perform()
    frames = [_frame(browser, colour="heights")]
    field = browser.find_element("css selector", "input#picked")
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys(str(_tangling(live) + 1))
    time.sleep(1.0)
    return [*frames, _frame(browser, colour="corner", pull_x=PULL)]


PULL = -0.4
"""Displacement (m) upstream that inverts cells."""


def _tangling(live: LiveModel) -> int:
    """Row of a control point that inverts cells when it is pulled upstream, the nearest to the tip."""
    for row in np.argsort(-_along_span(live), kind="stable").tolist():
        try:
            if live.at(live.neutral.with_pull(row, (PULL, 0.0, 0.0)), with_lift=False).n_inverted:
                return row
        except (InputError, MovementError):
            continue
    raise SystemExit("no control point tangles the grid")


def _along_span(live: LiveModel) -> np.ndarray:
    """Places of control points along the span, of those on the upper side."""
    points = live.model.control_points[live.mesh.surface_ids]
    return np.where(live.normals[:, 1] > 0.0, points[:, 2], -np.inf)


if __name__ == "__main__":
    main()
