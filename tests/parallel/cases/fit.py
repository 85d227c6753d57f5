"""A fit on several ranks from a file, its model file, and the subdomains that are read from it, against one process."""

import sys
import tempfile
import warnings
from pathlib import Path

import fit_cases
import h5py
import numpy as np
import topology_cases
from mpi4py import MPI

from bspline_mdao import FitWarning, InputError, fit_grid, open_grid, write_grid
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.core.model.local_model import LocalModel
from bspline_mdao.grids.topology.partition import Partition
from bspline_mdao.splines import fit_blocks

comm = MPI.COMM_WORLD
GRIDS = {
    "two blocks": (fit_cases.two_blocks, {}),
    "a block on itself": (fit_cases.c_grid, {"knots": "constant", "method": "least_squares"}),
    "collapsed octants": (lambda: fit_cases.grid_of(*topology_cases.sphere_octants()), {}),
    "a fold": (fit_cases.folded_block, fit_cases.FOLDING),
    "quasi-interpolant": (fit_cases.two_blocks, {"method": "quasi_interpolant", "keep_residual": False}),
}


def contents(path):
    """All arrays of a model file, and its attributes but for the checksum and the time of the fit."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
        attributes = dict(file.attrs)
    del attributes["checksum"], attributes["seconds"]
    found.pop("document")
    return found, attributes


def assert_same(one, other):
    assert one.keys() == other.keys()
    for name in one:
        assert one[name].dtype == other[name].dtype, name
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def check(name, folder):
    make, options = GRIDS[name]
    grid = make()
    path = folder / f"{name}.xyz"
    if comm.rank == 0:
        write_grid(path, grid)
    comm.barrier()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        serial = fit_grid(open_grid(path), **options)
        blocks = fit_blocks(open_grid(path, comm=comm), comm, **options)
    np.testing.assert_array_equal(blocks.control_points, serial.control_points)
    for field in ("n_invalid", "invalid", "worst", "max_error", "blocks", "n_nodes", "fallback"):
        one, other = getattr(blocks.report, field), getattr(serial.report, field)
        if field == "fallback" and other is not None:
            assert (one.n_points, one.n_moved, one.least_squares_max) == (
                other.n_points,
                other.n_moved,
                other.least_squares_max,
            )
        else:
            assert one == other, field
    np.testing.assert_allclose(
        [blocks.report.rms, blocks.report.mean_edge], [serial.report.rms, serial.report.mean_edge], rtol=1e-13
    )
    blocks.save(folder / "parallel.h5")
    if comm.rank == 0:
        serial.save(folder / "serial.h5")
        one, other = contents(folder / "parallel.h5"), contents(folder / "serial.h5")
        assert_same(one[0], other[0])
        assert one[1] == other[1]
        loaded = FittedModel.load(folder / "parallel.h5")
        np.testing.assert_array_equal(loaded.regenerate().to_vector(), serial.regenerate().to_vector())
    comm.barrier()
    expected = serial.regenerate().to_vector().reshape(-1, 3)
    for file in ("parallel.h5", "serial.h5"):
        local = LocalModel.load(folder / file, comm)
        np.testing.assert_array_equal(local.regenerate(), expected[local.subdomain.rows])
    uneven = Partition.of(serial.topology, comm.size, imbalance=0.01).subdomain(comm.size - 1 - comm.rank)
    np.testing.assert_array_equal(blocks.local_model(uneven).regenerate(), expected[uneven.rows])


def check_failures(folder):
    """Whatever one rank meets, all raise, and what was there stays."""
    path = folder / "damaged.xyz"
    if comm.rank == 0:
        write_grid(path, fit_cases.two_blocks())
    comm.barrier()
    grid = open_grid(path, comm=comm)
    blocks = fit_blocks(grid, comm)
    for task, words in (
        (lambda: fit_blocks(grid, comm, corrections=1), "parameter correction"),
        (lambda: fit_blocks(grid, comm, n_control=(1, 1, 1)), "control point"),
        (lambda: blocks.save(path / "model.h5"), "cannot be written"),
        (lambda: LocalModel.load(folder / "none.h5", comm), "no such file"),
        (lambda: open_grid(folder / "none.xyz", comm=comm), "does not exist"),
    ):
        try:
            task()
        except InputError as error:
            said = comm.allgather(str(error))
            assert words in said[0]
            assert len(set(said)) == 1, said
        else:
            raise AssertionError(words)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as own:
        folder = Path(comm.bcast(own))
        for name in GRIDS if len(sys.argv) < 2 else sys.argv[1:]:
            check(name, folder)
        check_failures(folder)
        comm.barrier()
    print("done")
