"""Results are swapped in as a whole; what runs wrote alone is replaced or removed; what killed runs left is found."""

import os
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.grids.io import locked_folder, run_folder
from bspline_mdao.grids.io.run_folder import MANIFEST, RESULTS, RunFolder, about_run


def made(folder, files, about=None):
    """A run that has written files, and not ended."""
    run = RunFolder(folder)
    place = run.begin(about or {})
    for name, text in files.items():
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_text(text)
    return run


def killed(run):
    """What the system does when a process ends."""
    os.close(run._lock)


def texts(folder):
    """What is in the files of a folder, but for the list."""
    files = (path for path in Path(folder).rglob("*") if path.is_file() and path.name != MANIFEST)
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files}


def test_results_come_at_the_end_and_replace_those_of_the_last_run_alone(tmp_path):
    folder, random = tmp_path / "a" / "b", np.random.default_rng(3)
    last = {}
    for n in range(6):
        names = random.choice(["a", "b", "c", "d/x", "e/x", "e/y"], 3, replace=False)
        files = {str(name): f"{name} of {n}" for name in names}
        run = made(folder, files, {"n": n})
        assert {name: text for name, text in texts(folder).items() if name[0] != "."} == last
        run.keep()
        (folder / "mine").write_text("mine")
        last = {**files, "mine": "mine"}
        assert texts(folder) == last
        assert run.names == sorted(files)
        assert about_run(folder) == {"n": n}


def test_a_run_that_is_discarded_leaves_all_as_it_was(tmp_path):
    made(tmp_path / "a" / "b", {"x": "1"}).discard()
    assert os.listdir(tmp_path) == []
    made(tmp_path / "c", {"x": "1"}).keep()
    before = texts(tmp_path), (tmp_path / "c" / MANIFEST).read_bytes()
    made(tmp_path / "c", {"x": "2", "y": "2"}).discard()
    assert (texts(tmp_path), (tmp_path / "c" / MANIFEST).read_bytes()) == before


def test_files_that_no_run_wrote_are_refused_by_name(tmp_path):
    made(tmp_path, {"a": "1", "b": "1", "f/c": "1"}).keep()
    folder = RunFolder(tmp_path)
    folder.check(["a", "b", "f", "g"])
    (tmp_path / "b").write_text("changed")
    (tmp_path / "f/mine").write_text("mine")
    (tmp_path / "g").write_text("mine")
    folder.check(["a"])
    with pytest.raises(InputError, match=r": b, f/mine, g would be replaced, and no run wrote it, or it was changed"):
        folder.check(["a", "b", "f", "g"])
    made(tmp_path, {"h": "1"}).keep()
    assert texts(tmp_path) == {"b": "changed", "f/mine": "mine", "g": "mine", "h": "1"}


def test_what_a_killed_run_wrote_stays_until_results_are_swapped_in(tmp_path):
    run = made(tmp_path, {"x": "1"}, {"n": 1})
    with pytest.raises(InputError, match="another run is at work in it"):
        RunFolder(tmp_path).check([])
    assert RunFolder(tmp_path).left_behind() == []
    killed(run)
    RunFolder(tmp_path).check([])
    (private,) = RunFolder(tmp_path).left_behind()
    assert (texts(private / RESULTS), about_run(private)) == ({"x": "1"}, {"n": 1})
    made(tmp_path, {"x": "2"}).discard()
    assert RunFolder(tmp_path).left_behind() == [private]
    made(tmp_path, {"x": "3"}).keep()
    assert texts(tmp_path) == {"x": "3"}


@pytest.mark.parametrize("n_put", [0, 1, 2])
def test_a_run_that_is_killed_while_results_are_swapped_in_leaves_files_of_runs(tmp_path, monkeypatch, n_put):
    def put_some(made, folder):
        for name in ("x", "y")[:n_put]:
            os.replace(made / name, folder / name)
        raise KeyboardInterrupt

    made(tmp_path, {"x": "1", "y": "1"}).keep()
    run = made(tmp_path, {"x": "2", "y": "2"})
    monkeypatch.setattr(run_folder, "put_files", put_some)
    with pytest.raises(KeyboardInterrupt):
        run.keep()
    killed(run)
    monkeypatch.undo()
    RunFolder(tmp_path).check(["x", "y"])  # old and new ones are known
    made(tmp_path, {"x": "3"}).keep()
    assert texts(tmp_path) == {"x": "3"}


def test_where_there_are_no_locks_nothing_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(locked_folder, "fcntl", None)
    run = made(tmp_path, {"x": "1"})
    assert RunFolder(tmp_path).left_behind() == [run._private]
    made(tmp_path, {"x": "2"}).keep()
    assert texts(run._private / RESULTS) == {"x": "1"}
    run.discard()


def test_a_folder_that_cannot_be_begun_is_left_as_it_was(tmp_path, monkeypatch):
    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(run_folder, "_write_manifest", full)
    with pytest.raises(OSError, match="No space left"):
        RunFolder(tmp_path / "a" / "b").begin({})
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("text", ["", "{", "[]", '{"files": []}', '{"about": {}}', "\0" * 9])
def test_a_list_that_cannot_be_read_makes_no_file_one_of_a_run(tmp_path, text):
    made(tmp_path, {"a": "1"}).keep()
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(InputError, match="a would be replaced"):
        RunFolder(tmp_path).check(["a"])
    made(tmp_path, {"b": "2"}).keep()
    assert texts(tmp_path) == {"a": "1", "b": "2"}
