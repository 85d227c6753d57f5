"""A small optimisation that is recorded with all that a report shows, and damage to its case file."""

import json
import pickle
import re
import sqlite3
import zlib
from contextlib import closing, contextmanager
from io import BytesIO

import numpy as np
import openmdao.api as om
from fuzz_cases import MUTATIONS_OF_LINES, mutate

from bspline_mdao import NLoptDriver, fit_grid
from bspline_mdao.core.om.model_option import declare_model
from bspline_mdao.generators import ball_grid


class StretchedBall(om.ExplicitComponent):
    """A ball that is stretched: control points, and two functions of how much."""

    def initialize(self):
        declare_model(self)
        self.options.declare("axes", default="xzy")

    def setup(self):
        self.add_input("stretch", np.ones(3))
        self.add_output("control_points", np.zeros(self.options["model"].control_points.size))
        self.add_output("volume", 1.0)
        self.add_output("skew", np.zeros(2))
        self.declare_partials(["volume", "skew"], "stretch")

    def compute(self, inputs, outputs):
        x = inputs["stretch"]
        outputs["control_points"] = (self.options["model"].control_points * x).ravel()
        outputs["volume"] = np.prod(x)
        outputs["skew"] = x[1:] ** 2 - x[0]

    def compute_partials(self, inputs, partials):
        x = inputs["stretch"]
        partials["volume", "stretch"] = np.prod(x) / x
        partials["skew", "stretch"] = np.array([[-1.0, 2.0 * x[1], 0.0], [-1.0, 0.0, 2.0 * x[2]]])


def stretched_ball(model):
    """A problem that is not yet set up."""
    problem = om.Problem(driver=NLoptDriver(maxeval=4, disp=False), reports=None)
    problem.model.add_subsystem("ball", StretchedBall(model=model), promotes=["*"])
    problem.model.add_design_var("stretch", lower=0.5, upper=[1.5, 1.25, 2.0])
    problem.model.add_objective("volume", ref=2.0)
    problem.model.add_constraint("skew", lower=-0.25)
    return problem


def record_ball(folder):
    """Run the problem; return its case file and the model, which is saved beside it."""
    model, file = fit_grid(ball_grid((4, 4, 4, 3), far=4.0)), folder / "cases.sql"
    model.save(folder / "ball.h5")
    problem = stretched_ball(model)
    problem.driver.add_recorder(om.SqliteRecorder(file))
    problem.driver.recording_options["record_derivatives"] = True
    problem.driver.recording_options["includes"] = ["*"]
    problem.setup()
    problem.run_driver()
    problem.cleanup()
    return file, model


RECORDED = {"stretch": "_auto_ivc.v0", "volume": "ball.volume", "skew": "ball.skew"}
"""Names in the case file."""


def read_plainly(file):
    """Values of all cases, whether they succeeded, and their times, as SQLite and JSON give them."""
    with closing(sqlite3.connect(file)) as connection:
        rows = connection.execute("SELECT outputs, success, timestamp FROM driver_iterations ORDER BY id").fetchall()
    return [(json.loads(text), bool(ok), at) for text, ok, at in rows]


@contextmanager
def opened(file):
    """Open a case file to damage it."""
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("PRAGMA synchronous = OFF")
        yield connection


def damaged_bytes(file, random):
    """Bytes that are flipped, cut, put in or left out."""
    file.write_bytes(mutate(file.read_bytes(), random, MUTATIONS_OF_LINES, head=200))


