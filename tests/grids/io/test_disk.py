"""Files and folders are whole or absent, whatever ends the process that writes them."""

import builtins
import errno
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from component_cases import two_blocks
from grid_cases import smooth_grid

from bspline_mdao import InputError, write_grid
from bspline_mdao.files import write_polymesh, write_vtk
from bspline_mdao.grids.io.disk import PREFIX, SUFFIX, replaced_file, replaced_folder

WRITER = """
import sys, time
from bspline_mdao.grids.io.disk import replaced_file
with replaced_file(sys.argv[1]) as part:
    part.write_text("half")
    print("ready", flush=True)
    time.sleep(60.0)
"""


def private_folders(folder):
    return sorted(path.name for path in folder.iterdir() if path.name.startswith(PREFIX))


def start_writing(path):
    """Start a process that is in the middle of writing a file."""
    process = subprocess.Popen([sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


def tree(folder):
    """Content of every file under a folder, empty folders included."""
    return {path.relative_to(folder): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.mark.slow
def test_what_a_killed_process_leaves_goes_with_the_next_write_and_what_a_living_one_writes_stays(tmp_path):
    killed, living = start_writing(tmp_path / "a"), start_writing(tmp_path / "b")
    try:
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert len(private_folders(tmp_path)) == 2
        with replaced_file(tmp_path / "c") as part:
            part.write_text("whole")
        (kept,) = private_folders(tmp_path)
        assert (tmp_path / kept / "new").read_text() == "half"
    finally:
        living.kill()
        living.wait()
    (tmp_path / f"{PREFIX}of_before_its_lock{SUFFIX}").mkdir()
    with replaced_folder(tmp_path / "d") as part:
        (part / "e").write_text("whole")
    assert sorted(map(str, tree(tmp_path))) == ["c", "d", "d/e"]


def test_nobody_can_foresee_or_enter_the_place_of_the_temporary_file(tmp_path):
    names = set()
    for _ in range(3):
        with replaced_file(tmp_path / "a") as part:
            names.add(part.parent.name)
            assert part.parent.parent == tmp_path
            assert stat.S_IMODE(part.parent.stat().st_mode) == 0o700
            part.write_text("x")
    assert len(names) == 3
    assert os.listdir(tmp_path) == ["a"]


def test_links_of_that_name_are_left_alone(tmp_path):
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").write_text("x")
    (tmp_path / f"{PREFIX}a{SUFFIX}").symlink_to(tmp_path / "precious")
    with replaced_file(tmp_path / "a") as part:
        part.write_text("x")
    assert (tmp_path / "precious" / "file").exists()


def test_new_files_have_ordinary_permissions_and_replaced_ones_keep_theirs(tmp_path):
    (tmp_path / "plain").touch()
    (tmp_path / "secret").touch(mode=0o600)
    for name in ("new", "secret"):
        with replaced_file(tmp_path / name) as part:
            part.write_text("x")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "new", "secret")]
    assert modes == [modes[0], modes[0], 0o600]


def test_everything_is_on_the_disk_before_it_takes_its_place(tmp_path, monkeypatch):
    done = []

    def fsync(descriptor, original=os.fsync):
        done.append(("flushed", os.fstat(descriptor).st_ino))
        original(descriptor)

    def replace(old, new, original=os.replace):
        done.append(("placed", os.stat(old).st_ino))
        original(old, new)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "replace", replace)
    monkeypatch.setattr(os, "rename", replace)
    write_vtk(tmp_path / "out.vtm", smooth_grid())
    files = [path.stat().st_ino for path in (*sorted((tmp_path / "out").iterdir()), tmp_path / "out.vtm")]
    folder, above = (path.stat().st_ino for path in (tmp_path / "out", tmp_path))
    placed = done.index(("placed", folder)), done.index(("placed", files[-1]))
    assert placed[0] < placed[1]
    assert all(done.index(("flushed", file)) < placed[0] for file in files[:-1])
    assert done.index(("flushed", files[-1])) < placed[1]
    assert done[-1] == ("flushed", above)


WRITERS = {
    "vtm": lambda folder: write_vtk(folder / "out.vtm", smooth_grid()),
    "polyMesh": lambda folder: write_polymesh(folder / "polyMesh", two_blocks()),
    "cgns": lambda folder: write_grid(folder / "out.cgns", two_blocks()),
    "xyz": lambda folder: write_grid(folder / "out.xyz", two_blocks()),
}


