"""Failures of one rank reach all; what only one could raise would leave the others waiting."""

import numpy as np
from mpi4py import MPI

from bspline_mdao.base.numerics.processes import on_first, summed, together, world
from bspline_mdao.errors import InputError

comm = world()
assert comm is MPI.COMM_WORLD


class Unsendable(Exception):
    """One whose arguments do not make it again."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def raised(task):
    """What all ranks raise: kind and words."""
    try:
        task()
    except Exception as error:
        return type(error).__name__, str(error)
    return None


def failing(ranks, kind=InputError):
    """A task that fails on some ranks."""

    def task():
        with together(comm):
            if comm.rank in ranks:
                raise kind(f"rank {comm.rank}") if kind is not Unsendable else kind("this", "that")

    return task


last = comm.size - 1
assert raised(failing([])) is None
assert raised(failing([0])) == ("InputError", "rank 0")
assert raised(failing([last])) == ("InputError", f"rank {last}")
assert raised(failing(range(1, comm.size))) == ("InputError", "rank 1")
kind = "Unsendable" if comm.rank == last else "RuntimeError"
assert raised(failing([last], Unsendable))[0] == kind
assert "this and that" in raised(failing([last], Unsendable))[1]


def nested(rank):
    """One within another, of which one rank does not come to the inner one."""
    with together(comm):
        if comm.rank == rank:
            raise InputError(f"rank {rank}, outer")
        with together(comm):
            raise InputError(f"rank {comm.rank}, inner")


assert raised(lambda: nested(0)) == ("InputError", "rank 0, outer")
assert raised(lambda: nested(last)) == ("InputError", "rank 0, inner")
assert raised(failing([0])) == ("InputError", "rank 0")


def on_first_alone():
    """A task that must not run elsewhere."""
    assert comm.rank == 0
    return {"n": 3}


assert on_first(comm, on_first_alone) == {"n": 3}
assert raised(lambda: on_first(comm, lambda: 1 / 0)) == ("ZeroDivisionError", "division by zero")
total = summed(comm, np.array([1.0, comm.rank]))
assert total.tolist() == [comm.size, comm.size * (comm.size - 1) / 2]
parts = comm.allgather(summed(comm, np.random.default_rng(comm.rank).random(1001)).tobytes())
assert len(set(parts)) == 1
print("done", comm.rank)
