"""Write the gallery page from the run scripts that draw, and with ``--draw`` run them first, at their small size."""

from __future__ import annotations

import importlib
import inspect
import sys
from pathlib import Path

DOCS = Path(__file__).parent
SCRIPTS = DOCS.parent / "run_scripts"
PICTURES = DOCS / "_gallery"

AT_ONCE = ("figure1_basis", "figure2_mesh1d", "figure3_modified_basis")
"""Scripts that take a second, whose pictures the pages of theory show: drawn in any case."""

HEAD = """Gallery
=======

Each picture is drawn by a run script, at its small size (``sphinx-build -t gallery``). The same script makes it
anywhere: ``python run_scripts/NAME.py --figures DIR``; ``--paper`` runs it at the size of the paper. Flows are those of
``--quick``. A script imports nothing but the package and its libraries: copy it and change it.
"""


def main(draw: bool) -> None:
    """Write ``gallery.rst`` and, if asked for, the pictures that it shows."""
    sys.path.insert(0, str(SCRIPTS))
    sections = [section(path.stem, draw) for path in sorted(SCRIPTS.glob("*.py"))]
    (DOCS / "gallery.rst").write_text("\n".join([HEAD, *sections]), encoding="utf-8")


def section(name: str, draw: bool) -> str:
    """Section of one script, with its title, what it shows and the pictures there are; empty if it draws nothing."""
    script = importlib.import_module(name)
    parameters = inspect.signature(script.main).parameters
    if "figures" not in parameters:
        return ""
    folder = PICTURES / name
    if draw or name in AT_ONCE:
        script.main(figures=folder, **({"quick": True} if "quick" in parameters else {}))
    title, _, about = script.__doc__.strip().partition("\n")
    title = title.rstrip(".")
    images = [
        f".. image:: _gallery/{name}/{path.name}\n   :alt: {title}\n   :width: {width(path)}px\n"
        for path in sorted(folder.glob("*.png"))
    ]
    return "\n".join([title, "-" * len(title), "", f"``run_scripts/{name}.py``", about, "", *images])


def width(path: Path) -> int:
    """Width of a PNG file at 85 dots per inch, so that text is of one size in all pictures of 200."""
    return int.from_bytes(path.read_bytes()[16:20], "big") * 85 // 200


if __name__ == "__main__":
    main(draw="--draw" in sys.argv[1:])
