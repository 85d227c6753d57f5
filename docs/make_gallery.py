"""Run every run script that draws at its small size and write the gallery page from what they draw."""

from __future__ import annotations

import importlib
import inspect
import sys
from pathlib import Path

DOCS = Path(__file__).parent
SCRIPTS = DOCS.parent / "run_scripts"
PICTURES = DOCS / "_gallery"

HEAD = """Gallery
=======

Each picture is drawn by a run script, at its small size, when these pages are built. The same script makes it
anywhere: ``python run_scripts/NAME.py --figures DIR``; ``--paper`` runs it at the size of the paper. Flows are those of
``--quick``. A script imports nothing but the package and its libraries: copy it and change it.
"""


def main() -> None:
    """Write ``gallery.rst`` and the pictures that it shows."""
    sys.path.insert(0, str(SCRIPTS))
    sections = [section(path.stem) for path in sorted(SCRIPTS.glob("*.py"))]
    (DOCS / "gallery.rst").write_text("\n".join([HEAD, *sections]), encoding="utf-8")


def section(name: str) -> str:
    """Section of one script, with its title, what it shows and its pictures; empty if it draws nothing."""
    script = importlib.import_module(name)
    parameters = inspect.signature(script.main).parameters
    if "figures" not in parameters:
        return ""
    folder = PICTURES / name
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
    main()
