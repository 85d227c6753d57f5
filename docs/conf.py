"""Sphinx configuration; build with ``sphinx-build -W -b html docs docs/_build/html``.

That takes two minutes and a half of one core, half a minute of them for the notebooks, and all but three scripts of the
gallery are shown without being run. With ``-t gallery`` those that have changed since the last time are run, at their
small size: seven minutes of one core for 31, once kernels are compiled.
"""

import subprocess
import sys
from pathlib import Path

import numba
from sphinx.ext import autosummary

numba.config.DISABLE_JIT = True  # autodoc sees plain functions instead of numba's dispatchers; other processes compile

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_ext")]

import drawings  # noqa: E402

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
    "sphinx_gallery.gen_gallery",
    "backlinks",
    "drawings",
    "functionals",
    "myst_nb",
    "mathml",
    "navigation",
    "public_names",
]
default_role = "py:obj"  # names in single backticks are links where they are public
templates_path = ["_templates"]
exclude_patterns = ["_build", "_ext", "gallery/*.ipynb"]  # those are for readers to take along
html_theme = "furo"
html_title = "bspline_mdao"
html_static_path = ["_static"]
html_css_files = ["custom.css"]
html_math_renderer = "mathml"
pygments_style = "friendly"

autosummary_generate = True
autosummary.WELL_KNOWN_ABBREVIATIONS += ("Eq.",)  # else tables end a summary there: "from the control points, Eq."
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the numpydoc sections carry shapes and units, which hints cannot
napoleon_google_docstring = False
napoleon_use_param = False  # types such as "ndarray, shape (n, 3)" are text and no cross-references
napoleon_use_rtype = False
napoleon_custom_sections = [("Options", "params_style")]

nb_execution_mode = "force"  # notebooks are kept without outputs
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 300

html_extra_path = ["_n2"]
(DOCS / "_n2").mkdir(exist_ok=True)  # Sphinx looks for it before `draw_n2` fills it
sphinx_gallery_conf = {
    "examples_dirs": "../run_scripts",
    "gallery_dirs": "gallery",
    **drawings.patterns(with_all=tags.has("gallery")),  # noqa: F821 (Sphinx defines it)
    "reset_argv": drawings.arguments,
    "image_scrapers": ("drawings.pictures",),
    "within_subsection_order": "FileNameSortKey",
    "parallel": 2,  # processes of their own, where kernels are compiled
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "plot_gallery": "True",
    "min_reported_time": 10,
    "write_computation_times": False,  # a page that only those who build want, and that a search would find
}


def draw_n2(app):
    """Write the N2 diagrams that pages embed, in a process of its own."""
    subprocess.run([sys.executable, str(DOCS / "make_n2.py"), str(DOCS / "_n2")], check=True)


def setup(app):
    """Make the diagrams before the pages are read."""
    app.connect("builder-inited", draw_n2)