@pytest.mark.slow
@pytest.mark.parametrize("is_there", [False, True], ids=["new", "replaced"])
@pytest.mark.parametrize("kind", WRITERS)
def test_a_disk_that_fills_up_at_any_file_changes_nothing(tmp_path, tmp_path_factory, monkeypatch, kind, is_there):
    if is_there:
        WRITERS[kind](tmp_path)
        for path in tmp_path.rglob("*"):
            if path.is_file():
                path.write_text("precious")
    before = tree(tmp_path)
    n_files = fail_at = 0

    def full(file, mode="r", *arguments, original=builtins.open, **settings):
        nonlocal n_files
        n_files += "w" in mode
        if "w" in mode and n_files == fail_at:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(file, mode, *arguments, **settings)

    monkeypatch.setattr(builtins, "open", full)
    monkeypatch.setattr("io.open", full)  # pathlib's
    WRITERS[kind](tmp_path_factory.mktemp("counted"))
    for fail_at in range(1, n_files + 1):  # noqa: B007
        n_files = 0
        with pytest.raises(InputError, match=f"{re.escape(str(tmp_path))}.*No space left on device"):
            WRITERS[kind](tmp_path)
        assert tree(tmp_path) == before
    assert fail_at > 0
    n_files, fail_at = 0, 0
    WRITERS[kind](tmp_path)
    assert all(content != b"precious" for content in tree(tmp_path).values())


def test_folders_that_are_missing_are_made_and_removed_again_where_the_writing_fails(tmp_path):
    for write in (replaced_file, replaced_folder):
        with pytest.raises(ZeroDivisionError), write(tmp_path / "a" / "b" / "out"):
            raise ZeroDivisionError
        assert tree(tmp_path) == {}
    with replaced_file(tmp_path / "a" / "b" / "out") as part:
        part.write_text("whole")
    assert (tmp_path / "a" / "b" / "out").read_text() == "whole"
    with pytest.raises(ZeroDivisionError), replaced_file(tmp_path / "a" / "c" / "out"):
        raise ZeroDivisionError
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["b"]


def test_other_files_of_a_folder_stay(tmp_path):
    write_polymesh(tmp_path / "polyMesh", two_blocks())
    (tmp_path / "polyMesh" / "sets").mkdir()
    (tmp_path / "polyMesh" / "cellZones").write_text("mine")
    (tmp_path / "polyMesh" / "points").write_text("old")
    write_polymesh(tmp_path / "polyMesh", two_blocks())
    assert (tmp_path / "polyMesh" / "cellZones").read_text() == "mine"
    assert (tmp_path / "polyMesh" / "points").read_text().startswith("FoamFile")
    assert (tmp_path / "polyMesh" / "sets").is_dir()


FILL = """
from pathlib import Path
from component_cases import two_blocks
from bspline_mdao import InputError, write_grid
grid, sizes = two_blocks(), []
for name in ("out.vtm", "polyMesh", "out.cgns", "out.xyz"):
    for free in range(0, 200, 8):
        Path("ballast").write_bytes(bytes(1024 * max(200 - free, 0)))
        try:
            write_grid(name, grid)
        except InputError as error:
            assert "No space left" in str(error), error
            assert [path.name for path in Path().iterdir()] == ["ballast"], list(Path().iterdir())
        else:
            sizes.append(free)
            break
    for path in sorted(Path().rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
print(sizes)
"""


@pytest.mark.slow
def test_a_small_disk_that_is_really_full_stays_as_it_was(tmp_path):
    unshare = shutil.which("unshare")
    mount = f"mount -t tmpfs -o size=208k none {tmp_path} && cd {tmp_path} && exec {sys.executable} -c '{FILL}'"
    command = [unshare or "unshare", "--mount", "--map-root-user", "sh", "-c"]
    if not unshare or subprocess.run([*command, f"mount -t tmpfs none {tmp_path}"], capture_output=True).returncode:
        pytest.skip("a file system of its own cannot be mounted here")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run([*command, mount], capture_output=True, text=True, env=environment, timeout=300)
    assert done.returncode == 0, done.stderr
    sizes = eval(done.stdout)
    assert len(sizes) == 4
    assert min(sizes) > 0
