"""One optimizer for a model on several processes: the first process decides, and all run the model on its request.

With an optimizer on every process, all would have to decide the same, although times differ, and round-off may.

Theory: ``docs/parallel.rst``.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from ....base.numerics.processes import from_first, together
from .scaled_model import ScaledModel

__all__ = ["BroadcastModel", "run_broadcast"]


class BroadcastModel:
    """A model on several processes, driven by the first: every call is made on all."""

    def __init__(
        self,
        model: ScaledModel,  # the model
        comm: Any,  # its processes
    ):
        self._model, self._comm = model, comm

    def start(self) -> tuple[np.ndarray, float, np.ndarray]:
        """Run at the present design variables, see `ScaledModel.start`."""
        return self._lead("start")

    def run(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Run at a point (n,), see `ScaledModel.run`."""
        return self._lead("run", x)

    def keep(self) -> None:
        """Store the states of the last run, see `ScaledModel.keep`."""
        self._lead("keep")

    def restore(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Run at the point (n,) whose states were stored, see `ScaledModel.restore`."""
        return self._lead("restore", x)

    def differentiate(self) -> np.ndarray:
        """Totals (1 + m, n), see `ScaledModel.differentiate`."""
        return self._lead("differentiate")

    def place(self, x: np.ndarray) -> None:
        """Set the design variables (n,), see `ScaledModel.place`."""
        self._lead("place", x)

    def follow(self) -> None:
        """Repeat the first process's calls on another process until it ends."""
        while True:
            name, arguments = self._comm.bcast(None, root=0)
            if name == END:
                return
            with suppress(Exception):  # the first process gets it as well, and decides
                self._do(name, *arguments)

    def end(self) -> None:
        """Release the other processes."""
        self._comm.bcast((END, ()), root=0)

    def _lead(self, name: str, *arguments: Any) -> Any:
        self._comm.bcast((name, arguments), root=0)
        return self._do(name, *arguments)

    def _do(self, name: str, *arguments: Any) -> Any:
        """Result of a method of the model; raises whatever any process raised."""
        result = failure = None
        try:
            result = getattr(self._model, name)(*arguments)
        except Exception as error:
            failure = error
        with together(self._comm):
            if failure is not None:
                raise failure
        return result


END = "end"
"""Message of the first process when it is done."""


def run_broadcast(
    comm: Any,  # the processes of the model
    model: ScaledModel,  # the model
    task: Callable[[Any], Any],  # takes the model
) -> Any:  # what the task returned, on all processes; all raise what it raises
    """Result of a task that the first process runs with the model of all processes."""
    if comm.size == 1:
        return task(model)
    everywhere = BroadcastModel(model, comm)
    result = failure = None
    if comm.rank > 0:
        everywhere.follow()
    else:
        try:
            result = task(everywhere)
        except Exception as error:
            failure = error
        finally:
            everywhere.end()
    with together(comm):
        if failure is not None:
            raise failure
    return from_first(comm, result)
