"""Options of SciPy's driver in the NLopt driver: each means what it does there, or is refused by name."""

import openmdao.api as om
import pytest
from driver_cases import rosenbrock

from bspline_mdao import InputError, NLoptDriver
from bspline_mdao.core.om.drivers.familiar_options import NLOPT_NAME, REFUSED

pytestmark = pytest.mark.filterwarnings("ignore::openmdao.utils.om_warnings.OpenMDAOWarning")


def solved(driver):
    problem = rosenbrock()
    problem.driver = driver
    problem.setup()
    problem.run_driver()
    return problem


def test_the_options_of_scipys_driver_are_taken_by_their_names():
    ours, theirs = (
        solved(kind(optimizer=name, tol=1e-10, maxiter=100, disp=False))
        for kind, name in ((NLoptDriver, "LD_SLSQP"), (om.ScipyOptimizeDriver, "SLSQP"))
    )
    assert ours.driver.result.success
    assert theirs.driver.result.success
    assert ours.get_val("f").item() == pytest.approx(theirs.get_val("f").item(), abs=1e-8)


@pytest.mark.parametrize("algorithm", ["LD_SLSQP", "LD_MMA", "LD_LBFGS"])
@pytest.mark.parametrize("maxiter", [1, 3])
def test_maxiter_counts_gradients_after_the_first_and_is_no_success(algorithm, maxiter):
    problem = solved(NLoptDriver(optimizer=algorithm, maxiter=maxiter, disp=False))
    result = problem.driver.result
    assert result.deriv_evals == maxiter + 1
    assert not result.success
    assert "MAXITER_REACHED: maxiter iterations were done" in result.exit_status
    assert problem.get_val("f").item() == problem.driver.best.objective


def test_tol_stops_at_a_change_of_the_objective_and_of_nothing_else():
    coarse, fine = (solved(NLoptDriver(tol=tol, disp=False)).driver for tol in (1e-1, 1e-12))
    assert coarse.result.model_evals < fine.result.model_evals
    assert coarse.outcome.end == "FTOL_REACHED"


@pytest.mark.parametrize("name", ["tol", "ftol", "acc"])
def test_opt_settings_go_before_options(name):
    driver = NLoptDriver(tol=1e-1, disp=False)
    driver.opt_settings = {name: 1e-12, "maxfun": 500}
    fine = solved(NLoptDriver(tol=1e-12, maxeval=500, disp=False)).driver
    assert solved(driver).driver.result.model_evals == fine.result.model_evals


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"speed": 3}, ["'speed'] is not known", "maxeval", "ftol"]),
        ({"ftol": 1e-3, "acc": 1e-4}, ["tol twice", "'acc'"]),
        *(({name: 1.0}, [f"'{name}'", why]) for name, why in REFUSED.items()),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(settings, words):
    driver = NLoptDriver(disp=False)
    driver.opt_settings = settings
    with pytest.raises(InputError) as error:
        solved(driver)
    assert all(word in str(error.value) for word in words)


def test_every_familiar_name_means_an_option_that_there_is():
    options = NLoptDriver().options
    assert all(own in options for own in NLOPT_NAME.values())
    assert not NLOPT_NAME.keys() & REFUSED.keys()


def test_iterations_of_algorithms_without_gradients_are_refused():
    with pytest.raises(InputError, match=r"LN_COBYLA takes no gradients.*set maxeval instead"):
        solved(NLoptDriver(optimizer="LN_COBYLA", maxiter=5, disp=False))
