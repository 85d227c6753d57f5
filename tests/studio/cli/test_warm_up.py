"""The command ``warm-up`` compiles what usual commands need, once, in processes that do not disturb each other."""

import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from riding_cases import mesh, su2_text

from bspline_mdao import Grid, write_grid
from bspline_mdao.base.kernel_cache import kernel_folder
from bspline_mdao.base.shared_compilation import HAS_LOCKS
from bspline_mdao.errors import InputError
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids import Block
from bspline_mdao.studio.cli import warm_up, warm_up_worker
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.cli.warm_up_chains import EULER

KERNELS = """
from numba import njit

@njit(cache=True)
def twice(x):
    return 2 * x

@njit(cache=True)
def four_times(x):
    return twice(twice(x))
"""
COMPILE = """
import sys
from pathlib import Path
from bspline_mdao.base.shared_compilation import shared_compilation
from kernels import four_times
compiled = []
with shared_compilation(Path(sys.argv[1]), lambda index, signature, is_compiled: compiled.append(is_compiled)):
    assert (four_times(3), four_times(0.5)) == (12, 2.0)
print(sum(compiled))
"""


RUN = """
import sys
from pathlib import Path
from bspline_mdao.studio.cli import warm_up_worker
if len(sys.argv) > 1:
    warm_up_worker.run = lambda command: exec(Path(command[0]).read_text(), {})
commands = COMMANDS if len(sys.argv) == 1 else [sys.argv[1:]]
with open("told.txt", "w") as told:
    Path("locks").mkdir()
    sys.exit(warm_up_worker.run_chain(commands, Path("locks"), told))
"""
USUAL = (
    ("fit", "@onera_m6:17x15x11", "-o", "m6.h5"),
    ("move", "m6.h5", "--deform", "twist=3deg", "--deform", "bend=10deg@0.5", "-o", "moved.xyz"),
    ("quality", "moved.xyz", "--baseline", "m6.h5"),
)

RARER = (
    ("fit", "mesh.su2", "-o", "mesh.h5"),
    ("move", "mesh.h5", "--deform", "twist=3deg", "-o", "moved.su2"),
    ("fit", "@onera_m6:9x11x9", "-o", "m6.h5"),
    ("ride", "m6.h5", "mesh.su2", "--deform", "bend=4deg@0.5", "-o", "ridden.su2"),
    ("sample", "wing.toml", "-n", "3", "-o", "designs"),
    ("improve", "m6.h5", "-o", "better.xyz", "--iterations", "3"),
    ("extrude", "octant.xyz", "-o", "octant.cgns", "--first-cell", "0.05", "--layers", "7", "--outer", "4"),
)


