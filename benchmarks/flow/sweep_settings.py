"""What each setting of Newton's method and each start brings: flows found, and work, with settings halved and doubled.

Flows are those of ``bench_flow_grids.py 4 --random N``: the same random Mach numbers and angles about every fourth node
of each of some grids. Work is the products with the Jacobian and ten for a factor, by the cells of the grid, coarser
members included; it does not depend on what else the machine does::

    python benchmarks/flow/sweep_settings.py [N [NAME...]] [--grids GRID...] [--only]

All settings are swept, or those that are named; with ``--only`` none, and only the defaults are solved. Work is
compared over the flows that are found both with the defaults and with the setting. A change by 2 to 3 %, or of a flow,
may come from rounding alone: the row ``rounding`` changes a first CFL number by a millionth.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from bench_flow_grids import CASES, SEED, thinned

from bspline_mdao.flow.euler import newton
from bspline_mdao.flow.euler.cold_start import cold_solutions
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.residual import SHOCK_THRESHOLD
from bspline_mdao.flow.euler.sequencing import CoarseLevel, coarse_levels, useful_levels
from bspline_mdao.flow.euler.settings import STARTS, StartSettings
from bspline_mdao.flow.loads.stream import RADIAN
from bspline_mdao.flow.om.euler_state import LARGEST_RESIDUAL
from bspline_mdao.grids.topology.detection import find_topology

GRIDS = ("pyhyp", "mach", "cfl3d", "rae")
"""Parts of the names of grids about which flows are hard to find."""

FACTOR = 10.0
"""Products that take as long as a factor."""


@dataclass
class Work:
    """Products and factors, times the cells they are of, since the last look."""

    done: float = 0.0

    def taken(self) -> float:
        """Return the work since the last look."""
        done, self.done = self.done, 0.0
        return done

    def count(self) -> None:
        """Have all linear solves and factors of Newton steps counted."""
        solve, factor = newton.solve_roughly, newton.compact_factor

        def counted_solve(product, precondition, right, *rest):
            solution = solve(product, precondition, right, *rest)
            self.done += solution.n_products * len(right)
            return solution

        def counted_factor(linearization, pattern, diagonal):
            self.done += FACTOR * len(diagonal)
            return factor(linearization, pattern, diagonal)

        newton.solve_roughly, newton.compact_factor = counted_solve, counted_factor


@dataclass(frozen=True)
class Place:
    """A grid to solve on."""

    name: str
    flow: FlowGrid
    levels: list[CoarseLevel]
    nodes: np.ndarray


@dataclass(frozen=True)
class End:
    """How the search for a flow ended: the number of the start that found it, or None, and its work by cells."""

    start: int | None
    work: float


def main(n: int, names: list[str], grids: list[str], is_only: bool) -> None:
    """Print a row for each setting that is swept."""
    places, work = list(_places(grids)), Work()
    work.count()
    for place in places:
        _fly(place, 0.5, 1.0, work, STARTS, 1)  # compiles
    base = _fly_all(places, n, work, STARTS)
    _print_row("defaults", base, base)
    if is_only:
        return
    for label, settings, n_starts in _variants(names):
        _print_row(label, _fly_all(places, n, work, settings, n_starts), base)


def _variants(names: list[str]) -> Iterator[tuple[str, StartSettings, int]]:
    """Settings that differ from the defaults in one, or in starts, with a label and the most starts to take."""
    steps = STARTS.newton
    yield "rounding", replace(STARTS, newton=replace(steps, first_long_cfl=steps.first_long_cfl * (1.0 + 1e-6))), 2
    if not names:
        yield "first start alone", STARTS, 1
    for owner in (steps, STARTS):
        for field in fields(owner):
            value = getattr(owner, field.name)
            if field.name == "newton" or (names and field.name not in names):
                continue
            for factor in (0.5, 2.0):
                changed = replace(owner, **{field.name: type(value)(factor * value)})
                settings = changed if owner is STARTS else replace(STARTS, newton=changed)
                yield f"{field.name} {factor * value:g}", settings, 2


def _places(grids: list[str]) -> Iterator[Place]:
    """Grids whose names have one of these parts, with every fourth node."""
    for name, case in CASES.items():
        if not any(part in name for part in grids):
            continue
        grid = thinned(case.grid(), 4 if case.is_thinned else 1)
        topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
        flow = FlowGrid.of(topology, nodes, case.axes, shock_threshold=SHOCK_THRESHOLD)
        levels = coarse_levels(topology, nodes, useful_levels(topology), case.axes, shock_threshold=SHOCK_THRESHOLD)
        yield Place(name, flow, levels, nodes)


def _fly_all(places: list[Place], n: int, work: Work, settings: StartSettings, n_starts: int = 2) -> list[End]:
    random, start = np.random.default_rng(SEED), time.process_time()
    conditions = [random.uniform((0.3, -2.0), (0.85, 6.0)) for _ in range(n)]
    ends = [_fly(place, *one, work, settings, n_starts) for place in places for one in conditions]
    print(f"{time.process_time() - start:7.1f} s", end="")
    return ends


def _fly(place: Place, mach: float, alpha: float, work: Work, settings: StartSettings, n_starts: int) -> End:
    stream, n_cells = free_stream(mach, RADIAN * alpha, place.flow.axes), place.flow.faces.n_cells
    areas, found = place.flow.areas(place.nodes), None
    work.taken()
    solutions = cold_solutions(place.flow, place.levels, place.nodes, areas, stream, settings=settings)
    for start, solution in zip(range(n_starts), solutions):
        if solution.residual <= LARGEST_RESIDUAL:
            found = start
            break
    return End(found, work.taken() / n_cells)


def _print_row(label: str, ends: list[End], base: list[End]) -> None:
    """Print the flows that were found, in all and by each start, and the work beside that of the defaults."""
    by_start = [sum(end.start == start for end in ends) for start in range(2)]
    pairs = [(end.work, was.work) for end, was in zip(ends, base) if None not in (end.start, was.start)]
    change = 100.0 * (sum(new for new, _ in pairs) / sum(old for _, old in pairs) - 1.0) if pairs else np.nan
    lost, won = (
        [k for k, (a, b) in enumerate(zip(one, other)) if a.start is None and b.start is not None]
        for one, other in ((ends, base), (base, ends))
    )
    print(
        f"  {label:24} found {sum(by_start):3} of {len(ends)}, by start {by_start}, "
        f"work {sum(e.work for e in ends):8.0f}, of those found twice {change:+5.1f} %, lost {lost}, won {won}",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", nargs="?", type=int, default=10)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--grids", nargs="+", default=list(GRIDS))
    parser.add_argument("--only", action="store_true", dest="is_only")
    given = parser.parse_args()
    main(given.n, given.names, given.grids, given.is_only)
