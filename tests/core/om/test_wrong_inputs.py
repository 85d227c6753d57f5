"""What users get wrong with design variables, constraints and measures: one line says what, where and what to do."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest
from parametrization_cases import surface_of, wing_model

from bspline_mdao import GridMovement, InputError
from bspline_mdao.constraints import InPlane, Mirrored, Pinned
from bspline_mdao.design import (
    Camber,
    Chord,
    FreeForm,
    InBlock,
    InBox,
    Lattice,
    Local,
    Nearest,
    NearPlane,
    OnPatch,
    Parametrization,
    ReferenceAxis,
    Twist,
)
from bspline_mdao.measures import (
    Clearance,
    Curvature,
    EnclosedVolume,
    LeadingEdgeRadius,
    PlaneClearance,
    SurfaceArea,
    SurfaceGrid,
    Thickness,
)
from bspline_mdao.movers import moving_mesh

ROOT = NearPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


model = cache(wing_model)


@cache
def mesh():
    return moving_mesh(model())


@cache
def surface():
    return SurfaceGrid.of(model())


@cache
def axis():
    return ReferenceAxis.of(mesh())


def assert_message(call, message):
    with pytest.raises(InputError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


def designed(*variables, constraints=()):
    return Parametrization(mesh(), variables, constraints)


def moved(values, points=None):
    variables = [Twist("twist", axis(), stations=3), Local("bump", Nearest((0.5, 0.0, 0.5)), "y")]
    return designed(*variables).apply(surface_of(mesh()) if points is None else points, values)


def movement(**options):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("shape", GridMovement(model=model(), **options), promotes=["*"])
    problem.setup()


PARAMETRIZATIONS = {
    "missing": (lambda: moved({"twist": np.zeros(3)}), r"values of 'bump' are missing; give shape \(2,\)"),
    "size": (
        lambda: moved({"twist": np.zeros(4), "bump": np.zeros(2)}),
        r"'twist' are of shape \(4,\); give shape \(3,\)",
    ),
    "scalar": (lambda: moved({"twist": 1.0, "bump": np.zeros(2)}), r"'twist' are of shape \(\); give shape \(3,\)"),
    "typo": (lambda: moved({"twits": np.zeros(3)}), "no variable is called 'twits'; there are twist, bump"),
    "points": (lambda: moved({}, mesh().points), "initial points of shape"),
    "no variable": (lambda: designed(axis()), "variable 1 is of type ReferenceAxis, which has no 'name'"),
    "class": (lambda: designed(Twist), "variable 1 is the class Twist"),
    "no list": (lambda: Parametrization(mesh(), Twist("a", axis())), "the variables are one Twist; give a list"),
    "no constraint": (lambda: designed(Twist("a", axis()), constraints=[ROOT]), "constraint 1 is of type NearPlane"),
    "no mesh": (lambda: Parametrization(model(), []), r"of type FittedModel; make it with moving_mesh\(model\)"),
    "taken": (lambda: designed(Twist("grid", axis())), "called 'grid', which is taken"),
    "nameless": (lambda: designed(Twist("", axis())), "called '', which is taken"),
    "held": (lambda: designed(Local("b", ROOT, "z")), r"b\[0\] moves nothing \(symmetry plane: .* nor do \d+"),
    "one held": (
        lambda: designed(Twist("a", axis()), constraints=[Pinned(np.arange(len(mesh().surface_ids)))]),
        r"a moves nothing \(pinned: [^)]*\) of block \d\); select",
    ),
}

SELECTIONS = {
    "no patch": (lambda: OnPatch(model(), []).rows(mesh()), "none is named"),
    "short box": (lambda: InBox((0.0, 0.0)).rows(mesh()), "give three numbers"),
    "half a point": (lambda: Nearest((0.0, 0.0, 0.0), 2.5).rows(mesh()), "give a whole number from 1 to"),
    "letter": (lambda: NearPlane((0, 0, 0), "z").rows(mesh()), "normal of a plane: 'z' are no numbers"),
    "half a block": (lambda: InBlock(1.5).rows(mesh()), "no block has the number 1.5; give one from 0 to 11"),
    "where": (lambda: designed(Local("b", "wing_upper")), "'b': give a selection, or numbers"),
}

AXES = {
    "nan": (lambda: ReferenceAxis([[0.0, 0.0, 0.0], [0.0, 0.0, np.nan]]), r"point 2 is \[0.0, 0.0, nan\]"),
    "beside": (
        lambda: designed(Twist("a", ReferenceAxis(axis().points + [0.0, 0.0, 9.0]))),
        r"goes from 9 to 10.48 m along the span, the surface from 0 to 1.484 m",
    ),
    "backwards": (lambda: ReferenceAxis.of(mesh(), span=(1.0, 0.0)), "give two rising parts"),
    "model": (lambda: ReferenceAxis.of(model()), "reference axis: the mesh is of type FittedModel"),
    "array": (lambda: Chord("a", axis().points), "'a': the axis is of type ndarray; give a ReferenceAxis"),
    "stations": (lambda: designed(Twist("a", axis(), stations=2.5)), "stations: 2.5; give how many"),
    "camber": (
        lambda: designed(Camber("a", axis(), line=lambda part: np.where(part < 0.5, np.nan, part))),
        "'a': the camber line is not finite at the part",
    ),
}

LATTICES = {
    "nan": (lambda: Lattice.box([[0.0, 0.0, 0.0], [1.0, np.nan, 1.0]]), "give a mesh, or finite ones"),
    "flat": (lambda: Lattice.box(mesh(), n=(4, 1, 3)), r"\(4, 1, 3\) points; give two or more in each direction"),
    "axes": (lambda: Lattice.box(mesh(), axes=np.ones((2, 3))), "give three directions"),
    "zero axis": (lambda: Lattice.box(mesh(), axes=np.diag([1.0, 1.0, 0.0])), "give three directions"),
    "corners": (lambda: Lattice.hexahedron(np.zeros((8, 3))), r"corners of shape \(8, 3\); give shape \(2, 2, 2, 3\)"),
    "none": (
        lambda: designed(FreeForm("a", Lattice.box(mesh()), where=np.zeros((4, 3, 3), dtype=bool))),
        "of 0 lattice points asked for, 0 are fixed for continuity and 0 are too far",
    ),
}

CONSTRAINTS = {
    "line": (InPlane(Nearest((0.5, 0.0, 0.5), 2)), "are on one line; give a normal"),
    "behind": (Mirrored((0.0, 1.0, 0.0), (0.0, 5.0, 0.0)), "no point is on the side that the normal points to"),
    "point": (Mirrored((0.0, 1.0, 0.0), (0.0, 1.0)), r"point is \[0.0, 1.0\]; give three finite numbers"),
    "words": (Pinned(ROOT, ["along", "span"]), "are no numbers"),
}

MEASURES = {
    "no patch": (lambda: SurfaceGrid.of(model(), []), "no patch is named"),
    "no part": (lambda: Curvature.integral(surface(), patches=[]), "no patch is named; the patches are wing_lower"),
    "words": (
        lambda: Thickness.at(surface(), [[0.5, 0.0, 0.5]], direction="y"),
        "thickness: direction: 'y' are no num",
    ),
    "origin": (
        lambda: PlaneClearance.of(surface(), "wing*", (0.0, 0.0), (0, 1, 0)),
        r"origin of the plane is \[0.0, 0.0\]",
    ),
    "station": (lambda: LeadingEdgeRadius.at(surface(), "tip"), "sections: stations: 'tip' are no numbers"),
    "class": (lambda: movement(measures=[EnclosedVolume]), "measure 1 is the class EnclosedVolume"),
    "no list": (lambda: movement(measures=EnclosedVolume.of(surface())), "the measures are one EnclosedVolume"),
    "one name": (
        lambda: movement(measures=[EnclosedVolume.of(surface()), SurfaceArea.of(surface(), name="volume")]),
        "the name 'volume' of a measure is taken",
    ),
    "taken": (
        lambda: movement(measures=[SurfaceArea.of(surface(), name="grid")]),
        "the name 'grid' of a measure is taken",
    ),
    "far field": (
        lambda: movement(measures=[SurfaceArea.of(SurfaceGrid.of(model(), "farfield"))]),
        "do not depend on the design surface",
    ),
}

CALLS = {
    f"{kind}: {name}": case
    for kind, cases in (
        ("parametrization", PARAMETRIZATIONS),
        ("selection", SELECTIONS),
        ("axis", AXES),
        ("lattice", LATTICES),
        ("measure", MEASURES),
    )
    for name, case in cases.items()
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_input_is_named_in_one_line(name):
    assert_message(*CALLS[name])


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_constraints_that_cannot_be_used_are_named_in_one_line(name):
    constraint, message = CONSTRAINTS[name]
    assert_message(lambda: designed(Twist("a", axis()), constraints=[constraint]), message)


def test_selections_combine_with_selections_only():
    with pytest.raises(TypeError, match="NearPlane"):
        ROOT & [1, 2]
    with pytest.raises(TypeError, match="NearPlane"):
        ROOT | [1, 2]


def test_numbers_select_where_selections_do():
    rows = ROOT.rows(mesh())
    both = [designed(Local("b", where, "y")) for where in (ROOT, rows)]
    patterns = [one.pattern.values["b"].toarray() for one in both]
    np.testing.assert_array_equal(*patterns)


def test_patches_of_a_surface_are_named_by_patterns():
    assert set(surface().part("wing*")) == {*surface().part("wing_lower"), *surface().part("wing_upper")}
    assert Clearance.from_points(surface(), "wing*", (0.0, 1.0, 0.0)).evaluate(surface().points) < 1.0
