"""The kinds of grids of studies: fitted blocks, and unstructured meshes.

All that differs between them is here: keys that one of them does not accept, names of output files, and the
statements of a script that make the model, move it and write it.
"""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ...core.background.mesh_file import is_mesh_model, mesh_file_in
from ...core.generators.built_in import generator_of
from ...grids.cells.aggregates import AGGREGATES
from ...grids.io.files import open_grid
from ...grids.io.formats import MODEL, POLYMESH
from ...grids.io.meshes.files import is_mesh
from .expressions import names_in
from .syntax import call, expression, statement
from .tables import Table

__all__ = ["GridKind", "kind_of"]

Fault = tuple[tuple[str, ...], str]
"""Path of a key, and what is wrong with it."""

PathOf = Callable[[str], ast.expr]
"""Makes the path of a file in a study, as a tree."""


class GridKind(ABC):
    """Properties that differ with the kind of a study's grid."""

    @abstractmethod
    def faults(
        self,
        document: Mapping[str, Any],  # the study as it is written
        asked: Mapping[tuple[str, ...], str],  # expressions of objective and constraints by their paths
    ) -> Iterator[Fault]:
        """Settings of a study that its grid does not accept."""

    @abstractmethod
    def written(self, when: str, file: Path, output: Table) -> str:
        """Name of the grid that is written ``"before"`` or ``"after"``, a folder if it ends in ``polyMesh``."""

    @abstractmethod
    def is_plane(self, name: str, folder: Path) -> bool:
        """Whether a grid, by its name and folder in a study, must first be made one cell deep."""

    @abstractmethod
    def model_part(self, grid: Table, path_of: PathOf, is_plane: bool) -> Iterator[ast.stmt | str]:
        """Statements that make ``model``."""

    @abstractmethod
    def mover_part(self, made: Callable[[], Iterator[ast.stmt | str]]) -> Iterator[ast.stmt | str]:
        """Statements that make ``mover``, if the study says what moves the control mesh."""

    @property
    @abstractmethod
    def movement(self) -> dict[str, Any]:
        """Arguments of ``wing.grid_movement`` besides measures and quality."""

    @abstractmethod
    def write(self, when: str, name: str, slides: bool) -> ast.expr:
        """Call that writes the grid ``"before"``, or ``"after"`` of the problem as it is."""

    @property
    @abstractmethod
    def write_design(self) -> str:
        """Call that writes the grid of a design, by its ``number``, to a ``file``."""


class Blocks(GridKind):
    """Grids of blocks: files, built-in ones, and fitted models."""

    def faults(self, document: Mapping[str, Any], asked: Mapping[tuple[str, ...], str]) -> Iterator[Fault]:
        """Settings of a study that its grid does not accept."""
        grid = document["grid"]
        for key in ("patches", "n_control", "order", "corrections") if Path(grid["file"]).suffix == MODEL else ():
            if key in grid:
                yield ("grid", key), "does not go with a fitted model, which has it; leave it out"
        if "spacing" in grid:
            yield ("grid", "spacing"), "is for the lattice around an unstructured mesh; leave it out"
        for name, table in document["variables"].items():
            if table.get("kind", name) == "free_lattice":
                complaint = "is for the lattice around an unstructured mesh; take kind = 'lattice' or 'ffd'"
                yield ("variables", name, *(["kind"] if "kind" in table else [])), complaint

    def written(self, when: str, file: Path, output: Table) -> str:
        """Name of the grid that is written."""
        return f"grid_{when}.{output['grid'] or ('cgns' if file.suffix == '.cgns' else 'xyz')}"

    def is_plane(self, name: str, folder: Path) -> bool:
        """Whether the blocks of a grid are one node deep."""
        if name.startswith("@") or Path(name).suffix == MODEL:
            return False
        return all(1 in shape for shape in open_grid(folder / name).shapes)

    def model_part(self, grid: Table, path_of: PathOf, is_plane: bool) -> Iterator[ast.stmt | str]:
        """Statements that make ``model``."""
        name = grid["file"]
        if Path(name).suffix == MODEL:
            yield statement("model = bm.FittedModel.load(file)", file=path_of(name))
            return
        patches = [path_of(grid["patches"])] if grid["patches"] else []
        if name.startswith("@") or is_plane:
            if is_plane:
                made = call("bm.files.lift_plane_grid", call("bm.read_grid", path_of(name)))
            else:
                place, shape = generator_of(name)
                made = call(f"bm.generators.{place.rpartition('.')[2]}", shape)
            if patches:
                made = call("bm.files.read_patches", *patches, made)
        else:
            made = call("bm.read_grid", path_of(name), *patches)
        settings = {key: grid[key] for key in ("n_control", "order") if grid[key] is not None}
        settings |= {"corrections": grid["corrections"]} if grid["corrections"] else {}
        yield statement("model = made", made=call("bm.fit_grid", made, **settings))

    def mover_part(self, made: Callable[[], Iterator[ast.stmt | str]]) -> Iterator[ast.stmt | str]:
        """Statements that make ``mover``."""
        return made()

    @property
    def movement(self) -> dict[str, Any]:
        """Arguments of ``wing.grid_movement``."""
        return {"mover": expression("mover")}

    def write(self, when: str, name: str, slides: bool) -> ast.expr:
        """Call that writes the grid, whose patches may slide on surfaces."""
        moved = f'problem.get_val("control_points").reshape(-1, 3){", wing.mesh.slides" if slides else ""}'
        points = {"before": "", "after": moved}[when]
        return expression(f"bm.write_grid(HERE / file, model.regenerate({points}))", file=name)

    write_design = "bm.write_grid(file, designs.grid(number, model), model.topology)"


