"""The chain on one rank and on two: CPU time and peak memory of every rank, bytes sent, a model of large cases.

The wing of `bench_evaluation.py` with 1.16 million nodes in 12 blocks; with ``--large`` a member of its family with 10
million. `mpirun` is started here, once for each number of ranks; on every rank the components are called as OpenMDAO
calls them. CPU seconds are of the fastest of some runs, without what a rank spends in calls of the communicator, where
it waits for the others, which is listed separately. Peak memory is the high-water mark of the process in each stage.
Bytes are what a rank passes to the communicator.

The model on paper, ``--paper``, takes bytes per node, per node of the boundary and per control point from the arrays
that are found in the components, and says what each of many ranks would hold. ``--largest`` takes a wing of 20 million
nodes from the generator to the report on its cells.
"""

from __future__ import annotations

import argparse
import json
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # what benchmarks of several layers use
from mpi_ranks import start_ranks

from bspline_mdao import fit_grid
from bspline_mdao.base.numerics.processes import on_first, world
from bspline_mdao.generators import onera_m6_grid

SHAPE, N_CONTROL = (45, 65, 33), (13, 13, 9)
LARGE = 2.08
"""Cells in each direction of the member with 10 million nodes, divided by those of the wing."""

N_BLOCKS = 12
"""Blocks of all wings here."""

LARGEST = (113, 161, 93), (19, 19, 13)
"""Nodes and control points of a block of the wing with 20 million nodes."""

AGGREGATES = ("quality_ks", "corner_ks", "volume_ks", "height_low_ks")


def main(shape=SHAPE, n_control=N_CONTROL, factor: float = 1.0, ranks=(1, 2), repeats: int = 3) -> dict:
    """Measure all stages on some numbers of ranks.

    Parameters
    ----------
    shape, n_control : tuple of three int
        Nodes and control points of each of the 12 blocks of the wing.
    factor : float
        Cells in each direction of the member of its family that is evaluated, divided by those of the wing.
    ranks : sequence of int
        Numbers of ranks.
    repeats : int
        Runs of each stage but reading and setup.

    Returns
    -------
    dict
        ``n_nodes``, ``n_control_points``, and for each number of ranks what every rank has measured.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "wing.h5"
        made = subprocess.run(
            [sys.executable, __file__, "--make", str(path), "--shape", *map(str, shape), "--factor", str(factor)]
            + ["--n-control", *map(str, n_control)],
            check=True,
            capture_output=True,
            text=True,
        )
        runs = {n: start_ranks(n, ["--rank", str(path), "--repeats", str(repeats)], __file__) for n in ranks}
    return {**json.loads(made.stdout), "ranks": runs}


def make_model(path: Path, shape, n_control, factor: float) -> dict:
    """Fit the wing and save the member of its family, with a residual as large as that of a good fit."""
    model = fit_grid(onera_m6_grid(shape), n_control=n_control)
    if factor != 1.0:
        member = model.member(factor)
        residual = 1e-6 * np.sin(50.0 * member.regenerate().to_vector().reshape(-1, 3))
        model = replace(member, residual=residual)
    model.save(path, compress=False)
    return {"n_nodes": model.n_nodes, "n_control_points": model.mesh.n_control_points}


@dataclass
class Traffic:
    """What a rank passes to its communicator: bytes, calls, and the CPU seconds that pass in them."""

    n_bytes: int = 0
    n_calls: int = 0
    cpu: float = 0.0


TRAFFIC = Traffic()

BUFFERS = ("Allreduce", "Reduce", "Bcast", "Allgather", "Allgatherv", "Gather", "Gatherv", "Scatterv", "Send", "Isend")
OBJECTS = ("allreduce", "reduce", "bcast", "allgather", "gather", "scatter", "alltoall", "send", "isend")


def counted(comm):
    """The same communicator, whose calls are counted in `TRAFFIC`; one of a rank that is alone is left as it is."""
    if comm.size == 1:
        return comm
    from mpi4py import MPI

    def counting(name: str) -> Callable:
        call = getattr(MPI.Intracomm, name)

        def run(self, item, *arguments, **options):
            size = len(pickle.dumps(item)) if name in OBJECTS else _buffer_bytes(item)
            start = time.process_time()
            try:
                return call(self, item, *arguments, **options)
            finally:
                TRAFFIC.n_bytes, TRAFFIC.n_calls = TRAFFIC.n_bytes + size, TRAFFIC.n_calls + 1
                TRAFFIC.cpu += time.process_time() - start

        return run

    methods = {name: counting(name) for name in BUFFERS + OBJECTS}
    kind = type("Counted", (MPI.Intracomm,), {**methods, "__module__": MPI.__name__})  # by which petsc4py knows it
    return kind(comm)


def _buffer_bytes(item) -> int:
    """Bytes of a buffer as mpi4py takes it: an array, or a list that begins with one."""
    item = item[0] if isinstance(item, (list, tuple)) else item
    return getattr(item, "nbytes", 0)


@dataclass
class Stages:
    """Cost of every stage on this rank: CPU seconds, those in the communicator, bytes sent, peak memory."""

    repeats: int
    rows: dict[str, dict] = field(default_factory=dict)

    def measure(self, name: str, task: Callable, repeats: int | None = None):
        """Run a task some times, and return its last result."""
        reset_peak()
        best, result = np.inf, None
        for _ in range(repeats or self.repeats):
            before, start = replace(TRAFFIC), time.process_time()
            result = task()
            cpu, waits = time.process_time() - start, TRAFFIC.cpu - before.cpu
            if cpu - waits < best:
                best = cpu - waits
                sent = {"bytes": TRAFFIC.n_bytes - before.n_bytes, "calls": TRAFFIC.n_calls - before.n_calls}
                self.rows[name] = {"cpu": best, "waits": waits, **sent}
        self.rows[name]["peak"] = peak()
        return result


def reset_peak() -> None:
    """Begin a new high-water mark of the memory of this process."""
    Path("/proc/self/clear_refs").write_text("5")


def peak() -> int:
    """High-water mark of the memory of this process (B)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) * 1024