def damaged_pages(file, random):
    """A page of zeros, or one in the place of another."""
    data, size = bytearray(file.read_bytes()), 4096
    here, there = random.integers(len(data) // size, size=2) * size
    data[here : here + size] = bytes(size) if random.integers(2) else data[there : there + size]
    file.write_bytes(data)


TABLES = (
    "driver_iterations",
    "driver_derivatives",
    "metadata",
    "driver_metadata",
    "system_metadata",
    "solver_metadata",
)
CASE_COLUMNS = ("counter", "iteration_coordinate", "timestamp", "success", "msg", "inputs", "outputs", "residuals")
OTHER_COLUMNS = {
    "driver_derivatives": ("derivatives", "iteration_coordinate", "timestamp"),
    "metadata": ("format_version", "openmdao_version", "abs2prom", "prom2abs", "abs2meta", "var_settings", "conns"),
    "driver_metadata": ("model_viewer_data",),
    "system_metadata": ("id", "component_metadata", "scaling_factors"),
    "solver_metadata": ("id", "solver_options"),
}
TABLES = ("driver_iterations", *OTHER_COLUMNS)
VALUES = (None, -1, 2**62, 0.5, float("inf"), "", "text", "{}", "[1]", "null", "NaN", b"", b"\x00\xff", b"\x80\x05.")


def other_tables(file, random):
    """A table dropped, renamed, without rows or without a column, or made a view."""
    table = TABLES[random.integers(len(TABLES))]
    column = OTHER_COLUMNS.get(table, CASE_COLUMNS)[-1]
    statement = (
        f"DROP TABLE {table}",
        f"ALTER TABLE {table} RENAME TO other",
        f"DELETE FROM {table}",
        f"ALTER TABLE {table} RENAME COLUMN {column} TO other",
        f"ALTER TABLE {table} RENAME TO other; CREATE VIEW {table} AS SELECT * FROM other",
    )[random.integers(5)]
    with opened(file) as connection:
        for part in statement.split("; "):
            connection.execute(part)


def other_values(file, random):
    """A value of another type in the place of one."""
    table = ("driver_iterations", *OTHER_COLUMNS)[random.integers(5)]
    columns = OTHER_COLUMNS.get(table, CASE_COLUMNS)
    put(file, random, table, columns[random.integers(len(columns))], lambda _: VALUES[random.integers(len(VALUES))])


def put(file, random, table, column, change):
    """Change a value of a random row."""
    with opened(file) as connection:
        rows = connection.execute(f"SELECT rowid, {column} FROM {table} ORDER BY 1").fetchall()
        number, value = rows[random.integers(len(rows))]
        connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (change(value), number))


OTHER_NUMBERS = ("NaN", "Infinity", "-Infinity", "null", "1e308", "-3.5", "[]", "[1.0, 2.0]", '"a"', "true", "{}", "7")


def other_numbers(file, random):
    """A number of a case as something else."""

    def change(text):
        found = list(re.finditer(r"-?\d[\d.e+-]*", text))
        at = found[random.integers(len(found))]
        return text[: at.start()] + OTHER_NUMBERS[random.integers(len(OTHER_NUMBERS))] + text[at.end() :]

    put(file, random, "driver_iterations", "outputs", change)


def other_json(file, random):
    """Compressed JSON of another shape: an entry dropped, or a value of another type."""
    column = OTHER_COLUMNS["metadata"][random.integers(2, 7)]

    def change(stored):
        found = json.loads(zlib.decompress(stored))
        place = found
        while isinstance(place, dict) and place:
            key = list(place)[random.integers(len(place))]
            if not isinstance(place[key], dict) or random.integers(3) == 0:
                place[key] = json.loads(OTHER_NUMBERS[random.integers(len(OTHER_NUMBERS))])
                if random.integers(3) == 0:
                    del place[key]
                break
            place = place[key]
        return zlib.compress(json.dumps(found).encode())

    put(file, random, "metadata", column, change)


class Bomb:
    """What calls something when it is unpickled."""

    def __init__(self, *call):
        self.call = call

    def __reduce__(self):
        return self.call[0], self.call[1:]


def other_pickles(file, random):
    """Pickles that are damaged, of something else, or that would make a file when they are read."""
    mark = str(file.parent / "mark")
    bomb, array = pickle.dumps(Bomb(open, mark, "w")), BytesIO()
    np.save(array, np.array([Bomb(open, mark, "w")]), allow_pickle=True)
    table, column, choices = [
        ("system_metadata", "component_metadata", [bomb, pickle.dumps({"a": 1}), pickle.dumps(7), b"\x80\x04r\xff"]),
        ("system_metadata", "scaling_factors", [bomb]),
        ("solver_metadata", "solver_options", [bomb]),
        ("driver_derivatives", "derivatives", [array.getvalue(), bomb]),
    ][random.integers(4)]
    chosen = choices[random.integers(len(choices))]
    is_damaged = column == "component_metadata" and random.integers(2)

    def change(stored):
        data = mutate(zlib.decompress(stored), random) if is_damaged else chosen
        return data if column == "derivatives" else zlib.compress(data)

    put(file, random, table, column, change)


def other_file(file, random):
    """Another file under the name."""
    choices = (b"", b"SQLite format 3\x00", b"\x89HDF\r\n\x1a\n" * 99, b"1 2 3\n" * 99, random.bytes(9000))
    file.write_bytes(choices[random.integers(len(choices))])


MUTATIONS = (
    *(damaged_bytes, damaged_bytes, damaged_pages, other_tables, other_values, other_values),
    *(other_numbers, other_numbers, other_json, other_pickles, other_file),
)


def damage(file, number):
    """Damage a case file in one way; equal numbers, equal damage."""
    random = np.random.default_rng([33, number])
    kind = MUTATIONS[number % len(MUTATIONS)]
    kind(file, random)
    return kind.__name__
