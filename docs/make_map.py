"""Draw the layers of the package, their folders and the imports, as the page "Where things are" shows them.

``python docs/make_map.py`` writes ``docs/_static/map.svg``; a test fails where that picture is not the tree's. Imports
count wherever they stand: in functions, and under ``TYPE_CHECKING``. Layers stand on all layers below them; within a
layer an arrow is drawn where there is no longer way from one folder to the other (the transitive reduction), since with
all of them nothing can be seen.
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

WIDTH, BAND, BOX, HEIGHT, GAP = 1080, 200, 150, 46, 30
"""Pixels: of the picture, of the column with the layers' names, of a box in both directions, between two floors."""

COLORS = ("#f4f4f4", "#eef5ea", "#e8f0f8", "#f8efe4", "#f3ebf7", "#fbe9e9")
"""Of the layers, from below."""


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
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                full = f"{base}.{alias.name}"
                yield from (target for target in (full if full in known else base,) if target in known)


@cache
def file_arrows() -> dict[str, set[str]]:
    """For every module of the package those that it imports; the face of the package, which names all, left out."""
    known = modules()
    del known[PACKAGE.name]
    return {name: set(imports(name, path, known)) - {name} for name, path in known.items()}


def layer(name: str) -> str:
    """Layer of a module, or the module itself where it lies beside the layers."""
    return name.split(".")[1]


def folder(name: str) -> str:
    """Folder of a module within its layer, as ``core/fit``, or the module itself where it lies beside the folders."""
    return "/".join(name.split(".")[1:3])


def arrows_between(place) -> dict[str, set[str]]:
    """For every layer (``place=layer``) or folder (``place=folder``) those that it imports from."""
    arrows: dict[str, set[str]] = {}
    for name, targets in file_arrows().items():
        arrows.setdefault(place(name), set()).update(place(target) for target in targets)
    return {name: targets - {name} for name, targets in arrows.items()}


def layers() -> list[str]:
    """The layers from below: folders of the package, each above all that it imports."""
    arrows = {name: targets for name, targets in arrows_between(layer).items() if (PACKAGE / name).is_dir()}
    return [name for row in floors({name: targets & set(arrows) for name, targets in arrows.items()}) for name in row]


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


def first_line(name: str) -> str:
    """First line of the docstring of a folder."""
    text = ast.get_docstring(ast.parse((PACKAGE / name / "__init__.py").read_text(encoding="utf-8"))) or ""
    return text.split("\n")[0].rstrip(".").replace("`", "")


def summary(name: str) -> str:
    """First words of the docstring of a folder, up to a colon."""
    return first_line(name).split(":")[0]


def wrapped(text: str, length: int, lines: int) -> list[str]:
    """A text in a few lines at most."""
    found = [""]
    for word in text.split():
        if found[-1] and len(found[-1]) + len(word) >= length:
            found.append("")
        found[-1] = f"{found[-1]} {word}".strip()
    return found if len(found) <= lines else [*found[: lines - 1], f"{found[lines - 1]} …"]


def texts(x: float, y: float, title: str, lines: list[str], anchor: str) -> list[str]:
    """A title and lines under it."""
    place = f'x="{x:.0f}" text-anchor="{anchor}"'
    rows = [
        f'<text {place} y="{y + 29 + 12 * n:.0f}" font-size="10" fill="#333">{escape(line)}</text>'
        for n, line in enumerate(lines)
    ]
    return [f'<text {place} y="{y + 15:.0f}" font-size="13" font-weight="bold">{escape(title)}</text>', *rows]


def band(name: str, top: float, color: str) -> tuple[list[str], float]:
    """A layer with its folders and the arrows between them, and where it ends."""
    within = {
        place: {target for target in targets if target.startswith(f"{name}/")}
        for place, targets in arrows_between(folder).items()
        if (PACKAGE / place).is_dir() and place.startswith(f"{name}/")
    }
    within = {place: targets & set(within) for place, targets in within.items()}
    rows, arrows = (floors(within), reduced(within)) if within else ([], {})
    height = max(len(rows) * (HEIGHT + GAP) + 6, 92)
    at: dict[str, tuple[float, float]] = {}
    for n, row in enumerate(rows):
        wish = {place: sum(at[target][0] for target in arrows[place]) / max(len(arrows[place]), 1) for place in row}
        room = (WIDTH - BAND - len(row) * BOX) / (len(row) + 1)
        y = top + (len(rows) - 1 - n) * (HEIGHT + GAP) + GAP / 2 + 3
        at |= {
            place: (BAND + room + i * (BOX + room), y)
            for i, place in enumerate(sorted(row, key=lambda place: (wish[place], place)))
        }
    out = [
        f'<rect x="8" y="{top:.0f}" width="{WIDTH - 16}" height="{height:.0f}" rx="8" fill="{color}" stroke="#999"/>'
    ]
    out += texts(20, top + 6, f"{name}/", wrapped(first_line(name), 30, 6), "start")
    for place in sorted(arrows):
        for target in sorted(arrows[place]):
            (x, y), (u, v) = at[place], at[target]
            x, y, u = x + BOX / 2, y + HEIGHT, u + BOX / 2
            bend = max((v - y) / 2, GAP / 2)
            way = f"M{x:.0f} {y:.0f} C{x:.0f} {y + bend:.0f} {u:.0f} {v - bend:.0f} {u:.0f} {v:.0f}"
            out.append(f'<path d="{way}" fill="none" stroke="#5b6b7b" marker-end="url(#tip)"/>')
    for place, (x, y) in sorted(at.items()):
        out.append(
            f'<rect x="{x:.0f}" y="{y:.0f}" width="{BOX}" height="{HEIGHT}" rx="6" fill="#fff" stroke="#31587e"/>'
        )
        out += texts(x + BOX / 2, y, place.partition("/")[2], wrapped(summary(place), 28, 2), "middle")
    return out, top + height


def picture() -> str:
    """The picture as an SVG, the same text for the same tree."""
    body: list[str] = []
    end = 8.0
    for n, name in reversed(list(enumerate(layers()))):
        drawn, end = band(name, end, COLORS[n])
        body, end = [*body, *drawn], end + 8
    head = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {end:.0f}" font-family="sans-serif">',
        "<title>Layers of the package: each imports from those below; arrows between folders of a layer</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#5b6b7b"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{end:.0f}" fill="#ffffff"/>',
    ]
    return "\n".join([*head, *body, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture())
