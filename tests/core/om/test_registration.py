"""A component is registered in two places, the entry points and the stub of the package, and nowhere else."""

import importlib
import inspect
import pkgutil
import re
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest
from component_cases import movable_model
from openmdao.core.driver import Driver
from openmdao.recorders.case_recorder import CaseRecorder

import bspline_mdao
import bspline_mdao.core.om
import bspline_mdao.flow.om
from bspline_mdao.core.om.quality import Quality
from bspline_mdao.grids.cells.aggregates import AGGREGATES

PACKAGE = Path(bspline_mdao.__file__).parent
BASES = {"SparseComponent", "MovedPoints"}
"""What components of the package derive from."""


def named(stub: Path) -> set[str]:
    """What a stub names, by its entry point."""
    place = ".".join(stub.parent.relative_to(PACKAGE.parent).parts)
    return {
        f"{place}.{module}:{name}" for module, name in re.findall(r"from \.([\w.]+) import (\w+)", stub.read_text())
    }


PUBLIC = set().union(*map(named, PACKAGE.rglob("*.pyi")))
KINDS = {
    "openmdao_component": (om.ExplicitComponent, om.ImplicitComponent),
    "openmdao_group": om.Group,
    "openmdao_driver": Driver,
    "openmdao_case_recorder": CaseRecorder,
}


def classes():
    """Classes that are defined in modules that import OpenMDAO, by their entry point."""
    modules = [
        module
        for layer in (bspline_mdao.core.om, bspline_mdao.flow.om)
        for module in pkgutil.walk_packages(layer.__path__, f"{layer.__name__}.")
    ]
    for module in modules:
        if "mphys" not in module.name:  # MPhys has a registry of its own, and may not be installed
            members = inspect.getmembers(importlib.import_module(module.name), inspect.isclass)
            yield from ((f"{module.name}:{name}", c) for name, c in members if c.__module__ == module.name)


@pytest.mark.parametrize("group", KINDS)
def test_openmdao_lists_the_public_components_groups_and_drivers(group):
    listed = {entry.value: entry.name for entry in entry_points(group=group) if entry.value.startswith("bspline_mdao")}
    assert set(listed) == {path for path, found in classes() if issubclass(found, KINDS[group]) and path in PUBLIC}
    assert all(name == path.rpartition(":")[2].lower() for path, name in listed.items())


def test_every_component_at_the_top_of_om_is_public():
    components = (path for path, found in classes() if issubclass(found, KINDS["openmdao_component"]))
    top = {path for path in components if re.fullmatch(r"bspline_mdao\.core\.om\.\w+:\w+", path)}
    top = {path for path in top if path.rpartition(":")[2] not in BASES}
    assert len(top) > 8
    assert top <= set(PUBLIC)


def test_all_aggregates_of_the_table_can_be_outputs_of_the_quality_component():
    problem = om.Problem()
    quality = Quality(model=movable_model(), aggregates=list(AGGREGATES))
    problem.model.add_subsystem("quality", quality, promotes=["*"])
    problem.setup()
    problem.run_model()
    assert all(np.isfinite(problem.get_val(name)).all() for name in AGGREGATES)
