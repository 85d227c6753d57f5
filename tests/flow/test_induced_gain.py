"""What was gained in induced drag, on the grid and as estimated for a finer one."""

import numpy as np
import pytest

from bspline_mdao.flow.euler.error_estimate import ErrorEstimate
from bspline_mdao.flow.om.induced_gain import induced_gains
from bspline_mdao.studio.report.design_summary import DesignSummary, SummaryEntry


def estimates(drag, lift, remaining, of=""):
    """Estimates of a drag and a lift, (value, finer) each."""
    return {
        f"{of}CD_induced": ErrorEstimate(*drag, 1.5, np.zeros(2), remaining),
        f"{of}CL": ErrorEstimate(*lift, 1.5, np.zeros(2), 0.01),
    }


BEFORE = estimates((0.0043, 0.00434), (0.22, 0.2203), 0.00019)
AFTER = estimates((0.00408, 0.0041), (0.22, 0.2197), 0.0001)


def test_gains_are_those_of_drag_by_the_square_of_lift():
    (found,) = induced_gains(BEFORE, AFTER)
    assert found.gain == pytest.approx(1.0 - 0.00408 / 0.0043)
    assert found.finer == pytest.approx(1.0 - 0.0041 / 0.00434 * (0.2203 / 0.2197) ** 2)
    assert found.doubt == pytest.approx(0.00019 / 0.0043)


def test_lift_that_a_finer_grid_lacks_is_no_gain():
    (found,) = induced_gains(BEFORE, estimates((0.0043, 0.00434 / 1.21), (0.22, 0.2203 / 1.1), 0.0001))
    assert found.gain == 0.0
    assert found.finer == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize(
    ("drag", "is_shown"),
    [((0.00408, 0.0041), True), ((0.00408, 0.0042), False), ((0.00408, 0.0045), False), ((0.0042, 0.0041), False)],
)
def test_a_gain_that_either_grid_may_lack_is_warned_of(drag, is_shown):
    (found,) = induced_gains(BEFORE, estimates(drag, (0.22, 0.2203), 0.0001))
    assert found.is_listed is is_shown
    assert bool(found.warning) is not is_shown
    assert found.words in found.warning or is_shown


def test_each_condition_has_its_gain_and_one_that_is_not_estimated_before_has_none():
    before, after = (part | {f"cruise.{name}": one for name, one in part.items()} for part in (BEFORE, AFTER))
    assert [gain.name for gain in induced_gains(before, after)] == ["CD_induced", "cruise.CD_induced"]
    assert induced_gains({}, after) == ()
    assert [gain.name for gain in induced_gains(BEFORE, after)] == ["CD_induced"]


def test_a_table_says_what_was_gained_where_both_designs_are_estimated():
    nothing = np.array([np.nan])
    value, name = np.array([0.00408]), "CD_induced"
    entry = SummaryEntry("objective", name, "", value, nothing, nothing, (name,), np.ones(1))
    before, after = DesignSummary((entry,), BEFORE), DesignSummary((entry,), AFTER)
    assert after.table(before).splitlines()[2:] == [
        "CD_induced by the square of the lift: 5.1 % less on this grid, 5.0 % less on the finer one, which may be "
        "wrong by 4.4 %"
    ]
    for other in (None, DesignSummary((entry,))):
        assert len(after.table(other).splitlines()) == 2


def test_a_section_that_leaves_no_wake_has_no_gain():
    assert induced_gains(*(estimates((0.0, 0.0), (0.5, 0.5), 0.0) for _ in range(2))) == ()
