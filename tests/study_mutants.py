"""Studies with random mistakes in them: in values, keys, tables, lines and letters."""

import re

from unusable_studies import BASE

CONDITIONS = """\
[grid]
file = "@onera_m6:7x7x5"
n_control = [5, 5, 5]
fixed = "farfield*"

[variables.alpha]
lower = 0.0
upper = [8.0, 9.0]
start = [2.0, 4.0]

[variables.twist]
stations = [0.0, 0.5, 1.0]
values = [2, 3]
lower = [-3.0, -2.0]
upper = 3.0
ref = 1.5

[flow]
kind = "lattice"
n_chord = 3
n_span = 5
reference_area = 1.16
moment_reference = [0.25, 0.0, 0.0]

[conditions.cruise]
Mach_number = 0.5
weight = 2

[conditions.climb]
alpha = 3.0

[objective]
of = "CD_induced + 0.01 * climb.CL ** 2"

[constraints.cruise.CL]
equals = 0.2

[constraints.both]
of = "climb.CL / (cruise.CL + 0.1)"
lower = 0.5
upper = 3.0

[driver]
optimizer = "SLSQP"
tolerance = 1e-6
max_iterations = 2
options = { disp = false }

[output]
report = false
"""

SHAPE = """\
[grid]
file = "@onera_m6:7x7x5"
n_control = [5, 5, 5]

[variables.chord]
at = 0.5
stations = 2
order = 2
lower = 0.8
upper = 1.2
scales_thickness = false

[variables.bumps]
kind = "control_points"
patches = "wing_upper"
direction = "y"
lower = -0.01
upper = 0.01

[measures.sections]
kind = "section_thickness"
stations = [0.2, 0.6]
smallest = true

[objective]
of = "surface_area"
maximize = false

[constraints.volume]
lower = 0.9

[constraints.sections]
lower = 0.001

[constraints.corner_ks]
lower = 0.001

[movement]
mover = "elasticity"
increments = 2
poisson_ratio = 0.1

[driver]
optimizer = "LD_MMA"
max_iterations = 2

[driver.options]
disp = false
constraint_tolerance = 1e-4

[output]
grid = "vtm"
report = false
"""

GOOD = (BASE, CONDITIONS, SHAPE)
"""Studies that are good."""

VALUES = [
    *("nan", "inf", "-inf", "0", "-1", "1", "3", "1e308", "-1e308", "1e-320", "1e19", "0.0", "-0.0"),
    *("99999999999999999999", '["wing_upper", "a"]'),
    *("true", "false", "[]", "[1]", "[[1]]", "{}", "{ a = 1 }", "2024-05-01", "07:32:00", "2024-05-01T07:32:00Z"),
    *('""', '" "', '"a"', '"CL"', '"CD_induced"', '"volume + CL"', '"CL/0"', '"9**9**9"', '"(((CL)))"', '"lambda: 1"'),
    *('"../x.xyz"', '"@flat_plate:5x5x5"', '"euler"', '"normal"', '"xyz"', '"*"', '"0,0,0"', '":,:,::-1"', '"wing_*"'),
    *("[0.0, 1.0]", "[1.0, 0.0]", "[0.5, 0.5]", "[2, 2, 2]", "[1e19, -1e19]", "\"\"\"\n'''\"\"\""),
    *('"elasticity"', '"LN_COBYLA"', '"AUGLAG"', '"GN_ISRES"', '"COBYLA"', '"TNC"', '"trust-constr"', '"LD_LBFGS"'),
]  # fmt: skip
KEYS = [
    *("kind", "lower", "upper", "start", "ref", "at", "stations", "order", "values", "of", "equals", "alpha", "weight"),
    *("n", "where", "margin", "direction", "patches", "n_chord", "n_span", "trim", "CL_target", "design", "released"),
    *("tolerance", "maxtime", "seed", "options", "local_optimizer", "corrections", "relative", "comoving", "a b"),
    *("sliding", "initial_step", "population", "debug_print", "maxiter", "tol", "axes", "parameters", "smallest"),
    *("lambda", "fixed"),
]  # fmt: skip
TABLES = ("measures.sin", "variables.twist", "conditions.options", "constraints.cruise.CD", "flow", "measures.volume")
NUMBER = re.compile(r"-?\b\d+(\.\d*)?(e-?\d+)?")
LETTERS = "\"'[]{}=.,#\n\\ \tx9-+*/()é\x00"


