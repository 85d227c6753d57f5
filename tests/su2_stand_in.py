"""A program that stands in for SU2_CFD and SU2_CFD_AD: it reads their files, and writes theirs in the same format.

The pressures are an analytic function of all nodes, of the angle of attack and of the Mach number; forces, moments and
their derivatives are summed as SU2 does. What is written looks as SU2 8.0 writes it: names padded in the header of the
history, 16 digits in the others.
"""

import os
import re
import sys
from pathlib import Path

import numpy as np

AXES = "xyz"


def read_config(path):
    pairs = re.findall(r"^\s*([A-Z_]+)\s*=\s*(.*?)\s*$", path.read_text(), re.M)
    return dict(pairs)


def read_mesh(path):
    """Number of axes, nodes, and elements of the markers."""
    lines = iter(path.read_text().splitlines())
    markers, points, n_axes, tag = {}, None, 0, ""
    for line in lines:
        key, _, value = line.partition("=")
        if key == "NDIME":
            n_axes = int(value)
        elif key == "NPOIN":
            points = np.array([next(lines).split() for _ in range(int(value))], dtype=float)
        elif key == "MARKER_TAG":
            assert points is not None, "Markers must be listed after points and elements in the SU2 mesh file."
            tag = value.strip()
        elif key == "MARKER_ELEMS":
            markers[tag] = [list(map(int, next(lines).split()[1:])) for _ in range(int(value))]
    return n_axes, points, markers


def nodal_areas(points, faces):
    """Area vectors at the corners of faces of one kind, out of the body, which is convex."""
    at = points[faces]
    middle = at.mean(axis=(0, 1)).real
    if faces.shape[1] == 2:
        edge = at[:, 1] - at[:, 0]
        areas = np.stack([0.5 * np.stack([edge[:, 1], -edge[:, 0]], axis=1)] * 2, axis=1)
    else:
        after = 0.5 * (at + np.roll(at, -1, axis=1))
        areas = 0.5 * np.cross(at.mean(axis=1, keepdims=True) - at, np.roll(after, 1, axis=1) - after)
    outward = np.sum(areas.sum(axis=1).real * (at.mean(axis=1).real - middle), axis=1)
    return areas * np.sign(outward)[:, None, None]


def pressures(points, moment, mach, alpha):
    """Pressure coefficients: smooth functions of the node, of a mean over all nodes, and of the stream (rad)."""
    x, y = points[:, 0], points[:, -1]
    return mach * np.cos(3.0 * x) + (0.2 + 2.0 * alpha) * y * mach**2 + 0.3 * moment * x


def mean_square(points):
    return np.mean(points**2 @ np.arange(1.0, points.shape[1] + 1.0)) / 100.0


def loads(points, moment, mach, alpha, faces, config):
    """Coefficients of forces and moments by their names."""
    n_axes, area = points.shape[1], float(config["REF_AREA"])
    cp, origin = pressures(points, moment, mach, alpha), np.zeros(3)
    origin[:] = [float(config[f"REF_ORIGIN_MOMENT_{axis}"]) for axis in "XYZ"]
    parts = -cp[faces][..., None] * nodal_areas(points, faces) / area
    arms, three = (np.zeros((*faces.shape, 3), dtype=complex) for _ in range(2))
    arms[..., :n_axes], three[..., :n_axes] = points[faces] - origin[:n_axes], parts
    force, turn = parts.sum(axis=(0, 1)), np.cross(arms, three).sum(axis=(0, 1)) / float(config["REF_LENGTH"])
    values = {f"CF{axis}": value for axis, value in zip(AXES, force)}
    values |= {f"CM{axis}": turn[AXES.index(axis)] for axis in (AXES if n_axes == 3 else "z")}
    return values


def write_table(path, names, rows, numbers):
    lines = ['"PointID",' + ",".join(f'"{name}"' for name in names)]
    for number, row in reversed(list(zip(numbers, rows))):  # in any order
        lines.append(f"{number}, " + ", ".join(f"{value:.15e}" for value in row))
    path.write_text("\n".join(lines) + "\n")


def write_history(path, values):
    names = ['"Time_Iter"', '"Outer_Iter"', '"Inner_Iter"', *(f'"{name}"'.center(20) for name in values)]
    first = [0, 0, 0, *(0.5 for _ in values)]
    last = [0, 0, 1, *(f"{value:.16g}".rjust(20) for value in values.values())]
    path.write_text("\n".join(",".join(map(str, row)) for row in (names, first, last)) + "\n")


def main():
    config = read_config(Path(sys.argv[1]))
    n_axes, points, markers = read_mesh(Path(config["MESH_FILENAME"]))
    walls = re.findall(r"[^\s,()]+", config["MARKER_MONITORING"])
    faces = np.array([face for name in walls for face in markers[name]])
    mach, degrees = float(config["MACH_NUMBER"]), float(config["AOA"])
    moment, alpha = mean_square(points), np.radians(degrees)
    nodes = np.unique(faces)
    if config["MATH_PROBLEM"] == "DIRECT":
        values = {name: value.real for name, value in loads(points, moment, mach, alpha, faces, config).items()}
        up = values[f"CF{AXES[n_axes - 1]}"]
        values["CD"] = values["CFx"] * np.cos(alpha) + up * np.sin(alpha)
        values["CL"] = -values["CFx"] * np.sin(alpha) + up * np.cos(alpha)
        write_history(Path("history.csv"), {"rms[Rho]": -11.0, **values})
        cp = pressures(points, moment, mach, alpha)
        names = [*AXES[:n_axes], "Density", "Pressure_Coefficient"]
        rows = np.column_stack([points, np.ones(len(points)), cp])
        write_table(Path("surface_flow.csv"), names, rows[nodes], nodes)
        write_table(Path("restart_flow.csv"), names, rows, range(len(points)))
        with Path("starts").open("a") as file:
            file.write(config["RESTART_SOL"] + "\n")
        return
    assert Path(config["SOLUTION_FILENAME"] + ".csv").exists()
    kind, axis = config["OBJECTIVE_FUNCTION"].split("_")
    name = {"FORCE": "CF", "MOMENT": "CM"}[kind] + axis.lower()
    step = 1e-30

    def derivative(points=points, moment=moment, mach=mach, alpha=alpha):
        return loads(points, moment, mach, alpha, faces, config)[name].imag / step

    gradient = derivative(moment=moment + 1j * step) * 2.0 * points * np.arange(1.0, n_axes + 1.0)
    gradient /= 100.0 * len(points)
    for node in nodes:
        for direction in range(n_axes):
            moved = points.astype(complex)
            moved[node, direction] += 1j * step
            gradient[node, direction] += derivative(points=moved)
    write_table(
        Path(f"restart_adj_{name.lower()}.csv"),
        [*AXES[:n_axes], "Adjoint_Density", *(f"Sensitivity_{axis}" for axis in AXES[:n_axes])],
        np.column_stack([points, np.zeros(len(points)), gradient]),
        range(len(points)),
    )
    by_alpha = np.radians(1.0) * derivative(alpha=alpha + 1j * step)
    write_history(Path("history_adj.csv"), {"Sens_AoA": by_alpha, "Sens_Mach": derivative(mach=mach + 1j * step)})


def install(folder, monkeypatch, script=None, programs=("SU2_CFD", "SU2_CFD_AD")):
    """Put the program first on the PATH, or a script of a shell in its place."""
    folder.mkdir(exist_ok=True)
    script = script or f'exec {sys.executable} {__file__} "$@"'
    for program in programs:
        path = folder / program
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


if __name__ == "__main__":
    main()
