"""The part of a study's script that moves the grid, run on its own: its model and the effect of its variables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ...base.display import OneLine
from ...core.design.parametrization import Parametrization
from ...core.model.movable import Movable
from ...core.movement.comoving import ComovingFrame
from ...core.om.design_surface import DesignSurface
from ...errors import InputError
from .layout import python_text
from .run_script import run_script
from .script import Part, StudyScript
from .script_shape import shape_part
from .study import Study
from .syntax import statement
from .variable_kinds import VARIABLES

__all__ = ["StudiedShape", "shape_alone"]

_HEAD = '"""The shape of a study."""\n\nfrom pathlib import Path\n\nimport numpy as np\n\nimport bspline_mdao as bm\n'


def shape_alone(study: Study) -> Study:
    """Remove everything from a study but its variables that move the grid, and its measures."""
    moving = {name: table for name, table in study.variables.items() if VARIABLES[table["kind"]].made_by}
    objective = study.objective | {"of": next(iter(study.measures), "")}
    return replace(study, flow=None, conditions={}, variables=moving, constraints={}, objective=objective)


@dataclass(frozen=True, eq=False)
class StudiedShape(OneLine):
    """The grid model, variables and mover that the script of a study makes."""

    study: Study
    model: Movable
    wing: DesignSurface
    parametrization: Parametrization
    mover: Any  # the study's own; None for the default one

    @classmethod
    def of(cls, study: Study) -> StudiedShape:
        """Run the part of its script that makes model, variables and mover."""
        if study.junction is not None:
            raise InputError(f"{study.source}: has a [junction], whose walls are moved by nodes; see optimize")
        if not any(VARIABLES[table["kind"]].made_by for table in study.variables.values()):
            raise InputError(f"{study.source}: no variable moves the grid")
        is_plane = study.kind.is_plane(study.grid["file"], study.source.parent)
        script = python_text(
            _ShapeScript(shape_alone(replace(study, measures={})), study.source.parent, None, is_plane).parts()
        )
        file = study.source.resolve().parent / "shape.py"
        made: dict[str, Any] = {}
        run_script(study, script, file, made)
        options = made["shape"].options
        mover = options["mover"]
        mover = ComovingFrame(mover) if options["comoving"] else mover
        return cls(study, made["model"], made["wing"], options["parametrization"], mover)


class _ShapeScript(StudyScript):
    """Makes the parts of the script."""

    def parts(self) -> Part:
        """All parts."""
        yield _HEAD
        yield statement("HERE = Path(__file__).resolve().parent")
        yield from self._model()
        yield from shape_part(self.study, self._path, is_judged=False)
