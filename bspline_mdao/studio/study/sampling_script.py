"""A study as a Python script that samples it: the grids of many designs, with or without its flow."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .layout import python_text
from .responses import Response
from .script import Part, StudyScript, design_var, done
from .script_shape import shape_part
from .shape_script import shape_alone
from .study import Study
from .syntax import call, expression, statement

__all__ = ["DESIGNS", "PLANS", "SAMPLING_SCRIPT", "Sampling", "sampling_script"]

SAMPLING_SCRIPT, DESIGNS, MODEL = "sample.py", "designs.h5", "model.h5"
"""Names of files in the folder of the results."""

PLANS = {"sobol": "Sobol", "latin-hypercube": "LatinHypercube"}
"""Classes of plans by the words of the command."""

_HEAD = '''"""The designs that a study stands for.

Written and run by ``bspline-mdao sample``; run again, it continues with the missing designs.
"""

from pathlib import Path
'''

_IMPORTS = """import openmdao.api as om

import bspline_mdao as bm
"""


@dataclass(frozen=True)
class Sampling:
    """How a study is sampled."""

    n: int | None  # number of designs; None if a table gives them
    plan: str  # one of `PLANS`, or the file of a table
    seed: int
    has_flow: bool  # whether the flow of the study is solved
    store: str
    single: bool
    processes: int
    grids: bool  # whether every grid is written to a file of its own


def sampling_script(study: Study, folder: Path, sampling: Sampling, is_plane: bool = False) -> str:
    """Write the script that samples a study, with names of files relative to its folder."""
    if not sampling.has_flow:
        study = shape_alone(study)
    return python_text(_SamplingScript(study, folder, sampling, is_plane).parts())


class _SamplingScript(StudyScript):
    """Makes the parts of the script."""

    def __init__(self, study: Study, folder: Path, sampling: Sampling, is_plane: bool):
        super().__init__(study, folder, None, is_plane)
        self.sampling = sampling

    def parts(self) -> Part:
        """All parts."""
        yield _HEAD
        if any(table.get("where") for table in self.study.variables.values()):
            yield "import numpy as np"
        yield _IMPORTS
        yield statement("HERE = Path(__file__).resolve().parent")
        yield ""
        yield from self._model()
        yield ""
        yield from shape_part(self.study, self._path, self.sampling.has_flow)
        yield ""
        yield statement("problem = om.Problem(reports=None)")
        yield from self._subsystems()
        for name, table in self.study.variables.items():
            for each, part in self._inputs(name, table):
                settings = {key: value for key, value in design_var(part).items() if key != "ref"}
                yield done(call("top.add_design_var", each, **settings))
        yield done(call("problem.setup"))
        yield from self._values()
        yield ""
        yield statement(f'if not (HERE / "{MODEL}").exists():\n    model.save(HERE / "{MODEL}")')
        yield statement("designs = made", made=self._sample())
        if self.sampling.grids:
            name = self.study.written("before").replace("grid_before", "design_%05d")
            loop = (
                'for number, row in enumerate(designs.rows):\n    file = HERE / "grids" / (name % (row + 1))\n    write'
            )
            yield statement(loop, name=name, write=expression(self.study.kind.write_design))

    @property
    def _responses(self) -> list[Response]:
        return super()._responses if self.sampling.has_flow else []

    def _sample(self) -> ast.Call:
        """Call that samples."""
        sampling = self.sampling
        if sampling.plan in PLANS:
            seed = {"seed": sampling.seed} if sampling.seed else {}
            plan = call(f"bm.sampling.{PLANS[sampling.plan]}", sampling.n, **seed)
        else:
            plan = call("bm.sampling.Table", self._path(sampling.plan))
        named = self._outputs() + [response.output for response in self._responses]
        settings: dict[str, Any] = {"outputs": list(dict.fromkeys(named))} if named else {}
        settings |= {"store": sampling.store} if sampling.store != "nodes" else {}
        settings |= {"single": True} if sampling.single else {}
        settings |= {"processes": sampling.processes} if sampling.processes > 1 else {}
        file = expression("HERE / file", file=DESIGNS)
        given = expression("problem"), expression("model"), plan, file
        return call("bm.sampling.sample", *given, restart=True, **settings)