def needed_by(folder, commands, *script):
    """Kernels and signatures that commands or a script need, in a process that has loaded none."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    call = [sys.executable, "-c", RUN.replace("COMMANDS", repr(commands)), *script]
    done = subprocess.run(call, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    word, _, rest = (folder / "told.txt").read_text().splitlines()[-1].partition(" ")
    assert word == "needs"
    return {(index, signature) for index, signature in json.loads(rest)}


@pytest.mark.slow
def test_commands_and_the_program_of_the_page_on_python_need_nothing_that_is_not_warmed_up(tmp_path):
    warmed = warm_up.compile_kernels(["flow", "move", "quality"], None, lambda fraction, what: None).needed
    usual, example = tmp_path / "usual", tmp_path / "example"
    usual.mkdir(), example.mkdir()
    needed = needed_by(usual, USUAL)
    assert len(needed) > 50
    assert needed - warmed == set()
    bench = runpy.run_path(str(Path(__file__).parents[3] / "benchmarks/studio/bench_cold_start.py"))
    (example / "example.py").write_text(bench["example"]())
    needed = needed_by(example, (), "example.py")
    assert len(needed) > 100
    assert needed - warmed == set()


@pytest.mark.slow
def test_meshes_without_structure_and_designs_need_nothing_that_is_not_warmed_up(tmp_path):
    warmed = warm_up.compile_kernels(["mesh", "designs"], None, lambda fraction, what: None).needed
    (tmp_path / "mesh.su2").write_text(su2_text(mesh()))
    (tmp_path / "wing.toml").write_text(EULER)
    sides = (Block(b.nodes[:, :, :1].copy(), b.name) for b in brick_grid((5, 6, 4, 3), octant=True).blocks)
    write_grid(tmp_path / "octant.xyz", Grid(tuple(sides)))
    needed = needed_by(tmp_path, RARER)
    assert len(needed) > 50
    assert needed - warmed == set()


@pytest.mark.slow
@pytest.mark.skipif(not HAS_LOCKS, reason="kernels cannot be locked")
def test_processes_compile_each_kernel_once(tmp_path):
    (tmp_path / "kernels.py").write_text(KERNELS)
    (tmp_path / "locks").mkdir()
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    environment = {**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(tmp_path / "compiled")}
    call = [sys.executable, "-c", COMPILE, str(tmp_path / "locks")]
    started = [subprocess.Popen(call, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    assert sum(int(each.communicate()[0]) for each in started) == 4
    assert len(list((tmp_path / "compiled").rglob("*.nbc"))) == 4
    assert subprocess.run(call, env=environment, capture_output=True, text=True).stdout == "0\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder of kernels that two of them are in, once something is compiled."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    calls, indexes = [], [tmp_path / "one.nbi", tmp_path / "other.nbi"]

    def compile_kernels(names, processes, progress):
        calls.append(processes)
        for index in indexes:
            index.touch()
        needed = {(str(indexes[0]), "(int64,)"), (str(indexes[0]), "(float64,)"), (str(indexes[1]), "(int64,)")}
        return warm_up.WarmUp(frozenset(needed), 3, 2, 1.5)

    monkeypatch.setattr(warm_up, "compile_kernels", compile_kernels)
    return tmp_path, calls, indexes


def test_nothing_is_done_where_all_is_there(place, capsys):
    folder, calls, indexes = place
    numbers = folder / "numbers.json"
    assert run(["warm-up", "--processes", "2", "--json", str(numbers)]) == 0
    said = capsys.readouterr()
    assert "compiled 3 kernels" in said.out
    assert "3 specialisations of 2 kernels" in said.out
    first = json.loads(numbers.read_text())
    assert (first["n_kernels"], first["n_specialisations"], first["n_compiled"]) == (2, 3, 3)
    assert run(["warm-up", "--json", str(numbers)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "nothing to compile: 3 specialisations of 2 kernels" in said.out
    assert json.loads(numbers.read_text()) == {**first, "n_compiled": 0, "processes": 0, "seconds": 0.0}
    assert calls == [2]
    indexes[1].unlink()
    assert run(["warm-up"]) == 0
    assert calls == [2, None]


@pytest.mark.parametrize("n_compiled", [0, 2])
def test_kernels_that_are_all_there_without_a_note_are_not_said_to_be_compiled(
    tmp_path, monkeypatch, capsys, n_compiled
):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(warm_up, "chains", lambda: ("quality",))

    def start(name, folder, locks, lines):
        folder.mkdir()
        for line in ["compiles one\n"] * n_compiled + ["ran quality\n", 'needs [["one.nbi", "(int64,)"]]\n', ""]:
            lines.put((name, line))
        return subprocess.Popen([sys.executable, "-c", ""])

    monkeypatch.setattr(warm_up, "_start", start)
    assert run(["warm-up"]) == 0
    said = capsys.readouterr()
    assert said.err.count("compiling, once") == bool(n_compiled)
    assert ("all were compiled before: 1 specialisation of 1 kernel that" in said.out) == (not n_compiled)
    assert ("compiled 2 kernels" in said.out) == bool(n_compiled)


def test_other_kernels_are_compiled_for_another_processor_or_version(place, monkeypatch):
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "another")
    other = warm_up._key()
    monkeypatch.undo()
    assert warm_up._key() != other


def test_what_cannot_be_noted_is_done_again(place, monkeypatch):
    monkeypatch.setattr(Path, "write_text", lambda *arguments, **options: exec("raise OSError"))
    assert run(["warm-up"]) == 0
    assert run(["warm-up"]) == 0
    assert len(place[1]) == 2


@pytest.mark.slow
def test_chains_run_in_processes_that_say_how_far_they_are():
    told = []
    done = warm_up.compile_kernels(["quality"], 2, lambda fraction, what: told.append(fraction))
    assert done.n_processes == 1
    assert done.n_kernels > 20
    assert told[-1] == 1.0
    assert all(index.endswith(".nbi") for index, _ in done.needed)


@pytest.mark.slow
def test_a_chain_that_fails_is_named(monkeypatch):
    monkeypatch.setitem(warm_up_worker.CHAINS, "unknown", (("fit",),))  # here, and not in the process
    with pytest.raises(InputError, match="the commands 'unknown' of bspline-mdao warm-up failed: KeyError: 'unknown'"):
        warm_up.compile_kernels(["unknown"], None, lambda fraction, what: None)


def test_the_folder_of_kernels_is_the_one_that_is_chosen(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert kernel_folder() == str(tmp_path)
