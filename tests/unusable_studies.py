"""Studies that cannot be used, as edits of one that can, with the line of the key that is to blame and what is said."""

BASE = """\
[grid]
file = "@onera_m6:7x7x5"
n_control = [5, 5, 5]

[variables.twist]
stations = 3
lower = -6.0
upper = 6.0

[variables.bumps]
kind = "lattice"
n = [4, 3, 3]
where = ":, :, 1:"
lower = -0.01
upper = 0.01

[flow]
kind = "lattice"
n_chord = 3
n_span = 5

[objective]
of = "CD_induced"

[constraints.CL]
equals = 0.22

[measures.volume]
relative = true

[constraints.corner_ks]
lower = 0.01

[driver]
optimizer = "LD_SLSQP"
max_iterations = 2

[driver.options]
disp = false

[output]
report = false
"""
"""A study that is good."""

OBJECTIVE, OPTIONS, DRIVER = 'of = "CD_induced"', "disp = false", 'optimizer = "LD_SLSQP"'
WHERE, CL, GRID = 'where = ":, :, 1:"', "equals = 0.22", '"@onera_m6:7x7x5"'


def _of(text: str) -> tuple[str, str]:
    return OBJECTIVE, f'of = "{text}"'


def _option(text: str) -> tuple[str, str]:
    return OPTIONS, text


