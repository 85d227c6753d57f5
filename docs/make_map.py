"""Draw the folders of the package and the imports between them, as the page "Where things are" shows them.

``python docs/make_map.py`` writes ``docs/_static/map.svg``; a test fails where that picture is not the tree's. Imports
count wherever they stand: in functions, and under ``TYPE_CHECKING``. An arrow is drawn where there is no longer way
from one folder to the other (the transitive reduction), since with all of them nothing can be seen.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "bspline_mdao"
PICTURE = ROOT / "docs" / "_static" / "map.svg"

WIDTH, BOX, HEIGHT, GAP = 1080, 172, 48, 34
"""Pixels: of the picture, of a box in both directions, and between two floors."""


def modules() -> dict[str, Path]:
    """Dotted name of every module of the package, and its file."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(name: str, path: Path, known: Mapping[str, Path]) -> Iterator[str]:
    """Modules of the package that a module imports, anywhere in its text."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{base}.{alias.name}"
                yield from (target for target in (full if full in known else base,) if target in known)


def folder(name: str) -> str:
    """Folder of a module, or the module itself where it lies beside the folders."""
    return name.split(".")[1]


@cache
def file_arrows() -> dict[str, set[str]]:
    """For every module of the package those that it imports; the face of the package, which names all, left out."""
    known = modules()
    del known[PACKAGE.name]
    return {name: set(imports(name, path, known)) - {name} for name, path in known.items()}


def folder_arrows() -> dict[str, set[str]]:
    """For every folder, and every module beside the folders, those that it imports from."""
    arrows: dict[str, set[str]] = {}
    for name, targets in file_arrows().items():
        arrows.setdefault(folder(name), set()).update(folder(target) for target in targets)
    return {name: targets - {name} for name, targets in arrows.items()}


def circles(arrows: Mapping[str, set[str]]) -> list[str]:
    """What is left when everything is taken away, again and again, that imports nothing which is still there."""
    left = {name: set(targets) for name, targets in arrows.items()}
    while free := [name for name, targets in left.items() if not targets & set(left)]:
        for name in free:
            del left[name]
    return sorted(name for name in left if any(name in targets for targets in left.values()))


def floors(arrows: Mapping[str, set[str]]) -> list[list[str]]:
    """Names by the longest way down from them; those on floor 0 import nothing."""
    floor: dict[str, int] = {}

    def height(name: str) -> int:
        if name not in floor:
            floor[name] = 1 + max((height(target) for target in arrows[name]), default=-1)
        return floor[name]

    highest = max(map(height, arrows))
    return [sorted(name for name in arrows if floor[name] == n) for n in range(highest + 1)]


def reduced(arrows: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The arrows beside which there is no longer way."""

    def reached(name: str) -> set[str]:
        return arrows[name].union(*map(reached, arrows[name]))

    return {name: targets.difference(*map(reached, targets)) for name, targets in arrows.items()}


def summary(name: str) -> str:
    """First words of the docstring of a folder or module, up to a colon or full stop."""
    path = PACKAGE / name / "__init__.py" if (PACKAGE / name).is_dir() else PACKAGE / f"{name}.py"
    return (
        (ast.get_docstring(ast.parse(path.read_text())) or "").split("\n")[0].split(":")[0].rstrip(".").replace("`", "")
    )


def wrapped(text: str, length: int = 30) -> list[str]:
    """A text in two lines at most."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + len(word) >= length:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines if len(lines) < 3 else [lines[0], f"{lines[1]} …"]


def places(rows: list[list[str]], arrows: Mapping[str, set[str]]) -> dict[str, tuple[float, float]]:
    """Upper left corner of every box: floor by floor from below, each near those that it stands on."""
    found: dict[str, tuple[float, float]] = {}
    for n, row in enumerate(rows):
        wish = {}
        for name in row:
            below = [found[target][0] for target in arrows[name]]
            wish[name] = sum(below) / len(below) if below else (WIDTH - BOX) / 2
        order = sorted(row, key=lambda name: (wish[name], name))
        room = (WIDTH - len(row) * BOX) / (len(row) + 1)
        y = (len(rows) - 1 - n) * (HEIGHT + GAP) + 8
        found |= {name: (room + i * (BOX + room), y) for i, name in enumerate(order)}
    return found


def beside() -> list[str]:
    """Modules that lie beside the folders; all may import them, and they import no folder."""
    return sorted(name for name in folder_arrows() if not (PACKAGE / name).is_dir())


def box(x: float, y: float, width: float, color: str, title: str, lines: list[str]) -> str:
    """One box with a title and lines under it."""
    middle = f'x="{x + width / 2:.0f}" text-anchor="middle"'
    out = [
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{HEIGHT}" rx="6" fill="{color}" stroke="#31587e"/>',
        f'<text {middle} y="{y + 15:.0f}" font-size="13" font-weight="bold">{escape(title)}</text>',
    ]
    for n, line in enumerate(lines):
        out.append(f'<text {middle} y="{y + 29 + 12 * n:.0f}" font-size="10" fill="#333">{escape(line)}</text>')
    return "\n".join(out)


def picture() -> str:
    """The picture as an SVG, the same text for the same tree."""
    ground = beside()
    everything = {name: targets - set(ground) for name, targets in folder_arrows().items() if name not in ground}
    arrows, rows = reduced(everything), floors(everything)
    at = places(rows, arrows)
    height = (len(rows) + 1) * (HEIGHT + GAP)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif">',
        "<title>Folders of the package; an arrow points to what is imported</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#5b6b7b"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
    ]
    long: list[str] = []
    for name in sorted(arrows):
        for target in sorted(arrows[name]):
            (x, y), (u, v) = at[name], at[target]
            x, y, u = x + BOX / 2, y + HEIGHT, u + BOX / 2
            bend = max((v - y) / 2, GAP / 2)
            way = f"M{x:.0f} {y:.0f} C{x:.0f} {y + bend:.0f} {u:.0f} {v - bend:.0f} {u:.0f} {v:.0f}"
            is_long = (
                v - y > HEIGHT + GAP
            )  # past other floors: in front of their boxes, else it seems to come from them
            dashes = ' stroke-dasharray="5 4"' if is_long else ""
            (long if is_long else out).append(
                f'<path d="{way}" fill="none" stroke="#5b6b7b"{dashes} marker-end="url(#tip)"/>'
            )
    out += [box(*at[name], BOX, "#e8f0f8", f"{name}/", wrapped(summary(name))) for name in sorted(at)]
    out += long
    modules_beside = "  ".join(f"{name}.py" for name in ground)
    low = len(rows) * (HEIGHT + GAP) + 8
    out.append(box(24, low, WIDTH - 48, "#f4f4f4", modules_beside, ["beside the folders, for all of them"]))
    return "\n".join([*out, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture())
