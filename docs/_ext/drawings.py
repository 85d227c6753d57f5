"""What sphinx-gallery has to know of the run scripts: their arguments, their pictures, and where titles are."""

import re
import shutil
import tempfile
from importlib.util import find_spec
from pathlib import Path

from sphinx_gallery.scrapers import figure_rst

SCRIPTS = Path(__file__).parents[2] / "run_scripts"

AT_ONCE = ("figure1_basis", "figure2_mesh1d", "figure3_modified_basis")
"""Scripts that take a second, whose pictures the pages of theory show: drawn in any case."""

SOLVERS = {"openfoam": lambda: shutil.which("simpleFoam"), "adflow": lambda: find_spec("adflow")}
"""Programs of others by the first word of the scripts that need them, and what says whether they are here."""


GROUPS = {
    "Optimise a shape": (
        *("m6_transonic", "m6_lift_constrained", "m6_levels", "plate_to_aircraft", "multipoint_section"),
        *("adodg1_naca0012", "twist_induced_drag", "wing_twist_vlm", "cad_wing", "pressure_target", "inverse_design"),
        *("min_area_body", "smooth_seams", "quality_constrained"),
        *("jax_descent", "torch_designer", "surrogate_of_designs"),
    ),
    "Move a grid": (
        *("control_mesh", "flap_deflection", "turbine_sector", "surface_to_volume", "viscous_grids"),
        *("improve_grids", "adapt_grid", "unsteady_wing"),
    ),
    "Any mesh": ("wing_body_su2", "wing_slides_on_body", "ride_along", "ride_section", "curved_elements"),
    "Flow": (
        *("transonic_naca0012", "validation_m6", "validation_sections", "validation_exact", "wing_flow_table"),
        "grid_family",
    ),
    "Solvers of others": (
        *("adflow_wing", "adflow_section", "openfoam_wing", "openfoam_airfoil"),
        *("euler_aerostructural", "wing_aerostructural"),
    ),
    "Figures and tables of the paper": (
        *("figures7_8_meshes", "figure6_bwb_euler", "figures4_5_quality", "figure1_basis", "figure2_mesh1d"),
        *("figure3_modified_basis", "table1_fit_errors", "section4_cpu"),
    ),
}
"""Scripts that draw, by the headings that they stand under in the gallery, those that are seen first at the top."""


def draws(script: Path) -> bool:
    """Whether a script writes pictures."""
    return "figures=None" in script.read_text(encoding="utf-8")


def patterns(with_all: bool) -> dict[str, str]:
    """Which scripts have no page, since they draw nothing, and which are run."""
    silent = [path.stem for path in SCRIPTS.glob("*.py") if not draws(path)]
    elsewhere = [
        path.stem for name, is_there in SOLVERS.items() if not is_there() for path in SCRIPTS.glob(f"{name}_*")
    ]
    missing = "".join(rf"(?<!{name})" for name in elsewhere)
    return {
        "ignore_pattern": rf"(^|[/\\])({'|'.join(sorted(silent))})\.py$",  # it is shown bare names and paths
        "filename_pattern": rf"{missing}\.py$" if with_all else rf"/({'|'.join(AT_ONCE)})\.py$",
    }


def folder_of(script: str) -> Path:
    """Folder that a script draws into."""
    return Path(tempfile.gettempdir()) / "bspline_mdao_gallery" / Path(script).stem


class Arguments:
    """Arguments of a script: its small size, and a folder for pictures."""

    def __call__(self, gallery_conf, script_vars) -> list[str]:
        """Arguments behind the name of the script."""
        script = script_vars["src_file"]
        has_quick = "quick: bool" in Path(script).read_text(encoding="utf-8")
        return ["--figures", str(folder_of(script)), *(["--quick"] if has_quick else [])]

    def __repr__(self) -> str:
        """The same in every session, so that nothing is drawn again for it."""
        return "drawings.arguments"


arguments = Arguments()


def pictures(block, block_vars, gallery_conf) -> str:
    """Take the pictures that a script has written."""
    found, paths = sorted(folder_of(block_vars["src_file"]).glob("*.png")), block_vars["image_path_iterator"]
    taken = []
    for source, path in zip(found, paths):
        source.replace(path)
        taken.append(path)
    return figure_rst(taken, gallery_conf["src_dir"]) if taken else ""


def grouped(index: str) -> str:
    """Put the thumbnails of the gallery's page under the headings of `GROUPS`."""
    opening, closing = ".. thumbnail-parent-div-open\n", ".. thumbnail-parent-div-close\n"
    head, rest = index.split(opening)
    thumbnails, tail = rest.split(closing)
    head, frame = head.rsplit(".. raw:: html", 1)
    end, tail = re.match(r"(\s*\.\. raw:: html\n\n    </div>\n)(.*)", tail, re.S).groups()
    blocks = re.split(r"(?=^\.\. raw:: html\n\n    <div class=\"sphx-glr-thumbcontainer)", thumbnails, flags=re.M)[1:]
    of_script = {re.search(r":doc:`/?gallery/(\w+)`", block)[1]: block for block in blocks}
    parts = [head]
    for title, names in GROUPS.items():
        shown = "".join(of_script[name] for name in names if name in of_script)
        parts.append(f"{title}\n{'-' * len(title)}\n\n.. raw:: html{frame}{shown}{end}\n")
    return "".join([*parts, tail])


def dress(app, docname, source) -> None:
    """Group the gallery, and make the first line of a script, text in Python, the title of its page."""
    if docname == "gallery/index":
        source[0] = grouped(source[0])
    if re.match(r"gallery/(?!index|sg_)\w+$", docname):
        source[0] = re.sub(
            r"(\.\. _sphx_glr_gallery_\w+\.py:\n\n+)([^\n]+?)\.?\n",
            lambda m: f"{m[1]}{m[2]}\n{'=' * len(m[2])}\n",
            source[0],
            count=1,
        )


def setup(app):
    """Look at each page as it is read."""
    app.connect("source-read", dress)
    return {"parallel_read_safe": True}