def run_rank(path: Path, repeats: int) -> dict:
    """Measure all stages on this rank."""
    import openmdao.api as om

    from bspline_mdao import ControlMeshMove, GridEvaluate, Quality
    from bspline_mdao.core.model.local_model import LocalModel
    from bspline_mdao.movers import LinearElasticity, moving_mesh

    comm, stages = counted(world()), Stages(repeats)
    reset_peak()
    empty = peak()
    model = stages.measure("read the model", lambda: LocalModel.load(path, comm), 1)
    mover = LinearElasticity(moving_mesh(model), n_increments=1)
    problem = om.Problem(reports=False, comm=comm)
    problem.model.add_subsystem("move", ControlMeshMove(mover=mover), promotes=["*"])
    problem.model.add_subsystem("evaluate", GridEvaluate(model=model), promotes=["*"])
    problem.model.add_subsystem("judge", Quality(model=model, aggregates=AGGREGATES), promotes=["*"])

    def set_up():
        problem.setup()
        problem.final_setup()

    stages.measure("set up", set_up, 1)
    stages.measure("first run, factors", problem.run_model, 1)
    names = ("control_points_initial", "surface_control_points", "control_points", "grid")
    values = {name: problem.get_val(name, get_remote=False).ravel().copy() for name in names}
    shift, n_runs = np.sin(values["surface_control_points"]), 0

    def design():
        nonlocal n_runs
        n_runs += 1
        return {**values, "surface_control_points": values["surface_control_points"] + 1e-5 * n_runs * shift}

    move, evaluate, judge = (getattr(problem.model, name) for name in ("move", "evaluate", "judge"))
    rng = np.random.default_rng(0)
    outputs = {"control_points": values["control_points"].copy(), "grid": values["grid"].copy()}
    outputs["control_corner_ks"] = np.zeros(1)
    at = design()
    stages.measure("move", lambda: move.compute(design(), outputs))
    stages.measure("move, adjoint", adjoint(move, at, "control_points", names[:2], rng))
    moved = outputs["control_points"] - values["control_points"]

    def moved_points():
        nonlocal n_runs
        n_runs += 1
        return {"control_points": values["control_points"] + (1.0 + 1e-3 * n_runs) * moved}

    stages.measure("evaluate", lambda: evaluate.compute(moved_points(), outputs))
    at = moved_points()
    evaluate.compute(at, outputs)
    stages.measure("evaluate, adjoint", adjoint(evaluate, at, "grid", names[2:3], rng))
    at, bounds = {"grid": outputs["grid"]}, {name: np.zeros(1) for name in AGGREGATES}
    stages.measure("judge", lambda: judge.compute(at, bounds))
    direction = {"grid": rng.standard_normal(values["grid"].size)}
    forward = {name: np.zeros(1) for name in AGGREGATES}
    stages.measure("judge, forward product", lambda: judge.compute_jacvec_product(at, direction, forward, "fwd"))
    seeds, bar = {name: np.ones(1) for name in AGGREGATES}, {"grid": np.zeros(values["grid"].size)}
    stages.measure("judge, adjoint", lambda: judge.compute_jacvec_product(at, bar, seeds, "rev"))
    stages.measure("judge, report", judge.report)
    held = {
        "model": model,
        "move": move,
        "evaluate": evaluate._map,
        "judge": judge._quality,
        "OpenMDAO": vectors(problem),
    }
    return {
        "rank": comm.rank,
        "n_nodes": model.subdomain.n_nodes,
        "empty": empty,
        "stages": stages.rows,
        "arrays": arrays_in(held),
    }


