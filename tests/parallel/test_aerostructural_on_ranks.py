"""A flow on several ranks couples to a structure as on one."""

import pytest
from parallel_cases import run_ranks

pytest.importorskip("mphys", reason="MPhys is not installed")
pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")

pytestmark = pytest.mark.slow


def test_a_flexible_wing_on_two_ranks_bends_as_on_one():
    run_ranks("cases/aerostructural.py", 2)
