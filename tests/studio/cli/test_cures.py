"""What a refused move names as a cure was tried, and is not in use already."""

from dataclasses import fields
from itertools import product

import pytest
from mover_cases import flare_grid, mesh_of

from bspline_mdao import InputError, find_topology
from bspline_mdao.studio.cli.cures import MANY, Trial, proposals, try_cures, verdict
from bspline_mdao.studio.cli.move import MoveOptions
from bspline_mdao.studio.cli.movers import MoverOptions

GRID = flare_grid((4, 4, 4), swirl=0.3)
TOPOLOGY = find_topology(GRID)
BESIDE = ("wall", "cone", "side 2", "symmetry")
MOVER_OPTIONS = [
    MoverOptions(mover, increments, comoving=comoving)
    for mover, increments, comoving in product(("rotations", "elasticity", "idw"), (None, 2, MANY, 20), (False, True))
    if mover != "rotations" or increments is None
]


def proposed(options, beside=BESIDE):
    mesh = mesh_of(GRID, fixed=options.fix, released=options.release, sliding=options.slide)
    return dict(proposals(options, TOPOLOGY, mesh, beside))


@pytest.mark.parametrize("mover", MOVER_OPTIONS, ids=str)
@pytest.mark.parametrize("patches", [{}, {"release": ("side*",)}, {"fix": ("c*", "farfield")}], ids=str)
def test_nothing_in_use_is_proposed(mover, patches):
    options = MoveOptions(("twist=1deg",), mover=mover, **patches)
    found = proposed(options)
    assert options not in found.values()
    assert f"--mover {mover.mover}" not in found
    assert ("--comoving" in found) != mover.comoving
    if mover.mover == "elasticity":
        assert (f"--increments {MANY}" in found) == ((mover.increments or 0) < MANY)
    assert not ("release" in patches and any("--release side" in text for text in found))


def test_what_is_typed_is_what_was_tried():
    options = MoveOptions(("twist=1deg",), fix=("c*",), mover=MoverOptions("elasticity", 2, nu=0.1))
    found = proposed(options)
    assert list(found) == [
        "--release side 2 no --fix c*",
        "--comoving",
        f"--increments {MANY}",
        "--mover rotations no --increments no --nu",
    ]
    boundary, comoving, many, rotations = found.values()
    assert (boundary.release, boundary.fix, boundary.slide) == (("side 2",), (), ())
    assert comoving.mover == MoverOptions("elasticity", 2, nu=0.1, comoving=True)
    assert many.mover == MoverOptions("elasticity", MANY, nu=0.1)
    assert rotations.mover == MoverOptions()
    assert all(getattr(many, f.name) == getattr(options, f.name) for f in fields(options) if f.name != "mover")


def test_faces_that_follow_already_and_the_design_surface_are_left_alone():
    assert next(iter(proposed(MoveOptions(("twist=1deg",))))) == "--release side 2"
    assert "--comoving" in next(iter(proposed(MoveOptions(("twist=1deg",)), beside=("cone", "wall", "symmetry"))))


def test_a_wall_that_is_not_deformed_is_tried_sliding():
    found = proposed(MoveOptions(("twist=1deg",), design=("cone",)), beside=("wall",))
    assert next(iter(found)) == "--slide wall"


def test_trials_end_with_the_first_that_inverts_no_cell():
    options, counts = MoveOptions(("twist=1deg",)), {"--release side 2": 12, "--comoving": 0}
    found = proposed(options)

    def count(other):
        return counts[next(text for text, changed in found.items() if changed == other)]

    trials = try_cures(options, TOPOLOGY, mesh_of(GRID), BESIDE, count)
    assert {trial.text: trial.n_inverted for trial in trials} == counts
    assert verdict(trials) == "tried, and no cell is inverted: --comoving; tried in vain: --release side 2 (12 cells)"


def test_each_trial_is_printed_before_it_runs(capsys):
    def count(other):
        assert capsys.readouterr().out.endswith("the move inverts cells; trying --comoving\n") == other.mover.comoving
        return 0 if other.mover.comoving else 1

    try_cures(MoveOptions(("twist=1deg",)), TOPOLOGY, mesh_of(GRID), BESIDE, count)


def test_where_nothing_helps_a_move_says_so_with_what_was_tried():
    def count(other):
        if other.release:
            raise InputError("refused")
        return 1

    trials = try_cures(MoveOptions(("twist=1deg",)), TOPOLOGY, mesh_of(GRID), BESIDE, count)
    assert verdict(trials) == (
        "nothing that was tried helps: --release side 2 (refused), --comoving (1 cell), "
        "--mover elasticity --increments 10 (1 cell); deform it less"
    )
    assert verdict([]) == "deform it less"
    assert str(Trial("--comoving", 1234)) == "--comoving (1,234 cells)"