def run_largest(shape, n_control, folder: Path) -> dict:
    """Generate, write, fit, move, evaluate and judge a wing on all ranks; none holds all parameters or nodes later on.

    The first rank generates the grid and writes the file from which each rank reads the blocks that it fits. The first
    one moves the control mesh for all.
    """
    from bspline_mdao import open_grid, write_grid
    from bspline_mdao.grids.cells.grid_quality import GridQuality
    from bspline_mdao.grids.cells.pieces import Pieces
    from bspline_mdao.grids.cells.report import inverted_cells, report_quality
    from bspline_mdao.grids.topology.partition import Partition
    from bspline_mdao.movers import LinearElasticity, moving_mesh
    from bspline_mdao.splines import fit_blocks

    comm, stages, path = counted(world()), Stages(1), folder / "largest.cgns"
    stages.measure("generate", lambda: on_first(comm, lambda: write_grid(path, onera_m6_grid(shape))))
    blocks = stages.measure("fit", lambda: fit_blocks(open_grid(path, comm=comm), comm, n_control=n_control))
    stages.measure("write the model", partial(blocks.save, folder / "largest.h5", compress=False))
    model, report = stages.measure("take the local model", blocks.local_model), blocks.report
    del blocks
    mesh = moving_mesh(model)
    surface = mesh.points[mesh.surface_ids]
    angle = np.deg2rad(3.0) * surface[:, 2] / surface[:, 2].max()
    twisted = surface + np.column_stack([np.sin(angle) * surface[:, 1], -np.sin(angle) * surface[:, 0], 0.0 * angle])

    def move():
        return on_first(comm, lambda: LinearElasticity(mesh, n_increments=1).move(mesh.points, twisted).points)

    points = stages.measure("move", move)
    baseline = stages.measure("baseline", model.regenerate)
    nodes = stages.measure("evaluate", lambda: model.grid_map().at(points).nodes[: model.subdomain.n_nodes])
    partition = Partition.of(model.topology, comm.size)
    pieces = Pieces(partition, model.header.names, model.header.patches, model.header.source, comm)

    def judge():
        quality = GridQuality.of_pieces(pieces, baseline)
        newly = inverted_cells(quality, quality.cells_in_turn(nodes), newly=True)
        return report_quality(quality, baseline), report_quality(quality, nodes), len(newly)

    before, after, n_newly = stages.measure("judge", judge)
    return {
        "rank": comm.rank,
        "n_nodes_of_grid": model.topology.n_nodes,
        "n_control_points": model.mesh.n_control_points,
        "n_invalid_elements": report.n_invalid,
        "n_nodes": model.subdomain.n_nodes,
        "stages": stages.rows,
        "n_inverted": [before.n_inverted, after.n_inverted, n_newly],
        "q_min": [before.q_min, after.q_min],
        "heights": [[wall.ratio_p01, wall.ratio_p99] for wall in after.heights],
    }