def mutant(rng):
    """One of the good studies with one or two mistakes, from a random generator."""
    lines = GOOD[rng.integers(len(GOOD))].splitlines()
    for _ in range(pick(rng, [1, 1, 1, 2])):
        lines = MUTATIONS[rng.integers(len(MUTATIONS))](rng, lines)
    return "\n".join(lines) + "\n"


def pick(rng, things):
    """One of several things."""
    return things[int(rng.integers(len(things)))]


def _place(rng, lines, mark):
    """Number of a line with a mark in it."""
    return pick(rng, [n for n, line in enumerate(lines) if mark in line] or [0])


def other_value(rng, lines):
    """Another value of a key."""
    n = _place(rng, lines, "=")
    return [*lines[:n], f"{lines[n].partition('=')[0]}= {pick(rng, VALUES)}", *lines[n + 1 :]]


def other_key(rng, lines):
    """Another key of a value."""
    n = _place(rng, lines, "=")
    key = pick(rng, KEYS)
    return [*lines[:n], f"{key if key.isidentifier() else repr(key)} ={lines[n].partition('=')[2]}", *lines[n + 1 :]]


def more(rng, lines):
    """A key more."""
    n = _place(rng, lines, "=")
    return [*lines[:n], f"{pick(rng, KEYS[:-1])} = {pick(rng, VALUES)}".replace("a b", "a-b"), *lines[n:]]


def scaled(rng, lines):
    """A number of another size or sign."""
    n = pick(rng, [n for n, line in enumerate(lines) if NUMBER.search(line.partition("=")[2])] or [0])
    key, sign, value = lines[n].partition("=")
    found = pick(rng, list(NUMBER.finditer(value)) or [re.match("", value)])
    if not found[0]:
        return lines
    factor = pick(rng, [0, -1, 2, 3, 10, 1000, 10**6, 0.1, 0.5, 1e-3, 1e-6, 1e12])
    other = repr(factor * (float(found[0]) if "." in found[0] or "e" in found[0] else int(found[0])))
    return [*lines[:n], f"{key}{sign}{value[: found.start()]}{other}{value[found.end() :]}", *lines[n + 1 :]]


def without(rng, lines):
    """A line less."""
    n = int(rng.integers(len(lines)))
    return lines[:n] + lines[n + 1 :]


def elsewhere(rng, lines):
    """A line at another place as well, or instead."""
    n, m = int(rng.integers(len(lines))), int(rng.integers(len(lines)))
    rest = lines if rng.integers(2) else lines[:n] + lines[n + 1 :]
    return [*rest[:m], lines[n], *rest[m:]]


def other_table(rng, lines):
    """Another name of a table."""
    n = _place(rng, lines, "[")
    names = (
        "measures.sin",
        "variables.twist",
        "conditions.options",
        "constraints.cruise.CD",
        "flow",
        "measures.volume",
    )
    return [*lines[:n], f"[{pick(rng, names)}]", *lines[n + 1 :]]


def other_letters(rng, lines):
    """Letters more, less or instead."""
    text = "\n".join(lines)
    for _ in range(int(rng.integers(1, 4))):
        n = int(rng.integers(len(text)))
        text = text[:n] + (pick(rng, LETTERS) if rng.integers(3) else "") + text[n + int(rng.integers(2)) :]
    return text.split("\n")


MUTATIONS = (
    *(other_value, other_value, other_key, more, more, without, elsewhere, other_table, other_letters),
    *(scaled, scaled, scaled, scaled),
)
