"""Fitted models and their files."""

import json
import pickle
from dataclasses import replace

import h5py
import numpy as np
import pytest
from fit_cases import ALL_SHAPES, bent_block, c_grid, two_blocks

from bspline_mdao.core.evaluation.evaluator import Evaluator
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.model import model_file
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.core.model.local_model import LocalModel
from bspline_mdao.core.splines.knots import FunctionKnots
from bspline_mdao.errors import InputError
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "model.h5"
    fit_grid(two_blocks()).save(path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("shape", ALL_SHAPES)
@pytest.mark.parametrize("compress", [False, True])
def test_a_file_holds_everything(shape, compress, tmp_path):
    model = fit_grid(ALL_SHAPES[shape](), corrections=1)
    model.save(tmp_path / "model.h5", compress=compress)
    loaded = FittedModel.load(tmp_path / "model.h5")
    assert loaded.topology == model.topology
    assert loaded.report == model.report
    assert loaded.settings == model.settings
    assert loaded.header.names == model.header.names
    for name in ("control_points", "residual"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(model, name))
    for a, b in zip(loaded.parameters + loaded.mesh.control_ids, model.parameters + model.mesh.control_ids):
        np.testing.assert_array_equal(a, b)


def test_patches_dialect_and_blanking_survive(tmp_path):
    nodes = bent_block().blocks[0].nodes
    iblank = np.arange(nodes[..., 0].size, dtype=np.int32).reshape(nodes.shape[:3])
    patch = Patch("wing", "wall", (Window.whole(0, nodes.shape).face(4),))
    dialect = Plot3dDialect("fortran", ">", 4, has_iblank=True)
    grid = Grid((Block(nodes, "zone", iblank),), (patch,), "wing.xyz", dialect)
    fit_grid(grid).save(tmp_path / "model.h5")
    header = FittedModel.load(tmp_path / "model.h5").header
    assert (header.patches, header.dialect, header.source) == ((patch,), dialect, "wing.xyz")
    np.testing.assert_array_equal(header.iblanks[0], iblank)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_the_baseline_comes_back_with_its_residual(shape):
    grid = ALL_SHAPES[shape]()
    again = fit_grid(grid).regenerate()
    assert again.shapes == grid.shapes
    np.testing.assert_allclose(again.to_vector(), grid.to_vector(), atol=1e-14)


def test_the_evaluator_is_made_once_and_not_pickled(monkeypatch):
    model, made, of_grid = fit_grid(two_blocks()), [], Evaluator.of_grid
    monkeypatch.setattr(Evaluator, "of_grid", lambda *arguments: made.append(1) or of_grid(*arguments))
    before = len(pickle.dumps(model))
    nodes = model.regenerate().to_vector()
    assert model.evaluator() is model.evaluator()
    assert (len(made), len(pickle.dumps(model))) == (1, before)
    again = pickle.loads(pickle.dumps(model)).regenerate().to_vector()
    np.testing.assert_array_equal(again, nodes)
    assert len(made) == 2


def test_without_residual_the_splines_alone_come_back():
    grid = c_grid()
    with_residual, without = fit_grid(grid), fit_grid(grid, keep_residual=False)
    assert without.residual is None
    difference = grid.to_vector() - without.regenerate().to_vector()
    np.testing.assert_allclose(difference, with_residual.residual.ravel(), atol=1e-14)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.h5: there is no such file"):
        FittedModel.load(tmp_path / "nothing.h5")


def test_a_foreign_file_is_refused(tmp_path):
    (tmp_path / "a.h5").write_text("no HDF5")
    with pytest.raises(InputError, match=r"a\.h5: is not a fitted model \(no HDF5 file\)"):
        FittedModel.load(tmp_path / "a.h5")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(InputError, match=r"b\.h5: is an HDF5 file, but not a fitted model"):
        FittedModel.load(tmp_path / "b.h5")


def test_a_newer_version_is_refused(saved):
    with h5py.File(saved, "a") as file:
        file.attrs["version"] = 99
    with pytest.raises(InputError, match="is of version 99, newer than 5"):
        FittedModel.load(saved)


def as_version(path, version, change):
    """Give a file the document that a former version wrote."""
    with h5py.File(path, "a") as file:
        arrays = {}
        file.visititems(lambda name, item: arrays.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
        document = json.loads(arrays.pop("document").tobytes())
        change(document)
        del file["document"]
        old = json.dumps(document).encode()
        file["document"] = np.frombuffer(old, np.uint8)
        file.attrs.update(version=version, checksum=model_file.checksum_of(old, arrays))


def smoothed(document, smoothing):
    """Take out of a document what version 2 did not know."""
    del document["report"]["fallback"], document["settings"]["method"]
    document["settings"]["smoothing"] = smoothing


def test_a_file_of_version_1_is_read(saved):
    model = FittedModel.load(saved)

    def change(document):
        smoothed(document, 0.0)
        del document["report"]["factor_bytes"], document["settings"]["parametrization"]

    as_version(saved, 1, change)
    again = FittedModel.load(saved)
    assert again.settings == replace(model.settings, method="least_squares")
    assert again.report == model.report
    assert again.candidate_weights is None
    assert again.settings.parametrization == "chord_length"


@pytest.mark.parametrize(("was", "is_now"), [(True, "gzip"), (False, "")])
def test_a_file_from_before_there_were_other_compressions_is_read(saved, was, is_now):
    dialect = {"record": "Plot3dDialect", "encoding": "ascii", "is_gzipped": was}
    as_version(saved, 4, lambda document: document["header"].update(dialect=dialect))
    assert FittedModel.load(saved).header.dialect == Plot3dDialect("ascii", compression=is_now)


def test_a_file_of_version_2_is_read_if_its_fit_is_still_known(saved):
    as_version(saved, 2, lambda document: smoothed(document, float("inf")))
    model = FittedModel.load(saved)
    np.testing.assert_array_equal(model.candidate_weights, np.tile(np.eye(6)[5], (len(model.control_points), 1)))
    as_version(saved, 2, lambda document: document["settings"].update(smoothing=0.1))
    with pytest.raises(InputError, match=r"model\.h5: the fitted model is smoothed, which is no longer known; fit"):
        FittedModel.load(saved)


def test_a_file_of_version_4_ties_no_sides(saved):
    as_version(saved, 4, lambda document: document["topology"].pop("periodic"))
    assert FittedModel.load(saved).topology.periodic == ()


def test_a_file_of_version_3_is_read_by_one_process_and_refused_by_several(saved):
    model = FittedModel.load(saved)
    with h5py.File(saved, "a") as file:
        del file["residual_lengths"]
    as_version(saved, 3, lambda document: None)
    again = FittedModel.load(saved)
    np.testing.assert_array_equal(again.residual_lengths, model.residual_lengths)
    with pytest.raises(InputError, match=r"model\.h5: is of a version before 4, .* FittedModel\.load\(path\)\.save"):
        LocalModel.load(saved)
    again.save(saved)
    np.testing.assert_array_equal(LocalModel.load(saved).residual_lengths, model.residual_lengths)


def test_lengths_of_the_residual_are_taken_from_the_file(saved):
    found, stored = replace(FittedModel.load(saved)).residual_lengths, FittedModel.load(saved).__dict__
    np.testing.assert_array_equal(stored["residual_lengths"], found)
    for lengths, message in ((found[1:], r"have \d+ corners; fit"), (-1.0 - found, "damaged")):
        with h5py.File(saved, "a") as file:
            del file["residual_lengths"]
            file["residual_lengths"] = lengths
        as_version(saved, 5, lambda document: None)
        with pytest.raises(InputError, match=message):
            FittedModel.load(saved).grid_map()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["control_points", "document", "parameters/1", "knots/0/2"])
def test_a_changed_or_missing_part_is_noticed(saved, name):
    with h5py.File(saved, "a") as file:
        values = file[name][()]
        del file[name]
        if name != "document":
            file[name] = values + 1e-9
    with pytest.raises(InputError, match=r"model\.h5: the fitted model is damaged"):
        FittedModel.load(saved)


@pytest.mark.slow
def test_damaged_files_never_end_in_another_error(saved):
    rng = np.random.default_rng(11)
    content = np.frombuffer(saved.read_bytes(), np.uint8)
    n_refused = 0
    for trial in range(60):
        damaged = content.copy()
        damaged[rng.integers(0, len(content), 3)] = rng.integers(0, 256, 3)
        saved.write_bytes(damaged[: rng.integers(1, len(content))].tobytes() if trial % 3 == 0 else damaged.tobytes())
        try:
            FittedModel.load(saved)
        except InputError:
            n_refused += 1
    assert n_refused > 20  # of 60; bytes that nothing in the file depends on may change


def test_an_old_file_stays_when_a_new_one_cannot_be_written(saved):
    before = saved.read_bytes()
    given = FunctionKnots(4, 5, lambda s, t: 0.5 + 0 * s[:, None], lambda s, t: np.zeros((s.size, 1, 2)))
    model = fit_grid(bent_block(), knots=[(given, given, given)])
    with pytest.raises(InputError, match="FunctionKnots cannot be saved"):
        model.save(saved)
    assert saved.read_bytes() == before


def test_a_folder_that_is_not_there_is_made(tmp_path):
    fit_grid(bent_block()).save(tmp_path / "missing" / "model.h5")
    assert FittedModel.load(tmp_path / "missing" / "model.h5").n_nodes == bent_block().n_nodes
