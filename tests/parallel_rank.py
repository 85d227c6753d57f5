"""One rank of scripts under MPI: ``parallel_rank.py folder n_ranks``.

It waits for orders, one line of JSON each: a script and its arguments, the time limit (s) and the file for what it
prints, and answers each with one line. What scripts import stays, so that one start serves many of them. A rank that
raises ends all of them, where it would otherwise wait for them in the end of MPI. One that is there after the limit, or
is ended from outside, shows where it stands.
"""

import faulthandler
import json
import os
import runpy
import signal
import sys
import traceback
from pathlib import Path


def follow(comm, words: list[str], limit: float, printed: str) -> None:
    """Run a script with its arguments, and have what it prints in a file of this rank."""
    own_file = os.open(printed, os.O_WRONLY | os.O_CREAT)
    os.dup2(own_file, 1)
    os.dup2(own_file, 2)
    os.close(own_file)
    sys.argv = words
    faulthandler.dump_traceback_later(limit, exit=True)
    try:
        runpy.run_path(words[0], run_name="__main__")
    except Exception:
        traceback.print_exc()
        sys.stdout.flush()
        comm.Abort(1)
    faulthandler.cancel_dump_traceback_later()
    sys.stdout.flush()
    sys.stderr.flush()


def main(folder: Path, n_ranks: int) -> None:
    """Follow orders until there are no more."""
    faulthandler.register(signal.SIGTERM, all_threads=False, chain=True)

    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    if comm.size != n_ranks:
        sys.exit(f"mpirun is of another MPI than mpi4py ({MPI.Get_library_version()}): every rank is alone")
    with (folder / f"orders{comm.rank}").open() as orders, (folder / "answers").open("w") as answers:
        for order in orders:
            follow(comm, *json.loads(order))
            print(comm.rank, file=answers, flush=True)


if __name__ == "__main__":
    here = Path(__file__).parent
    sys.path[0:1] = [str(here / "parallel" / "cases"), str(here)]
    main(Path(sys.argv[1]), int(sys.argv[2]))
