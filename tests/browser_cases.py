"""Chromium without a window, for tests of pages."""

import io
import shutil
import time

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")

needs_browser = pytest.mark.skipif(not (BROWSER and DRIVER), reason="there is no Chromium with its driver")

FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL without a graphics card
)


def open_browser(profile):
    """Chromium with a folder for its profile; who opens it quits it."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in FLAGS:
        options.add_argument(flag)
    options.add_argument(f"--user-data-dir={profile}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))


def wait_for(browser, condition, seconds=60.0):
    """Wait until a condition in JavaScript holds."""
    end = time.monotonic() + seconds
    while not browser.execute_script(f"return Boolean({condition});"):
        assert time.monotonic() < end, condition
        time.sleep(0.05)


def require_no_error(browser):
    assert [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def pixels_of(element):
    """Pixels of what an element shows, shape (height, width, 3)."""
    from matplotlib import image

    return image.imread(io.BytesIO(element.screenshot_as_png), format="png")[..., :3].astype(float)
