"""The command ``sample``: it turns a study into a script, runs it, and summarises the designs on a card."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from ...base.numerics.stopwatch import working_seconds
from ...base.text import counted
from ...core.om.sampling.designs import Designs
from ...errors import InputError
from ...grids.io.disk import replaced_file
from ..study.reader import read_study
from ..study.run_script import run_script
from ..study.sampling_script import DESIGNS, PLANS, SAMPLING_SCRIPT, Sampling, sampling_script
from ..study.study import Study
from .output import check_outputs, print_lines, print_table, print_title, print_warnings, written_json

CARD = "card.md"
"""Name of the card in the folder of the results."""

MOST_REASONS = 5
"""Largest number of reasons for refusals on the card."""


def sample_study(
    study: Path,  # the study
    n: int | None,  # number of designs
    plan: str,  # one of `PLANS`, or a table
    seed: int,
    output: Path,  # folder for the results
    has_flow: bool,
    store: str,
    single: bool,
    grids: bool,
    processes: int,
    restart: bool,
    json: Path | None = None,  # numbers to write
) -> None:
    """Make the designs of a study, and show the results."""
    found = read_study(study)
    table = None if plan in PLANS else _table(plan)
    _check(found, n, table, has_flow, output, restart)
    check_outputs([*(output / name for name in (DESIGNS, SAMPLING_SCRIPT, CARD)), json], [study, table])
    where = plan if table is None else str(table.resolve())
    sampling = Sampling(n, where, seed, has_flow, "" if store == "nothing" else store, single, processes, grids)
    is_plane = found.kind.is_plane(found.grid["file"], found.source.parent)
    script = sampling_script(found, output, sampling, is_plane)
    output.mkdir(parents=True, exist_ok=True)
    with replaced_file(output / SAMPLING_SCRIPT) as part:
        part.write_text(script, encoding="utf-8")
    print_title(f"{study}: running {output / SAMPLING_SCRIPT}")
    began = working_seconds()
    run_script(found, script, (output / SAMPLING_SCRIPT).resolve(), {})
    designs, seconds = Designs(output / DESIGNS), working_seconds() - began
    with replaced_file(output / CARD) as part:
        part.write_text(_card(designs, study), encoding="utf-8")
    with written_json(json, _numbers(designs, study, output, seconds)):
        pass
    _show(designs, output, seconds)


def _table(plan: str) -> Path:
    """The file of a plan that is a table."""
    if not Path(plan).is_file():
        raise InputError(f"--plan {plan}: is no file, and none of {', '.join(PLANS)}; give one of these")
    return Path(plan)


def _check(study: Study, n: int | None, table: Path | None, has_flow: bool, output: Path, restart: bool) -> None:
    """Refuse options that contradict each other or the study, and a folder with other contents."""
    if (n is None) == (table is None):
        raise InputError(
            "give -n, the number of designs" if n is None else "a table says how many designs; leave -n out"
        )
    if has_flow and study.flow is None:
        raise InputError(f"{study.source}: has no [flow] to solve; leave --flow out")
    if has_flow:
        study.require_solver()
    if output.exists() and not output.is_dir():
        raise InputError(f"{output}: is a file; name a folder for the results")
    if output.is_dir() and any(output.iterdir()) and not restart:
        raise InputError(
            f"{output}: is not empty; give --restart to continue with the designs there, or another folder"
        )
    if restart and not (output / DESIGNS).exists():
        raise InputError(f"{output}: has no {DESIGNS} to continue with; leave out --restart")


def _reasons(designs: Designs) -> list[tuple[int, str]]:
    """Numbers of refused designs by the beginnings of the reasons: places differ from design to design."""
    return [(n, reason) for reason, n in Counter(designs.refused.values()).most_common(MOST_REASONS)]


def _card(designs: Designs, study: Path) -> str:
    """Description of the contents of a file of designs, for people who find it."""
    about, refused = designs.about, designs.refused
    lines = [
        f"# Designs of {study.name}",
        "",
        f"{counted(len(designs), 'design')} of {about['n_designs']:,}, {len(refused):,} refused; the plan is "
        f"{about['plan']}. Made of {about['source']} by {about['package']}.",
        "",
        "## What varies",
        "",
        "| value | from | to | unit |",
        "|---|---|---|---|",
        *(f"| {name} | {low:.6g} | {high:.6g} | {units} |" for name, (low, high, units) in designs.ranges.items()),
        "",
        "## Results",
        "",
        "| number | smallest | mean | largest |",
        "|---|---|---|---|",
    ]
    for name, values in {**designs.quality, **designs.outputs}.items():
        if values.size:
            lines.append(f"| {name} | {values.min():.6g} | {values.mean():.6g} | {values.max():.6g} |")
    if refused:
        lines += [
            "",
            "## What was refused",
            "",
            *(f"- {counted(n, 'design')}: {reason}" for n, reason in _reasons(designs)),
        ]
    lines += [
        "",
        "## How to read it",
        "",
        "    from bspline_mdao.sampling import Designs",
        "",
        f'    designs = Designs("{DESIGNS}")',
        "    values, nodes = designs[0]  # as torch.utils.data.DataLoader(designs) gives them, too",
        "",
    ]
    return "\n".join(lines)


def _numbers(designs: Designs, study: Path, output: Path, seconds: float) -> dict[str, Any]:
    """Collect the numbers for JSON."""
    return {
        "study": str(study),
        "folder": str(output),
        "plan": designs.about["plan"],
        "n_designs": designs.about["n_designs"],
        "n_made": len(designs),
        "refused": {str(row + 1): reason for row, reason in designs.refused.items()},
        "quality": {name: [float(of.min()), float(of.max())] for name, of in designs.quality.items() if of.size},
        "seconds": seconds,
    }


def _show(designs: Designs, output: Path, seconds: float) -> None:
    """Print the results."""
    rows = [
        (name, float(of.min()), float(of.max()))
        for name, of in {**designs.quality, **designs.outputs}.items()
        if of.size
    ]
    if rows:
        print_table(["of all designs", "smallest", "largest"], rows)
    print_warnings([f"{counted(n, 'design')} refused: {reason}" for n, reason in _reasons(designs)])
    n = designs.about["n_designs"]
    print_lines([f"{len(designs):,} of {counted(n, 'design')} made, {len(designs.refused):,} refused, {seconds:.1f} s"])
    print_lines([f"{output}: {', '.join(sorted(path.name for path in output.iterdir()))}"])
    if not len(designs):
        raise InputError(f"{output}: no design of the plan could be made; give narrower bounds")
