"""A study of a wing, for tests of what else may be in it."""

from bspline_mdao.studio.study.reader import read_study

STUDY = """\
[grid]
file = "@onera_m6"

[variables.twist]
stations = 3
lower = -6.0
upper = 6.0

[flow]
kind = "lattice"

[objective]
of = "CD_induced"

[constraints.CL]
equals = 0.22

[driver]
max_iterations = 20
"""


def study_of(folder, text):
    (folder / "study.toml").write_text(text)
    return read_study(folder / "study.toml")