UNUSABLE: dict[str, tuple[tuple[str, str], int | None]] = {
    # options of drivers
    "code in the name of an option": (
        _option("\"maxtime=__import__('os').system('touch ran') or 5.0, stopval\" = 1.0"), 39),
    "unknown option": (_option("max_time = 3.0"), 39),
    "option of another driver": (_option("debug = 1"), 39),
    "option with a dash": (_option('"max-time" = 3.0'), 39),
    "option that is a keyword of Python": (_option("lambda = 3.0"), 39),
    "option of an empty name": (_option('"" = 3.0'), 39),
    "text for a number": (_option('maxtime = "5"'), 39),
    "nan": (_option("maxtime = nan"), 39),
    "inf": (_option("stopval = inf"), 39),
    "minus inf": (_option("stopval = -inf"), 39),
    "date": (_option("maxtime = 2024-05-01"), 39),
    "time": (_option("maxtime = 07:32:00"), 39),
    "date and time": (_option("maxtime = 2024-05-01T07:32:00Z"), 39),
    "list for a number": (_option("maxtime = [1.0]"), 39),
    "table for a number": (_option("maxtime = { a = 1 }"), 39),
    "number for a flag": (_option("disp = 3"), 39),
    "true for a number": (_option("maxtime = true"), 39),
    "true for a whole number": (_option("restarts = true"), 39),
    "negative option": (_option("maxtime = -1.0"), 39),
    "huge whole number": (_option("population = 99999999999999999999"), 39),
    "huge seed": (_option("seed = 999999999999999999999999"), 39),
    "huge population": (_option("population = 2000000000"), 39),
    "negative seed": (_option("seed = -1"), 39),
    "first step of zero": (_option("initial_step = 0.0"), 39),
    "first step backwards": (_option("initial_step = -1.0"), 39),
    "negative tolerance": (_option("xtol_abs = -1.0"), 39),
    "list of a list to print": (_option('debug_print = [["objs"]]'), 39),
    "unknown choice": (_option('local_optimizer = "LD_FOO"'), 39),
    "local optimizer where there is none": (_option('local_optimizer = "LD_MMA"'), 34),
    "parameter that is a text": (_option('parameters = { inner_maxeval = "a" }'), 39),
    "parameter of an odd name": (_option('parameters = { "a b" = [1] }'), 39),
    "list for one of each variable": (_option("xtol_abs = [1.0, 2.0]"), 39),
    "unknown print": (_option('debug_print = ["all"]'), 39),
    "date as an option of SciPy": ((f"{DRIVER}\nmax_iterations = 2\n\n[driver.options]\ndisp = false",
                                    'optimizer = "SLSQP"\n\n[driver.options]\ndisp = 2024-05-01'), 38),
    "options that are a list": (("\n[driver.options]\ndisp = false", "options = [1]"), 37),
    # slices
    "step of zero": ((WHERE, 'where = "0:3:0,:,:"'), 13),
    "two signs": ((WHERE, 'where = "--1:,:,:"'), 13),
    "sign alone": ((WHERE, 'where = "-,:,:"'), 13),
    "four parts": ((WHERE, 'where = "0:1:2:3,:,:"'), 13),
    "index outside": ((WHERE, 'where = "7,:,:"'), 13),
    "no points": ((WHERE, 'where = "4:,:,:"'), 13),
    "digits without end": ((WHERE, f'where = "{"9" * 5000}:,:,:"'), 13),
    # numbers
    "bounds of 1e308": (("lower = -6.0\nupper = 6.0", "lower = -1e308\nupper = 1e308"), 7),
    "lower bound of 1e308": (("lower = -0.01", "lower = -1e308"), 14),
    "bound of a constraint of 1e308": ((CL, "equals = 1e308"), 26),
    "whole number of 400 digits as a bound": (("upper = 6.0", f"upper = {'9' * 400}"), 8),
    "nan as a bound": (("upper = 6.0", "upper = nan"), 8),
    "ref that is next to nothing": (("upper = 6.0", "upper = 6.0\nref = 1e-320"), 9),
    "most iterations that no counter holds": (("max_iterations = 2", "max_iterations = 99999999999"), 36),
    "supersonic lattice": (("n_chord = 3", "Mach_number = 1.5"), 19),
    "date as a bound": (("upper = 6.0", "upper = 2024-05-01"), 8),
    "list in a list": (("upper = 6.0", "upper = [[6.0]]"), 8),
    "Mach number of 1e29": (("n_chord = 3", "Mach_number = 1e29"), 19),
    # names
    "measure called sin": (("[measures.volume]\nrelative = true",
                            '[measures.sin]\nkind = "volume"\n[constraints.sum]\nof = "sin + CL"\nlower = 0.1'), 28),
    "measure called e": (("[measures.volume]", '[measures.e]\nkind = "volume"'), 28),
    "measure called numpy": (("[measures.volume]", '[measures.numpy]\nkind = "volume"'), 28),
    "measure called lambda": (("[measures.volume]", '[measures.lambda]\nkind = "volume"'), 28),
    "variable called None": (("[variables.twist]", '[variables.None]\nkind = "twist"'), 5),
    "variable called __class__": (("[variables.twist]", '[variables.__class__]\nkind = "twist"'), 5),
    "variable with a letter that Python reads as another": (
        ("[variables.twist]", '[variables."\ufb01"]\nkind = "twist"'), 5),
    "measure called units": (
        ("[measures.volume]\nrelative = true",
         '[measures.units]\nkind = "volume"\n[constraints.a]\nof = "units + CL"\nlower = 0.1'), 28),
    "measure with the name of an expression": (
        ("[measures.volume]\nrelative = true",
         '[measures.a_value]\nkind = "volume"\n[constraints.a]\nof = "CL + CD"\nlower = 0.1'), 28),
    "constraint called objective": (
        ("[constraints.CL]", '[constraints.objective]\nof = "CL + CD"'), 25),
    "two constraints on one thing": (
        ("[constraints.CL]", '[constraints.lift]\nof = "CL"\nupper = 0.5\n[constraints.CL]'), 28),
    "objective that is a constraint as well": (("[constraints.CL]", "[constraints.CD_induced]"), 25),
    # expressions
    "150 nested brackets": (_of("(" * 150 + "CD" + ")" * 150), 23),
    "5,000 nested brackets": (_of("(" * 5000 + "CD" + ")" * 5000), 23),
    "20,000 terms": (_of(" + ".join(["CD"] * 20000)), 23),
    "5,000 signs": (_of("-" * 5000 + "CD"), 23),
    "powers of powers": (_of("CD*9**9**9**9"), 23),
    "power of whole numbers": (_of("CD + 10**10000000000"), 23),
    "product without end": (_of("CD * 1e200 * 1e200 + 1e200*1e200"), 23),
    "division by zero": (_of("CD / 0"), 23),
    "division by what is zero": (_of("CD / (1 - 1)"), 23),
    "root of a negative number": (_of("CD + (-8)**0.5"), 23),
    "number with a base": (_of("CD * 0x10"), 23),
    "floor division": (_of("CD // 2"), 23),
    "no name": (_of("2 + 3"), 23),
    "call": (_of("__import__('os').system('touch ran')"), 23),
    "attribute of a class": (_of("CD.__class__"), 23),
    "line break": (("of = \"CD_induced\"", 'of = "CD\\nCL"'), 23),
    "null byte in an expression": (_of("CD + \\u0000"), 23),
    "expression of blanks": (_of("   "), 23),
    # sizes
    "lattice of 100,000 x 100,000": (("n_chord = 3\nn_span = 5", "n_chord = 100000\nn_span = 100000"), 19),
    "lattice that is too much in all": (("n_chord = 3\nn_span = 5", "n_chord = 50\nn_span = 100"), 20),
    "moments about a point far away": (("n_chord = 3", "moment_reference = [1e18, 0.0, 0.0]"), 19),
    "free-form lattice of 10^15 points": (("n = [4, 3, 3]", "n = [100000, 100000, 100000]"), 12),
    "10^9 stations": (("stations = 3", "stations = 1000000000"), 6),
    "thickness on 10^10 lines": (("[measures.volume]\nrelative = true",
                                  "[measures.thickness]\nn_chord = 100000\nn_span = 100000\n"
                                  "[constraints.thickness]\nlower = 0.5"), 29),
    "10^12 cycles of correction": (("n_control = [5, 5, 5]", "corrections = 1000000000000"), 3),
    "order of a million": (("n_control = [5, 5, 5]", "order = 1000000"), 3),
    "10^9 increments": (("[output]", '[movement]\nmover = "elasticity"\nincrements = 1000000000\n[output]'), 43),
    # the grid and files
    "file with quotes": ((GRID, "'wing\"\"\"\nimport os\n.xyz'".replace("\n", "")), 2),
    "file with a null byte": ((GRID, '"wing\\u0000.xyz"'), 2),
    "file with a name without end": ((GRID, f'"{"w" * 5000}.xyz"'), 2),
    "built-in grid of digits without end": ((GRID, f'"@onera_m6:{"9" * 5000}x7x5"'), 2),
    "no built-in grid": ((GRID, '"@m6"'), 2),
    "folder as a file": ((GRID, '"."'), 2),
    # TOML
    "table that is a number": (("[variables.twist]", "[variables]\nbad = 1\n[variables.twist]"), 6),
    "kind that is a list": (('kind = "lattice"\nn = ', 'kind = ["lattice"]\nn = '), 11),
    "flow that is a list of tables": (("[flow]", "[[flow]]"), 17),
    "kind of a flow that is a table": (('kind = "lattice"\nn_chord', "kind = { a = 1 }\nn_chord"), 18),
    "name of a key in quotes with an escape": (("stations = 3", '"stat\\u0069ons\\n" = 3'), 6),
    "10,000 nested lists": (("stations = 3", f"stations = {'[' * 10000}{']' * 10000}"), None),
}  # fmt: skip
"""Edit of `BASE` and line by name; no line where that is the parser's affair."""


def edited(edit: tuple[str, str]) -> str:
    """Text of the study with an edit, which has to find its place."""
    before, after = edit
    assert BASE.count(before) == 1, before
    return BASE.replace(before, after)
