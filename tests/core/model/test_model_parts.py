"""Model files in parts: subdomains that are read by slices, and files that are written by turns."""

import h5py
import numpy as np
import pytest
from fit_cases import FOLDING, folded_block, two_blocks

from bspline_mdao import FitWarning, InputError, fit_grid
from bspline_mdao.core.model import model_parts
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.core.model.local_model import LocalModel
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.grids.topology.partition import Partition, Subdomain
from bspline_mdao.splines import fit_blocks


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    model, path = fit_grid(two_blocks()), tmp_path_factory.mktemp("models") / "model.h5"
    model.save(path)
    return model, path


@pytest.mark.parametrize("n_ranks", [1, 2, 3, 4, 5])
def test_local_models_that_are_read_have_the_bits_of_the_whole_model(saved, n_ranks):
    model, path = saved
    partition = Partition.of(model.topology, n_ranks, imbalance=0.05)
    whole = model.regenerate().to_vector().reshape(-1, 3)
    for rank in range(n_ranks):
        local = LocalModel.load(path, subdomain=partition.subdomain(rank))
        expected = model.local_model(partition.subdomain(rank))
        np.testing.assert_array_equal(local.parameters, expected.parameters)
        np.testing.assert_array_equal(local.residual, expected.residual)
        np.testing.assert_array_equal(local.regenerate(), whole[local.subdomain.rows])


def test_a_few_nodes_are_read_and_not_their_blocks(saved, monkeypatch):
    model, path = saved
    read = []
    at = model_parts._read_box

    def counted(data, indices, which, values):
        at(data, indices, which, values)
        if len(which):
            read.append(np.prod([np.ptp(index[which]) + 1 for index in indices]))

    monkeypatch.setattr(model_parts, "_read_box", counted)
    inner = [7, 8, 9]
    with model_parts.opened_parts(path, model.topology) as parts:
        values = parts.parameters_at(1, np.array(inner))
        residual = parts.residual_at(np.array([3, 4, 2000]))
    np.testing.assert_array_equal(values, model.parameters[1].reshape(-1, 3)[inner])
    np.testing.assert_array_equal(residual, model.residual[[3, 4, 2000]])
    assert sum(read) < 20


@pytest.mark.parametrize("options", [{}, {"keep_residual": False}, {"method": "quasi_interpolant"}])
@pytest.mark.filterwarnings("ignore::bspline_mdao.FitWarning")
def test_a_file_written_by_turns_is_that_of_a_model(options, tmp_path):
    blocks = [Block(b.nodes, b.name, np.full(b.shape, n, np.int32)) for n, b in enumerate(two_blocks().blocks)]
    grid = Grid((blocks[0], two_blocks().blocks[1]))
    model, parts = fit_grid(grid, **options), fit_blocks(grid, **options)
    model.save(tmp_path / "whole.h5")
    parts.save(tmp_path / "parts.h5")
    found = []
    for name in ("whole.h5", "parts.h5"):
        with h5py.File(tmp_path / name) as file:
            arrays = {}
            file.visititems(lambda n, item, a=arrays: a.update({n: item[()]} if isinstance(item, h5py.Dataset) else {}))
            found.append(arrays)
    assert found[0].keys() == found[1].keys()
    for name in found[0].keys() - {"document"}:
        np.testing.assert_array_equal(found[0][name], found[1][name])
    loaded = FittedModel.load(tmp_path / "parts.h5")
    np.testing.assert_array_equal(loaded.regenerate().to_vector(), model.regenerate().to_vector())
    np.testing.assert_array_equal(loaded.header.iblanks[0], blocks[0].iblank)
    local = parts.local_model(Subdomain.of_grid(model.topology))
    np.testing.assert_array_equal(local.regenerate(), model.regenerate().to_vector().reshape(-1, 3))


def test_a_fit_in_parts_warns_and_refuses_as_a_whole_one():
    with pytest.warns(FitWarning, match="invalid"):
        parts = fit_blocks(folded_block(), method="least_squares", **FOLDING)
    assert parts.report.n_invalid
    with pytest.raises(InputError, match="method"):
        fit_blocks(two_blocks(), method="none")


def test_what_is_damaged_beyond_the_local_model_is_found_when_it_is_read(saved, tmp_path):
    model, path = saved
    content = bytearray(path.read_bytes())
    damaged = tmp_path / "damaged.h5"
    content[len(content) // 2] ^= 0xFF
    damaged.write_bytes(content)
    with pytest.raises(InputError, match=r"damaged.h5: the fitted model is damaged"):
        LocalModel.load(damaged, subdomain=Partition.of(model.topology, 2).subdomain(0))
    with pytest.raises(InputError, match="no such file"):
        LocalModel.load(tmp_path / "none.h5")


def test_a_disk_without_room_is_said_before_anything_is_written(tmp_path, monkeypatch):
    parts = fit_blocks(two_blocks())
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr(model_parts.shutil, "disk_usage", lambda path: usage)
    with pytest.raises(InputError, match="the disk has 1000 left"):
        parts.save(tmp_path / "model.h5")
    assert list(tmp_path.iterdir()) == []
