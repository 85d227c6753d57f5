"""What commands import, and what they do not."""

import gc
import sys

import openmdao.api as om
import pytest
from openmdao.utils import reports_system

from bspline_mdao.studio.cli import optimize
from bspline_mdao.studio.cli.imports import without_collector


def test_commands_import_without_the_collector_which_leaves_what_they_imported_alone(monkeypatch, tmp_path):
    (tmp_path / "imported_once.py").write_text("kept = [[n] for n in range(5000)]")
    monkeypatch.syspath_prepend(tmp_path)
    assert gc.isenabled()
    with without_collector():
        assert not gc.isenabled()
        import imported_once
    assert gc.isenabled()
    assert not any(each is imported_once.kept for each in gc.get_objects())
    del sys.modules["imported_once"]


def test_what_was_imported_before_changes_nothing_of_the_collector():
    gc.disable()
    try:
        n_frozen = gc.get_freeze_count()
        with without_collector():
            import json  # noqa: F401 - is there
        assert not gc.isenabled()
        assert gc.get_freeze_count() == n_frozen
    finally:
        gc.enable()


def test_a_study_loads_no_writers_of_reports(monkeypatch):
    monkeypatch.setattr(reports_system, "_plugins_loaded", False)
    monkeypatch.setattr(reports_system, "_iter_entry_points", lambda group: pytest.fail("entry points are loaded"))
    with optimize._without_report_plugins():
        om.Problem(reports=None)
    assert reports_system._plugins_loaded is False