PAPER = {"n_nodes": 200_000_000, "n_ranks": 500, "nodes_per_control_point": 300}
"""The case on paper, with a block for each rank."""

KINDS = (
    "nodes of the rank",
    "boundary of the grid",
    "nodes that blocks share",
    "control mesh",
    "factor of the control mesh, if one rank had it alone",
)
"""What arrays grow with: the first are distributed, the others but the last held by every rank."""


def paper(small: dict, large: dict, n_nodes: int, n_ranks: int, nodes_per_control_point: int) -> list[dict]:
    """Say what a rank would hold of a large case.

    Arrays that grow as the nodes from one measured grid to a larger one with the same control mesh are distributed;
    those that grow as the surface of the grid, or not at all, are held by every rank. The latter count as if they grew
    with the control points, which is an upper bound; factors grow with the power 4/3 of these.

    Parameters
    ----------
    small, large : dict
        What `main` gives for two members of a family, on the same number of ranks.
    n_nodes, n_ranks, nodes_per_control_point : int
        The large case.

    Returns
    -------
    list of dict
        ``array``, ``kind`` (one of `KINDS`), ``measured`` bytes and ``bytes`` on a rank of the large case.
    """
    first, last = (list(run["ranks"].values())[-1][0] for run in (small, large))
    before, after = (
        {name: n for owner, rows in rank["arrays"].items() for name, n in _by_name(owner, rows).items()}
        for rank in (first, last)
    )
    growth = np.log(last["n_nodes"] / first["n_nodes"])
    surfaces = (n_nodes / large["n_nodes"]) ** (2.0 / 3.0)
    control = n_nodes / nodes_per_control_point / large["n_control_points"]
    interfaces = surfaces * (n_ranks / N_BLOCKS) ** (1.0 / 3.0)
    factors = (n_nodes / n_ranks / last["n_nodes"], surfaces, interfaces, control, control ** (4.0 / 3.0))
    found = []
    for name, size in after.items():
        power = np.log(size / before[name]) / growth if before.get(name) else 1.0
        kind = _kind(name, power)
        found.append({"array": name, "kind": KINDS[kind], "measured": size, "bytes": size * factors[kind]})
    return sorted(found, key=lambda row: (KINDS.index(row["kind"]), -row["bytes"]))


def _kind(name: str, power: float) -> int:
    """Number among `KINDS` of an array that grows with a power of the number of nodes."""
    if name.startswith("move."):
        return 4 if any(part in name for part in (".factor", ".analysis.")) else 3
    if "_copies_of_grid" in name:
        return 2
    return 0 if power > 0.85 else 1 if power > 0.4 else 3


def _by_name(owner: str, rows: list) -> dict[str, int]:
    """Bytes of all arrays of one name together."""
    sizes: dict[str, int] = {}
    for name, _, size in rows:
        sizes[name] = sizes.get(name, 0) + size
    return sizes