class Meshes(GridKind):
    """Unstructured meshes: files, and models that ``fit`` made of them."""

    def faults(self, document: Mapping[str, Any], asked: Mapping[tuple[str, ...], str]) -> Iterator[Fault]:
        """Settings of a study that its grid does not accept."""
        grid = document["grid"]
        for key in ("n_control", "order", "corrections", "fixed", "released", "sliding"):
            if key in grid:
                yield ("grid", key), "is for fitted grids of blocks, and a lattice moves this one; leave it out"
        for key in ("patches", "spacing") if Path(grid["file"]).suffix == MODEL else ():
            if key in grid:
                yield ("grid", key), "does not go with the model of a mesh, which has it; leave it out"
        if document.get("movement"):
            yield ("movement",), "is for grids of blocks; the lattice around a mesh moves it: leave this table out"
        if document.get("flow", {}).get("kind") == "euler":
            yield (
                ("flow", "kind"),
                "is 'euler', which is solved on fitted grids of blocks, and a lattice moves this one; take 'lattice' "
                "about one half of a wing, leave [flow] out, or connect your own solver in Python",
            )
        judged = ", ".join(name for name, aggregate in AGGREGATES.items() if aggregate.of_mixed)
        for name, aggregate in AGGREGATES.items():
            if not aggregate.of_mixed and (path := _first(asked, name)):
                yield path, f"names '{name}', which needs hexahedra in blocks; for any cells there are {judged}"
        if "grid" in document.get("output", {}):
            yield ("output", "grid"), "is for grids of blocks; a mesh is written as its own file is: leave it out"

    def written(self, when: str, file: Path, output: Table) -> str:
        """Name of the mesh that is written, in the format of its own file."""
        source = Path(mesh_file_in(file) if file.suffix == MODEL else file)
        return f"grid_{when}/{POLYMESH}" if source.name == POLYMESH else f"grid_{when}{source.suffix}"

    def is_plane(self, name: str, folder: Path) -> bool:
        """False: readers make a two-dimensional mesh one cell deep."""
        return False

    def model_part(self, grid: Table, path_of: PathOf, is_plane: bool) -> Iterator[ast.stmt | str]:
        """Statements that make ``model``, and ``mesh``, the file into which moved nodes are written."""
        if Path(grid["file"]).suffix == MODEL:
            yield statement("model = bm.meshes.MeshModel.load(file)", file=path_of(grid["file"]))
        else:
            given: dict[str, Any] = {"patches": path_of(grid["patches"])} if grid["patches"] else {}
            if grid["spacing"]:
                given["settings"] = call("bm.meshes.LatticeSettings", spacing=grid["spacing"])
            yield statement("model = made", made=call("bm.meshes.fit_mesh", path_of(grid["file"]), **given))
        yield "# moved nodes are written into copies of this file"
        yield statement("mesh = bm.meshes.open_mesh_file(model)")

    def mover_part(self, made: Callable[[], Iterator[ast.stmt | str]]) -> Iterator[ast.stmt | str]:
        """None: the lattice of the model moves it."""
        yield from ()

    @property
    def movement(self) -> dict[str, Any]:
        """Arguments of ``wing.grid_movement``."""
        return {}

    def write(self, when: str, name: str, slides: bool) -> ast.expr:
        """Call that writes the mesh."""
        moved = 'model.node_map.at(problem.get_val("control_points").reshape(-1, 3)).nodes'  # on all processes
        points = {"before": "mesh.mesh.points", "after": moved}[when]
        return expression(f"mesh.write(HERE / file, {points})", file=name)

    write_design = "mesh.write(file, designs.grid(number, model).points)"


BLOCKS, MESHES = Blocks(), Meshes()


def kind_of(
    name: str,  # file, or built-in grid, as named in the study
    folder: Path,  # folder of the study
) -> GridKind:
    """Find the kind of a grid."""
    if name.startswith("@"):
        return BLOCKS
    return MESHES if is_mesh_model(folder / name) or is_mesh(folder / name) else BLOCKS


def _first(asked: Mapping[tuple[str, ...], str], name: str) -> tuple[str, ...]:
    """Place where a name is first used; None if it is not."""
    return next((path for path, of in asked.items() if name in names_in(of)), ())
