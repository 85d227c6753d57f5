"""Write typed signatures of components, groups and drivers for editors and type checkers, from their declared options.

``python tools/write_signatures.py`` writes into each class that the package makes public an ``__init__`` under
``TYPE_CHECKING``: an argument for each option that the class declares, with its type and default. It costs nothing
when the package runs, where ``inspect.signature`` and ``help`` read the options, see ``core/om/option_signature.py``. A
test fails where what is written is not what the options give.

Types are as declared. If OpenMDAO cannot check a type, such as the type of the items of a list, they
are in `KINDS`; where nothing is declared, the type of the default is taken.
"""

from __future__ import annotations

import ast
import inspect
import subprocess
from collections.abc import Iterator
from inspect import Parameter
from numbers import Integral, Real
from pathlib import Path
from types import ModuleType
from typing import Any

import bspline_mdao
from bspline_mdao.core.om.option_signature import OptionSignature

ROOT = Path(__file__).parents[1]

KINDS = {
    "CadWalls.variables": "Sequence[CadVariable]",
    "InteriorControl.variables": "Sequence[InteriorPoints]",
    "SeamMeasure.measure": "SeamSmoothness",
    "OpenFoamFlow.case": "FlowCase",
    "OpenFoamFlow.folder": "str | os.PathLike[str]",
    "OpenFoamFlow.time_limit": "float",
    "aggregates": "Sequence[str]",
    "case": "str | os.PathLike[str]",
    "config": "str | os.PathLike[str]",
    "ends": "Sequence[float]",
    "generation": "int",
    "hinges": "Sequence[HingeMoment]",
    "measure": "Measure",
    "measures": "Sequence[Measure]",
    "moment_reference": "Sequence[float]",
    "mover": "Mover",
    "numbers": "Sequence[int] | np.ndarray",
    "parameters": "dict[str, float]",
    "patches": "str | Sequence[str]",
    "point_sets": "dict[str, np.ndarray]",
    "quality": "bool | Sequence[str]",
    "reference_area": "float",
    "restart": "str | os.PathLike[str]",
    "rows": "Sequence[int] | np.ndarray",
    "slides": "Sequence[Slide]",
    "surface": "SurfaceGrid",
    "PointSet.tolerance": "float",
    "Ride.tolerance": "float",
    "time_limit": "float",
    "walls": "Sequence[str]",
}
"""Types of options whose declaration does not give them, by the name of the option, or class and option."""

WORDS = {Real: "float", Integral: "int", bool: "bool", type(None): "None"}
"""What types of declarations are called in annotations, where not by their names."""


def public_classes(space: ModuleType = bspline_mdao) -> Iterator[type]:
    """Classes in a namespace and those below it whose signatures are their options, each once."""
    found: dict[type, None] = {}
    for name in space.__all__:
        value = getattr(space, name)
        if isinstance(value, ModuleType):
            found.update(dict.fromkeys(public_classes(value)))
        elif isinstance(value, type) and isinstance(
            inspect.getattr_static(value, "__signature__", None), OptionSignature
        ):
            found[value] = None
    yield from found


def annotation(kind: type, name: str) -> str:
    """Type of an option of a class, as it is annotated."""
    about = kind().options._dict[name]
    text = KINDS.get(f"{kind.__name__}.{name}") or KINDS.get(name) or _declared(about)
    if text is None:
        raise SystemExit(f"{kind.__name__}: nothing tells the type of the option '{name}'; write it into KINDS")
    parts = [*dict.fromkeys(part for part in text.split(" | ") if part != "None")]
    return " | ".join([*parts, *(["None"] if about["allow_none"] or "None" in text.split(" | ") else [])])


def _declared(about: dict[str, Any]) -> str | None:
    """Type that the declaration of an option gives."""
    types, values, default = about["types"], about["values"], about["val"]
    if types is not None:
        return " | ".join(_word(kind) for kind in (types if isinstance(types, tuple) else (types,)))
    if isinstance(values, (tuple, list)):
        names = ", ".join(f'"{value}"' for value in values if value is not None)
        return f"Literal[{names}]" + (" | None" if None in values else "")
    if isinstance(default, (bool, int, float, str)):
        return _word(type(default))
    return None


def _word(kind: type) -> str:
    """What a type is called in an annotation."""
    return WORDS.get(kind) or ("np.ndarray" if kind.__module__ == "numpy" else kind.__name__)


def lines(kind: type) -> list[str]:
    """Lines of a class that give its signature, as ruff formats them but for those that are too long."""
    arguments = []
    for name, parameter in inspect.signature(kind).parameters.items():
        if parameter.kind is Parameter.VAR_KEYWORD:
            continue
        default = "" if parameter.default is Parameter.empty else f" = {_literal(parameter.default)}"
        comma = ",  # noqa: B006" if default == " = {}" else ","  # ruff takes no mutable default
        arguments.append(f"            {name}: {annotation(kind, name)}{default}{comma}")
    ignored = "  # type: ignore[misc]" if "__init__" in vars(kind) else ""  # mypy allows no second one
    head = ["    if TYPE_CHECKING:  # written by tools/write_signatures.py", "", f"        def __init__({ignored}"]
    return [
        *head,
        "            self,",
        "            *,",
        *arguments,
        "            **options: Any,",
        "        ) -> None: ...",
    ]


def _literal(value: Any) -> str:
    """Text of a default that reads as it."""
    text = repr(value)
    if ast.literal_eval(text) != value:
        raise SystemExit(f"the default {text} is no literal")
    return text.replace("'", '"') if isinstance(value, (str, tuple)) else text


def written(kind: type) -> ast.If | None:
    """What stands in the source of a class for its signature."""
    blocks = [node for node in class_node(kind).body if isinstance(node, ast.If)]
    return next((node for node in blocks if ast.unparse(node.test) == "TYPE_CHECKING"), None)


def class_node(kind: type) -> ast.ClassDef:
    """The source of a class."""
    tree = ast.parse(Path(inspect.getfile(kind)).read_text())
    return next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == kind.__name__)


def write(kind: type) -> Path:
    """Write the signature of a class into its file: behind its ``__init__``, or before its first method."""
    path, old = Path(inspect.getfile(kind)), written(kind)
    source = path.read_text().splitlines()
    if old is not None:
        source[old.lineno - 1 : old.end_lineno] = lines(kind)
    else:
        methods = [node for node in class_node(kind).body if isinstance(node, ast.FunctionDef)]
        first = methods[0].decorator_list[0].lineno if methods[0].decorator_list else methods[0].lineno
        at = methods[0].end_lineno if methods[0].name == "__init__" else first - 1
        source[at:at] = ["", *lines(kind), ""]
    path.write_text("\n".join(source) + "\n")
    return path


if __name__ == "__main__":
    files = sorted({str(write(kind)) for kind in public_classes()})
    subprocess.run(["ruff", "format", "--quiet", *files], cwd=ROOT, check=True)