def show_paper(rows: list[dict], n_on_rank: int, n_nodes: int, n_ranks: int, nodes_per_control_point: int) -> None:
    """Print what a rank would hold, kind by kind, array by array from 1 MB on."""
    subdomain, n_control = n_nodes // n_ranks, n_nodes // nodes_per_control_point
    print(f"{n_nodes:,} nodes on {n_ranks} ranks, {subdomain:,} on each; {n_control:,} control points")
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind]
        total = sum(row["bytes"] for row in own)
        per_node = f", {total / subdomain:.0f} B a node" if kind == KINDS[0] else ""
        print(f"{kind}: {total / 1e6:,.1f} MB on a rank{per_node}")
        for row in own:
            if row["bytes"] >= 1e6:
                each = f"{row['measured'] / n_on_rank:7.1f} B a node" if kind == KINDS[0] else ""
                print(f"  {row['bytes'] / 1e6:10.1f} MB  {row['array']:64}{each}")
        print(f"  {sum(row['bytes'] for row in own if row['bytes'] < 1e6) / 1e6:10.1f} MB  arrays of less than 1 MB")


def adjoint(component, at: dict, of: str, wrt, rng) -> Callable:
    """A reverse product of a component with a random seed."""
    seed = {of: rng.standard_normal(np.size(at.get(of, ())) or component._outputs[of].size)}

    def run():
        bars = {name: np.zeros_like(at[name]) for name in wrt}
        component.compute_jacvec_product(at, bars, seed, "rev")
        return bars

    return run


def vectors(problem) -> list[np.ndarray]:
    """Vectors that OpenMDAO holds for values and derivatives."""
    return [vector.asarray() for kind in problem.model._vectors.values() for vector in kind.values()]


def arrays_in(held: dict) -> dict[str, list]:
    """Bytes of the arrays that objects hold, each memory once: owner to ``[[name, shape, bytes], ...]``."""
    seen: set = set()
    return {owner: _arrays(item, owner, seen) for owner, item in held.items()}


def _arrays(item, name: str, seen: set) -> list:
    if id(item) in seen or isinstance(item, (str, bytes, int, float, type)) or item is None:
        return []
    seen.add(id(item))
    if isinstance(item, np.ndarray):
        while isinstance(item.base, np.ndarray):
            item = item.base
        is_new = item.__array_interface__["data"] not in seen
        seen.add(item.__array_interface__["data"])
        return [[name, list(item.shape), item.nbytes]] if is_new else []
    if isinstance(item, dict):
        parts = item.items()
    elif isinstance(item, (list, tuple, set, frozenset)):
        parts = (("", part) for part in item)
    elif type(item).__module__.startswith(("bspline_mdao", "scipy")):
        parts = getattr(item, "__dict__", {}).items()
    else:
        return []
    return [row for key, part in list(parts) for row in _arrays(part, f"{name}.{key}" if key else name, seen)]


def show(numbers: dict) -> None:
    """Print the cost of every stage on one rank and on more."""
    runs = {int(n): ranks for n, ranks in numbers["ranks"].items()}
    print(f"{numbers['n_nodes']:,} nodes, {numbers['n_control_points']:,} control points")
    head = "".join(f"   {f'{n} rank' + 's' * (n > 1):>26}" for n in runs)
    print(f"{'':24}{head}{'ratio of':>19}{'bytes sent':>14}")
    print(f"{'':24}" + f"   {'CPU s':>9}{'waits':>8}{'GB':>9}" * len(runs) + f"{'CPU':>11}{'GB':>8}{'by a rank':>14}")
    first, last = (list(runs.values())[at] for at in (0, -1))
    for stage in first[0]["stages"]:
        line = f"{stage:24}"
        for ranks in runs.values():
            rows = [rank["stages"][stage] for rank in ranks]
            line += f"   {most(rows, 'cpu'):9.4f}{most(rows, 'waits'):8.3f}{most(rows, 'peak') / 1e9:9.3f}"
        one, many = ([rank["stages"][stage] for rank in ranks] for ranks in (first, last))
        ratios = (most(many, key) / max(most(one, key), 1e-9) for key in ("cpu", "peak"))
        print(line + "{:11.2f}{:8.2f}".format(*ratios) + f"{most(many, 'bytes'):14,}")


