"""Files of a shape: a report, its model, CAD, a grid, control points of its surface, a study that starts there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core.cad.files import SUFFIXES
from ...core.cad.write_cad import write_cad
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...grids.io.disk import replaced_file
from ...grids.io.files import write_grid
from ...grids.io.formats import MODEL
from ..report.page import write_report
from ..study.draft import study_draft
from ..study.draft_body import GridBody
from .shape import LiveModel, Shape

__all__ = ["free_name", "model_of", "write_shape"]


def model_of(live: LiveModel, shape: Shape) -> FittedModel:
    """Return a shape as a fitted model whose baseline is the grid of the shape, to round-off."""
    residual = shape.nodes - live.model.evaluator().forward(shape.control_points)
    return replace(live.model, control_points=shape.control_points, residual=residual)


def write_shape(path: Path, live: LiveModel, shape: Shape) -> tuple[Path, ...]:
    """Write a shape in the format of the file's suffix; return the files that were written.

    ``.html`` is a report, ``.h5`` a model, ``.step`` or ``.igs`` its walls as CAD. ``.toml`` is a study, with the model
    that it starts from next to it, or the study whose variables are shown, with their values. ``.csv`` has the control
    points of the surface, as ``move --deform`` reads them. Other suffixes are grids, such as ``.xyz``.
    """
    write = WRITERS.get(path.suffix.lower(), _write_grid)
    return write(path, live, shape)


def free_name(folder: Path, stem: str, suffix: str) -> Path:
    """Find an unused file name: ``stem_1.xyz``, ``stem_2.xyz``."""
    number = 1
    while (folder / f"{stem}_{number}{suffix}").exists():
        number += 1
    return folder / f"{stem}_{number}{suffix}"


def _write_report(path: Path, live: LiveModel, shape: Shape) -> tuple[Path, ...]:
    words = live.words(shape.design)
    pulled = f"{len(shape.design.pulls)} control points pulled" if shape.design.pulls else ""
    said = ", ".join(filter(None, (words, pulled))) or ("as fitted" if live.is_baseline(shape.design) else "moved")
    write_report(path, model_of(live, shape), title=f"{Path(live.model.header.source).name}: {said}")
    return (path,)


def _write_model(path: Path, live: LiveModel, shape: Shape) -> tuple[Path, ...]:
    model_of(live, shape).save(path)
    return (path,)


def _write_cad(path: Path, live: LiveModel, shape: Shape) -> tuple[Path, ...]:
    write_cad(path, live.model, shape.control_points)
    return (path,)


def _write_points(path: Path, live: LiveModel, shape: Shape) -> tuple[Path, ...]:
    points = shape.control_points[live.mesh.surface_ids]
    with replaced_file(path) as part:
        np.savetxt(part, points, fmt="%.17g", delimiter=",", header="x,y,z")
    return (path,)


def _write_study(path: Path, live: LiveModel, shape: Shape) -> tuple[Path, ...]:
    if live.study is not None:
        if shape.design.pulls:
            raise InputError("pulled control points are not variables of the study; undo the pulls")
        text = live.study.text(shape.design.values, path.parent)
        with replaced_file(path) as part:
            part.write_text(text, encoding="utf-8")
        return (path,)
    model = model_of(live, shape)
    file = path.with_suffix(MODEL)
    if file.exists():
        raise InputError(f"{file}: is there already; give the study another name")
    text = study_draft(file.name, None, GridBody(model.regenerate(), model.topology))
    model.save(file)
    with replaced_file(path) as part:
        part.write_text(text, encoding="utf-8")
    return path, file


def _write_grid(path: Path, live: LiveModel, shape: Shape) -> tuple[Path, ...]:
    grid = live.model.header.grid(live.model.topology.shapes, shape.nodes)
    write_grid(path, grid, live.model.topology)
    return (path,)


WRITERS: dict[str, Callable[[Path, LiveModel, Shape], tuple[Path, ...]]] = {
    ".html": _write_report,
    MODEL: _write_model,
    ".csv": _write_points,
    ".toml": _write_study,
    **dict.fromkeys(SUFFIXES, _write_cad),
}
"""Writers of a shape by suffix; all others are grids."""
