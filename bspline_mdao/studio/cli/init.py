"""The command ``init``: the draft of a study of a grid."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import tomlkit

from ...base.extras import INSTALL
from ...base.numerics.progress import Progress, progress_bar
from ...core.background.fit_mesh import fit_mesh
from ...core.background.mesh_file import is_mesh_model, mesh_file_in
from ...core.background.mesh_model import MeshModel
from ...core.cad.files import read_cad
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...grids.io.disk import replaced_file
from ...grids.io.formats import MODEL
from ...grids.io.meshes.ffd_boxes import read_ffd_boxes
from ...grids.io.meshes.files import is_mesh
from ...grids.topology.detection import find_topology
from ..study.draft import Aim, study_draft
from ..study.draft_body import GridBody, MeshBody
from .output import check_outputs, print_lines, print_warnings
from .sources import file_of, load_grid

MARKS = "guessed", "set yours"
"""What comments of lines to be checked say."""


def draft_study(
    grid_name: str,  # grid file, fitted model (``.h5``), or ``@`` and the name of a built-in grid
    output: Path,  # study to write
    patches: Path | None = None,  # declared patches
    aim: Aim | None = None,  # flight conditions and objective of a section
    cad: Path | None = None,  # STEP or IGES file of the walls
) -> None:
    """Draft a study of a grid and say what to do next."""
    file = file_of(grid_name)
    check_outputs([output], [file, patches, cad])
    if output.suffix != ".toml":
        raise InputError(f"{output}: a study is a TOML file; name it .toml")
    if file is not None and Path(file).suffix == MODEL and patches:
        raise InputError(f"{patches}: a fitted model has its patches; leave --patches out")
    faces = read_cad(cad).face_names if cad else ()
    with progress_bar() as progress:
        progress(0.0, "reading")
        is_of_mesh = file is not None and (is_mesh_model(file) or is_mesh(file))
        body = _mesh_body(str(file), patches) if is_of_mesh else _grid_body(grid_name, patches, progress)
        progress(0.6, "drafting")
        mesh_file = _mesh_file(str(file)) if is_of_mesh else ""
        boxes = read_ffd_boxes(mesh_file) if mesh_file.lower().endswith(".su2") else ()
        names = [_relative_to(each, output) or "" for each in (file, mesh_file)]
        text = study_draft(
            names[0] or grid_name,
            _relative_to(patches, output),
            body,
            names[1],
            [box.name for box in boxes],
            aim,
            _relative_to(cad, output) or "",
            faces,
        )
    with replaced_file(output) as part:
        part.write_text(text, encoding="utf-8")
    print_lines([*_key_lines(text), f"{output} written; check it, and run 'bspline-mdao optimize {output} -o out'"])
    if body.worst <= 0.0:
        print_warnings(
            [
                f"{output}: no bound of {body.aggregate} is drafted: it is {body.worst:.2g} on the grid as it is, "
                f"whose cells are inverted or nearly so; 'bspline-mdao quality' lists them"
            ]
        )
    if body.axes and body.why_backwards:
        print_warnings([f"{output}: {body.why_backwards}; turn the mesh"])
    if body.axes and body.plane_off and "[flow]" in text:
        print_warnings(
            [
                f"{output}: flows need the plane of symmetry at {body.axes[1]} = 0, and it is at {body.plane_off:g}: "
                f"shift the grid, fit it again and draft the study again"
            ]
        )
    if body.lacks_lattice:
        print_warnings(
            [
                f"{output}: its flow needs OpenAeroStruct: {INSTALL.format(extra='vlm')}; then draft it again: until "
                f"then the lift in it is estimated, not computed"
            ]
        )


def _key_lines(text: str) -> Iterator[str]:
    """What a draft poses, and its lines that have to be checked."""
    draft = tomlkit.parse(text)
    for table in ("objective", "variables", "constraints"):
        yield f"{table}: {draft[table]['of'] if table == 'objective' else ', '.join(draft[table])}"
    yield f"flow: {draft['flow']['kind'] if 'flow' in draft else 'none'}"
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("#") and any(mark in line for mark in MARKS):
            yield f"line {number}: {line}"


def _grid_body(grid_name: str, patches: Path | None, progress: Progress) -> GridBody:
    """Walls of a grid of blocks, or of its fitted model."""
    file = file_of(grid_name)
    model = FittedModel.load(file) if file and Path(file).suffix == MODEL else None
    grid = model.regenerate() if model else load_grid(grid_name, patches)
    progress(0.3, "topology")
    topology = model.topology if model else find_topology(grid)
    try:
        return GridBody(grid, topology)
    except InputError:
        use = "fit the grid again with" if model else "give"
        raise InputError(
            f"{grid_name}: no patch is a wall, so there is nothing to design; draft patches by 'bspline-mdao "
            f"inspect {grid_name} --draft patches.toml', check them, and {use} --patches patches.toml"
        ) from None


def _mesh_body(name: str, patches: Path | None) -> MeshBody:
    """Walls of an unstructured mesh, or of its model."""
    return MeshBody(MeshModel.load(name) if Path(name).suffix == MODEL else fit_mesh(name, patches))


def _mesh_file(name: str) -> str:
    """A mesh's own file, if it still exists; otherwise empty."""
    file = mesh_file_in(name) if Path(name).suffix == MODEL else name
    return file if Path(file).is_file() else ""


def _relative_to(file: str | Path | None, output: Path) -> str | None:
    """Path of a file relative to the folder of the study."""
    if file is None:
        return None
    try:
        return Path(os.path.relpath(Path(file).resolve(), output.resolve().parent)).as_posix()
    except ValueError:  # on another drive of Windows
        return str(Path(file).resolve())
