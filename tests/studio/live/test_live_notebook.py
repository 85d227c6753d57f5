"""The page of ``live`` in a notebook: what is dragged there is known to the next cell, and the grid is that of move."""

import json
import time

import numpy as np
import pytest
from browser_cases import needs_browser, open_browser, require_no_error, wait_for

from bspline_mdao import FittedModel
from bspline_mdao.studio.live.shape import LiveModel

pytest.importorskip("trame.app", reason="trame is not installed")
pytest.importorskip("ipykernel", reason="ipykernel, the kernel of notebooks, is not installed")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")

CELLS = [
    "from bspline_mdao.plotting import live\nview = await live('{model}', folder='{folder}')\nview",
    "import json\nprint(json.dumps([view.values, view.words]))",
    "import numpy as np\nnp.save('{folder}/nodes.npy', view.grid.to_vector())",
    "await view.close()",
]


@pytest.fixture
def notebook(wing_file, tmp_path):
    cells = [nbformat.v4.new_code_cell(text.format(model=wing_file, folder=tmp_path)) for text in CELLS]
    client = nbclient.NotebookClient(nbformat.v4.new_notebook(cells=cells), timeout=300, kernel_name="python3")
    with client.setup_kernel():
        yield lambda number: client.execute_cell(client.nb.cells[number], number)


@pytest.mark.slow
@needs_browser
def test_a_slider_in_a_notebook_moves_the_grid_of_the_kernel(notebook, wing_file, tmp_path):
    keys = pytest.importorskip("selenium.webdriver", reason="selenium is not installed").Keys
    html = next(out["data"]["text/html"] for out in notebook(0)["outputs"] if "data" in out)
    assert 'src="http://127.0.0.1:' in html
    (tmp_path / "cell.html").write_text(html)
    browser = open_browser(tmp_path / "profile")
    try:
        browser.get((tmp_path / "cell.html").as_uri())
        browser.switch_to.frame(0)
        wait_for(browser, "document.querySelector('canvas') && document.querySelector('#numbers')")
        time.sleep(1.0)
        browser.find_elements("css selector", ".v-slider-thumb")[2].send_keys(keys.END)
        wait_for(browser, "Number(window.trame.state.get('numbers')[0].value) > 0")
        values, words = json.loads(notebook(1)["outputs"][0]["text"])
        require_no_error(browser)
        assert values["twist at the tip"] == 12.0
        assert words == "twist=12deg"
        notebook(2)
        live = LiveModel(FittedModel.load(wing_file))
        expected = live.at(live.neutral.with_value(2, 12.0), with_lift=False).nodes
        np.testing.assert_array_equal(np.load(tmp_path / "nodes.npy").reshape(-1, 3), expected)
        notebook(3)
        browser.switch_to.default_content()
    finally:
        browser.quit()
