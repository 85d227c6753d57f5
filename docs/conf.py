"""Sphinx configuration; build with ``sphinx-build -W -b html docs docs/_build/html``.

That takes a minute or two, and shows the pictures of the gallery that there are. With ``-t gallery`` they are drawn
anew by the run scripts, which takes some ten minutes.
"""

import os
import subprocess
import sys
from pathlib import Path

os.environ["NUMBA_DISABLE_JIT"] = "1"  # autodoc sees plain functions instead of numba's dispatchers

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_ext")]

from bspline_mdao import __version__  # noqa: E402

project = "bspline_mdao"
author = "The bspline_mdao developers"
project_copyright = "The bspline_mdao developers"
release = version = __version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_design",
    "myst_parser",
    "mathml",
    "public_names",
]
default_role = "py:obj"  # names in single backticks are links where they are public
templates_path = ["_templates"]
exclude_patterns = ["_build", "_ext"]
html_theme = "furo"
html_title = "bspline_mdao"
html_static_path = ["_static"]
html_css_files = ["custom.css"]
html_math_renderer = "mathml"
pygments_style = "friendly"

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the numpydoc sections carry shapes and units, which hints cannot
napoleon_google_docstring = False
napoleon_use_param = False  # types such as "ndarray, shape (n, 3)" are text and no cross-references
napoleon_use_rtype = False
napoleon_custom_sections = [("Options", "params_style")]


def make_gallery(app):
    """Write the gallery's page, and draw its pictures anew if the tag ``gallery`` is set."""
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_DISABLE_JIT"}
    options = ["--draw"] if app.tags.has("gallery") else []
    subprocess.run([sys.executable, str(DOCS / "make_gallery.py"), *options], check=True, env=environment)


def setup(app):
    """Make the gallery before the pages are read."""
    app.connect("builder-inited", make_gallery)