def show_largest(ranks: list[dict]) -> None:
    """Print the cost of every stage of the largest case on every rank."""
    first, n = ranks[0], len(ranks)
    print(f"{first['n_nodes_of_grid']:,} nodes, {first['n_control_points']:,} control points, {n} ranks")
    print(
        f"{'':24}"
        + "".join(f"{f'rank {rank}: CPU s':>20}{'waits':>8}{'GB':>8}" for rank in range(n))
        + f"{'GB in all':>12}"
    )
    for stage in first["stages"]:
        rows = [rank["stages"][stage] for rank in ranks]
        line = "".join(f"{row['cpu']:20.1f}{row['waits']:8.1f}{row['peak'] / 1e9:8.2f}" for row in rows)
        print(f"{stage:24}{line}{sum(row['peak'] for row in rows) / 1e9:12.2f}")
    before, after, newly = first["n_inverted"]
    print(
        f"{first['n_invalid_elements']:,} invalid elements; {before:,} inverted cells before and {after:,} after, at "
        f"least {newly} of them valid before; smallest Q {first['q_min'][0]:.2e} and {first['q_min'][1]:.2e}"
    )


def most(rows: list[dict], key: str) -> float:
    """Largest number of all ranks."""
    return max(row[key] for row in rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shape", nargs=3, type=int, default=SHAPE, metavar="N", help="nodes of a block of the wing")
    parser.add_argument("--n-control", nargs=3, type=int, default=N_CONTROL, metavar="N", help="its control points")
    parser.add_argument("--factor", type=float, default=1.0, help="cells in each direction of the member, by those")
    parser.add_argument("--large", action="store_true", help=f"a member with 10 million nodes: --factor {LARGE}")
    parser.add_argument("--largest", action="store_true", help="the case of 20 million nodes, from generator to judge")
    parser.add_argument("--paper", action="store_true", help="what each of 500 ranks would hold of 200 million nodes")
    parser.add_argument("--ranks", nargs="+", type=int, default=(1, 2), help="numbers of ranks")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each stage")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    parser.add_argument("--make", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--rank", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.make:
        print(json.dumps(make_model(options.make, options.shape, options.n_control, options.factor)))
        sys.exit()
    if options.rank:
        is_case = options.rank.is_dir()
        case = options.shape, options.n_control
        told = run_largest(*case, options.rank) if is_case else run_rank(options.rank, options.repeats)
        every = [told] if world().size == 1 else world().gather(told)
        if told["rank"] == 0:
            options.json.write_text(json.dumps(every))
        sys.exit()
    if options.paper:
        runs = [main(factor=factor, ranks=options.ranks[-1:], repeats=1) for factor in (0.5, 1.0)]
        rows = paper(*runs, **PAPER)
        show_paper(rows, next(iter(runs[1]["ranks"].values()))[0]["n_nodes"], **PAPER)
        if options.json:
            options.json.write_text(json.dumps(rows, indent=2) + "\n")
        sys.exit()
    if options.largest:
        shape, n_control = LARGEST if options.shape == SHAPE else (options.shape, options.n_control)
        with tempfile.TemporaryDirectory() as place:
            sizes = ["--shape", *map(str, shape), "--n-control", *map(str, n_control)]
            result = start_ranks(options.ranks[-1], ["--rank", place, *sizes], __file__)
        show_largest(result)
        if options.json:
            options.json.write_text(json.dumps(result, indent=2) + "\n")
        sys.exit()
    factor = LARGE if options.large else options.factor
    result = main(options.shape, options.n_control, factor, options.ranks, options.repeats)
    show(result)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
