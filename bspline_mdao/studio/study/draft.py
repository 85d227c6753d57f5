"""The draft of a study of a grid: guesses from the grid, with the reasons in comments."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.checks import axes_text
from ...base.extras import INSTALL
from ...errors import InputError
from ...flow.om.mach_range import EULER, LATTICE
from .draft_body import ALPHA, MACH, SECTION_LIFT, Body

__all__ = ["Aim", "study_draft"]

CORNER = 0.05
"""Bound on the worst cell if the grid has as much."""

CONFIRMED = 2
"""Cells per direction of the finer grid on which a section is solved: two flows there are a third of the time."""

SHAPE = 0.1
"""Bound of the weights of a section's shape (chords): half the values of the sides of the NACA 0012."""

LITTLE = 2e-4
"""Change of the drag of a section, in units of the driver (hundredths), at which the search ends: 0.02 counts. Without
a shock the drag is nearly zero, and no part of it is small; at 0.1 counts the search ends halfway."""


FRICTION = 0.006
"""Friction drag in a lift-to-drag ratio, which in Euler flow has no bound without a shock: of both sides of a plate
with a turbulent layer at a Reynolds number of 1e7, each 0.455 / log10(Re)^2.58 (Schlichting)."""


@dataclass(frozen=True)
class Aim:
    """Aim of the draft of a section."""

    machs: tuple[float, ...] = ()  # Mach numbers; a guessed one if empty
    lifts: tuple[float, ...] = ()  # lift coefficients: one, or one for each Mach number, or several at one
    is_ratio: bool = False  # whether lift over drag is the objective, at any lift

    def __post_init__(self) -> None:
        numbers = len(self.machs), len(self.lifts)
        if min(numbers) > 1 and numbers[0] != numbers[1]:
            raise InputError(f"--mach is given {numbers[0]} times and --lift {numbers[1]} times; give one for each")
        if self.is_ratio and self.lifts:
            raise InputError("--lift does not go with --lift-to-drag, which leaves the lift free; leave it out")
        if len(set(zip(*self._both(0.0)))) < max(numbers):
            raise InputError("--mach and --lift: a flight condition is given twice; give each once")

    def _both(self, guess: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        machs, lifts = self.machs or (guess,), self.lifts or (SECTION_LIFT,)
        n = max(len(machs), len(lifts))
        return (machs if len(machs) == n else machs * n), (lifts if len(lifts) == n else lifts * n)

    def points(self, guess: float) -> dict[str, tuple[float, float]]:
        """Mach numbers and lifts by names of conditions, such as ``mach_073``, with lifts in the names if needed."""
        found = list(zip(*self._both(guess)))
        has_lifts = len({mach for mach, _ in found}) < len(found)
        return {
            f"mach_{_digits(mach)}{f'_lift_{_digits(lift)}' if has_lifts else ''}": (mach, lift) for mach, lift in found
        }


def _digits(number: float) -> str:
    """A number as a part of a name: with two decimals, or with those that it has."""
    text = f"{number:.2f}" if round(number, 2) == number else f"{number:g}"
    return text.replace(".", "").replace("-", "minus_")


def study_draft(
    name: str,  # name of the grid, or of the model, as written in the study
    patches: str | None,  # patches file as written in the study
    body: Body,  # its walls
    box_file: str = "",  # file with free-form boxes as written in the study; empty if there is none
    boxes: Sequence[str] = (),  # names of the boxes in it
    aim: Aim | None = None,  # flight conditions and objective of a section; guessed by default
    cad_file: str = "",  # CAD file of the walls as written in the study; empty if there is none
    cad_faces: Sequence[str] = (),  # names of the faces in it
) -> str:  # TOML
    """Write the draft of a study."""
    if aim is not None and not _is_flown(body):
        reason = f": {_line(body.why_no_euler)}" if body.is_section else ""
        raise InputError(
            f"{name}: is no section in Euler flow{reason}; --mach, --lift and --lift-to-drag are of airfoils: leave "
            f"them out, and set what you want in the draft"
        )
    aim = aim or Aim()
    free_form = list(_free_form(body, box_file, boxes))
    has_flow = body.is_wing or _is_flown(body)
    lines = [
        f"# A study of {name}: run it by 'bspline-mdao optimize THIS_FILE -o out'.",
        "# Everything below is a guess or a default: check it, above all where it says 'guessed' or 'set yours'.",
        "",
        "[grid]",
        f"file = {json.dumps(name)}",
        *([f"patches = {json.dumps(patches)}"] if patches else []),
        *_walls(body),
        "",
        *_design(body, free_form, aim, list(_cad(body, cad_file, cad_faces)) if cad_file else []),
        *_cells(body),
        "[driver]",
        'optimizer = "LD_SLSQP"  # of NLopt; SciPy has SLSQP',
        # shapes change by thousandths, drag by percents; for lift over drag hundredths of 1 are enough
        f"tolerance = {1e-4 if aim.is_ratio else 1e-6 if has_flow else 1e-8:g}",
        "max_iterations = 50",
        *(_end(aim) if body.is_section and has_flow else ()),
    ]
    return "\n".join(lines) + "\n"


def _walls(body: Body) -> Iterator[str]:
    """The walls to design, and the walls to measure."""
    if body.design == body.walls:
        yield f"# design = {json.dumps(list(body.walls))}  # the walls; name only those that are to be designed"
        return
    others = ", ".join(name for name in body.walls if name not in body.design)
    yield f"design = {json.dumps(list(body.design))}  # guessed: thin, like a wing; fixed: {others}"


def _is_flown(body: Body) -> bool:
    """Whether it is a section with an available flow."""
    return body.is_section and not body.why_no_euler


def _design(body: Body, free_form: list[str], aim: Aim, cad: list[str]) -> Iterator[str]:
    """Variables, flow, objective and constraints; with a CAD file its control points replace other variables."""
    if body.is_wing:
        return _wing(body, cad or list(_twist()), [] if cad else [*_planform(body), *free_form])
    if _is_flown(body):
        return _section(body, cad or [*_curve(), *free_form], aim)
    return _shape(body, cad or [*(_points(body) if body.moves_points else _box(body)), *free_form])


def _cad(body: Body, file: str, faces: Sequence[str]) -> Iterator[str]:
    """Control points of the faces of a CAD file."""
    yield "[variables.shape]"
    yield 'kind = "cad_points"  # control points of faces; the optimum is written to a file with the same names'
    yield f"file = {json.dumps(file)}"
    yield f"faces = {json.dumps(list(dict.fromkeys(faces)))}  # all faces: name those that move"
    yield f'direction = "{axes_text(body.frame.axes[1:2])}"  # up, guessed; or several of x, y and z'
    yield "# low = [-inf, -inf, -inf]  # corners of a box; only points in it move"
    yield "# high = [inf, inf, inf]"
    yield from _bounds(body.frame.chord, "the chord")


def _curve() -> Iterator[str]:
    """The section as one curve."""
    yield "[variables.shape]  # the section as one curve; or hicks_henne, camber_modes, thickness_modes"
    yield 'kind = "class_shape"  # weights in chords: nose, upper side, lower side'
    yield "degree = 5  # if weak shocks remain, as ripples of the pressure, try 8: twice the evaluations"
    yield f"lower = {-SHAPE}"
    yield f"upper = {SHAPE}"
    yield ""


def _section(body: Body, variables: list[str], aim: Aim) -> Iterator[str]:
    """Variables, flow, objective, area and thickness of a section."""
    yield from variables
    yield from _ratio(body, aim) if aim.is_ratio else _least_drag(body, aim)
    yield "[constraints.section_area]  # divided by the baseline's"
    yield "equals = 1.0  # thickness costs no drag without friction: with lower = 1.0 the section grows"
    yield ""
    yield "[constraints.section_thickness]  # a smooth bound of the largest thickness over chord"
    yield f"equals = {body.thickness:.8f}  # the baseline's"
    yield ""
    yield "[constraints.thickness]  # at fractions of the chord, divided by the baseline's"
    yield "lower = 0.8"
    yield ""
    yield "[measures.thickness]"
    yield 'kind = "thickness_at"'
    yield "parts = [0.02, 0.1, 0.25, 0.4, 0.6, 0.75, 0.9, 0.97]"
    yield ""


def _least_drag(body: Body, aim: Aim) -> Iterator[str]:
    """Flow and objective: drag at a lift, or the mean of several."""
    points = aim.points(body.drag_rise)
    (mach, lift), *others = points.values()
    yield "[flow]"
    yield 'kind = "euler"'
    yield "trim = true  # solves for the angle of attack, so that all designs have the same lift"
    yield f"CL_target = {lift:g}  # set yours; cl, per unit span and chord"
    yield from _mach_number(mach, aim)
    yield from _frame(body)
    if others:
        for name, (mach, lift) in points.items():
            yield from _condition(name, mach, [f"CL_target = {lift:g}"], "drags")
    else:
        yield "# [conditions.faster]  # a table per flight condition, see init --mach"
        yield f"# Mach_number = {mach + 0.02:.2f}"
        yield "# weight = 0.5"
        yield ""
    yield "[objective]"
    yield 'of = "CD"  # cd; at fixed lift the least drag is the largest CL / CD'
    yield ""


def _ratio(body: Body, aim: Aim) -> Iterator[str]:
    """Flow and objective: lift over drag at any angle, or the mean of several."""
    points = aim.points(body.drag_rise)
    yield "[variables.alpha]  # angle of attack, degrees; the lift follows"
    yield f"lower = {ALPHA - 5.0}"
    yield f"upper = {ALPHA + 3.0}"
    yield ""
    yield "[flow]"
    yield 'kind = "euler"'
    yield f"alpha = {ALPHA - 1.0}  # of the baseline, degrees"
    (mach, _), *others = points.values()
    yield from _mach_number(mach, aim)
    yield from _frame(body)
    if others:
        for name, (mach, _) in points.items():
            yield from _condition(name, mach, [], "ratios")
    ratios = [f"{name}.CL / ({name}.CD + {FRICTION})" for name in points] if others else [f"CL / (CD + {FRICTION})"]
    yield "[objective]"
    yield f'of = "{" + ".join(ratios)}"  # {FRICTION}: friction drag, which this flow does not have; set yours'
    yield "maximize = true"
    yield f"ref = {10.0 * len(ratios):g}"
    yield ""


def _mach_number(mach: float, aim: Aim) -> Iterator[str]:
    """Mach number of the flow, and whether it is a guess."""
    guessed = "" if aim.machs else "  # set yours: guessed from the thickness, so that there is a shock"
    yield f"Mach_number = {mach:g}{guessed}"


def _condition(name: str, mach: float, more: list[str], summed: str) -> Iterator[str]:
    """One of several flight conditions whose numbers the objective averages."""
    yield f"[conditions.{name}]"
    yield f"Mach_number = {mach:g}"
    yield from more
    yield f"weight = 1.0  # in the objective, the mean of {summed}"
    yield ""


def _axes(body: Body) -> Iterator[str]:
    """Axes, and whether the grid seems to lie the other way round."""
    if body.axes and body.why_backwards:
        yield f"# {body.why_backwards}:"
        yield "# turn the grid by 180 degrees first"
    if body.axes and body.plane_off:
        yield f"# flows need the plane of symmetry at {body.axes[1]} = 0, and it is at {body.plane_off:g}:"
        yield "# shift the grid first"
    yield f'axes = "{body.axes}"  # downstream, along the span, up: guessed from the box of the walls'


def _frame(body: Body) -> Iterator[str]:
    """Axes and references of a section."""
    yield from _axes(body)
    yield f"# reference_area = {body.area:.6g}  # chord times depth of the grid, the default"
    yield ""


def _end(aim: Aim) -> Iterator[str]:
    """The stopping criteria for a section, and the confirmation of the result."""
    if not aim.is_ratio:
        yield ""
        yield "[driver.options]"
        yield f"ftol_abs = {LITTLE:g}  # of the scaled drag: stops at changes of 0.02 counts"
    yield ""
    yield "[output]"
    yield f"solved_on = {CONFIRMED}  # factor on the cells per direction: flows before and after on a finer grid"
    yield "estimate_errors = false  # the finer grid is solved instead"


def _twist() -> Iterator[str]:
    """Twist of a wing."""
    yield "[variables.twist]  # degrees at stations from root to tip, nose up"
    yield "stations = 3  # few: with more the twist oscillates, for gains that another flow model does not show"
    yield "values = [2, 3]  # the root stays: the angle of attack rotates the whole wing"
    yield "lower = -6.0"
    yield "upper = 6.0"
    yield ""


def _planform(body: Body) -> Iterator[str]:
    """Further variables of a wing, as comments."""
    yield "# [variables.chord]  # factors; or sweep, dihedral, span, taper, camber, thickness"
    yield "# stations = 3"
    yield "# lower = 0.7"
    yield "# upper = 1.3"
    yield ""
    yield "# [variables.flap]  # flap angle about a hinge at a fraction of the chord, degrees, trailing edge down"
    yield '# kind = "rotation"'
    yield "# chord = 0.75"
    yield "# span = [0.3, 0.6]"
    yield f"# blend = {float(f'{0.05 * body.frame.chord:.1g}')}  # fades ahead of the hinge; give patches for a gap"
    yield "# lower = -10.0"
    yield "# upper = 10.0"
    yield ""


def _wing(body: Body, variables: list[str], others: list[str]) -> Iterator[str]:
    """Variables, flow, objective and lift of a wing."""
    yield from variables
    if not body.why_no_lattice:
        yield "[variables.alpha]  # angle of attack, degrees, for the lift constraint"
        yield f"lower = {ALPHA - 6.0}"
        yield f"upper = {ALPHA + 6.0}"
        yield ""
    yield from others
    yield "[flow]"
    if body.why_no_lattice:
        yield f'kind = "euler"  # guessed: no vortex lattice, for {_line(body.why_no_lattice)}'
        yield "trim = true  # solves for the angle of attack, so that all designs have the same lift"
        yield f"CL_target = {body.elliptical_lift}  # set yours: about the lift at {ALPHA:g} degrees"
    else:
        yield from _lattice(body)
        yield f"alpha = {ALPHA}  # angle of attack of the baseline, degrees: set yours, and its lift below"
    known = EULER if body.why_no_lattice else LATTICE
    yield f"Mach_number = {MACH}  # set yours; {known.lowest:g} to {known.highest:g} were compared with others"
    yield from _axes(body)
    yield f"# reference_area = {body.area:.6g}  # planform area of the walls in units of the grid, the default"
    chord = body.area / np.ptp(body.surface.points @ body.frame.axes[2])
    yield f"# reference_chord = {chord:.6g}  # area by span, for moments; the default is 1"
    yield ""
    yield "# [conditions.cruise]  # a table per flight condition; the objective is their mean"
    yield f"# Mach_number = {MACH}"
    yield "# weight = 2.0"
    yield ""
    yield "[objective]"
    yield 'of = "CD_induced"  # the pressure drag CD includes errors of the grid'
    yield ""
    if not body.why_no_lattice:
        yield "[constraints.CL]"
        if body.lattice_lift is None:
            yield f"equals = {body.elliptical_lift}  # set yours: not computed, estimated for an elliptical load; with"
            yield f"# OpenAeroStruct ({INSTALL.format(extra='vlm')}) init computes the lift of the baseline"
        else:
            yield f"equals = {body.lattice_lift}  # the baseline's lift, for a fair comparison"
        yield ""
    if not body.why_no_volume:
        yield "# [constraints.volume]  # divided by the baseline's"
        yield "# lower = 1.0"
        yield ""


def _lattice(body: Body) -> Iterator[str]:
    """Kind of the flow, and the alternatives."""
    if body.moves_points:
        yield 'kind = "lattice"  # guessed: half a wing; "euler" for the Euler equations on the grid, with'
        yield "# trim = true and CL_target instead of alpha, [variables.alpha] and [constraints.CL]"
    else:
        yield f'kind = "lattice"  # guessed: half a wing; {_line(body.why_no_euler)}'


def _shape(body: Body, variables: list[str]) -> Iterator[str]:
    """Variables, objective and volume of a body without an available flow."""
    lack = body.why_no_lattice if body.is_thin or body.is_section else "the walls are no wing"
    yield f"# No [flow] was drafted: {_line(lack)};"
    yield f"# {_line(body.why_no_euler) or 'lift and drag of wings and sections alone are drafted'}."
    yield "# The objective is the wetted area: replace it by yours, or connect your own solver in Python."
    yield ""
    yield from variables
    yield "[objective]"
    yield 'of = "surface_area"'
    yield "ref = 0.01  # it is 1 on the baseline; small changes matter"
    yield ""
    if body.why_no_volume:
        yield f"# no constraint on the volume: {_line(body.why_no_volume)}"
        yield "[constraints.planform_area]  # divided by the baseline's"
    else:
        yield f"[constraints.volume]  # divided by the baseline's{': its area' if body.is_section else ''}"
    yield "lower = 1.0"
    yield ""
    if body.design != body.walls and not body.why_no_volume:
        yield "[measures.volume]"
        yield f"patches = {json.dumps(list(body.walls))}  # all walls: the designed ones are not closed"
        yield ""
    if body.is_thin and not (body.is_section or body.moves_points or body.why_no_volume):
        yield "[constraints.planform_area]  # divided by the baseline's"
        yield "lower = 1.0"
        yield ""


def _points(body: Body) -> Iterator[str]:
    """The control points of the walls."""
    yield "[variables.shape]"
    yield 'kind = "control_points"'
    yield 'direction = "normal"'
    yield from _bounds(body.surface.size, "the size of the walls")


def _box(body: Body) -> Iterator[str]:
    """Points of a box around the walls, without those that move its ends along the stream: no rotations and shifts."""
    stream, up, span = np.abs(body.frame.axes).argmax(axis=1).tolist()
    n, slices, ends = [0, 0, 0], [":", ":", ":"], "nose and tail"
    n[stream], n[up], n[span] = (6, 2, 2) if body.is_section else (5, 2, 5) if body.is_thin else (4, 3, 3)
    slices[stream] = "1:-1"
    if body.is_section:
        slices[span], ends = "0", "nose and tail; points of one plane only, as the other moves alike"
    elif body.design != body.walls:
        slices[span] = "2:" if body.frame.axes[2, span] > 0.0 else ":-2"
        ends = "leading and trailing edge, or the root"
    yield "[variables.shape]"
    yield 'kind = "lattice"  # points of a box around the walls, in x, y and z'
    yield f"n = {n}"
    yield f'where = "{", ".join(slices)}"  # none that moves {ends}'
    if body.is_thin or body.is_section:
        yield f'direction = "{"xyz"[up]}"  # up; or several of x, y and z'
        yield from _bounds(body.frame.chord, "the chord")
    else:
        yield from _bounds(body.surface.size, "the size of the walls")
    if body.is_thin and not body.is_section:
        yield "[variables.chord]  # factors; or twist, sweep, dihedral, span, taper, camber, thickness"
        yield "stations = 4  # from root to tip"
        yield "values = [2, 3, 4]  # the root stays"
        yield "lower = 0.7"
        yield "upper = 1.3"
        yield ""


def _free_form(body: Body, box_file: str, boxes: Sequence[str]) -> Iterator[str]:
    """Free-form variables instead of the above, or in addition, as comments."""
    yield "# [variables.free_form]  # instead of the above, or in addition"
    if boxes:
        yield '# kind = "ffd"  # a box in the mesh file'
        yield f"# file = {json.dumps(box_file)}"
        yield f"# box = {json.dumps(boxes[0])}" + (f"  # or {', '.join(boxes[1:])}" if boxes[1:] else "")
    else:
        yield '# kind = "lattice"  # points of a box around the walls; "ffd" for one in a file: of pyGeo, DAFoam or SU2'
    if not body.moves_points:
        yield '# or kind = "free_lattice": points of the lattice that moves the mesh, those near the walls'
    yield from (f"# {line}".rstrip("# ") for line in _bounds(body.frame.chord, "the chord"))


def _bounds(length: float, of: str) -> Iterator[str]:
    """Bounds of displacements, relative to a length."""
    size = float(f"{0.01 * length:.1g}")
    yield f"lower = {-size}  # about a hundredth of {of}, {length:.4g}, in units of the grid"
    yield f"upper = {size}"
    yield ""


def _cells(body: Body) -> Iterator[str]:
    """Constraint of the cells, which the baseline satisfies."""
    name, worst = body.aggregate, body.worst
    if worst <= 0.0:
        yield f"# no constraint on the cells: {name} of the grid as it is is {worst:.2g}, folded or nearly so"
    else:
        lower = CORNER if worst > 2.0 * CORNER else float(f"{0.5 * worst:.1g}")
        yield f"[constraints.{name}]  # no cell may fold: {worst:.2g} on the grid as it is"
        yield f"lower = {lower}"
    yield ""
    if not body.moves_points:
        yield "# [constraints.height_low_ks]  # and height_high_ks: heights of first nodes, divided by the baseline's"
        yield "# lower = 0.9"
        yield ""


def _line(text: str) -> str:
    """Text of a message as part of a comment."""
    return " ".join(text.split()).removeprefix("camber surface: ")
