"""A small wing that the tests of `live` share."""

import pytest

from bspline_mdao import FittedModel, fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.studio.live.shape import LiveModel


@pytest.fixture(scope="session")
def wing_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "wing.h5"
    fit_grid(onera_m6_grid((9, 8, 7)), n_control=(5, 5, 4)).save(path)
    return path


@pytest.fixture(scope="session")
def live(wing_file):
    return LiveModel(FittedModel.load(wing_file))
