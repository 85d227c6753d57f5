"""Programs that stand in for those of OpenFOAM: shell scripts on the PATH that do what a solver may do."""

import os
import stat

SOLVER = r"""
case=$2
echo run >> $case/../runs
alpha=$(awk '/freestreamValue/ { sub(/.*\(/, ""); sub(/\).*/, ""); print atan2($3, $1) * 57.29577951308232; exit }' \
    $case/0/U)
FAILURE
echo 'Time = 1'
echo 'GAMG:  Solving for p, Initial residual = 1, Final residual = 0.01, No Iterations 2'
echo 'Time = 2'
echo 'GAMG:  Solving for p, Initial residual = 1e-7, Final residual = 1e-9, No Iterations 2'
mkdir $case/1 $case/2
cp $case/0/* $case/1
cp $case/0/* $case/2
p=$(awk "BEGIN { printf \"%.17g\", 100000 + 1000 * ($alpha - 3)^2 }")
sed -i "s/internalField.*/internalField uniform $p;/" $case/2/p
grep internalField $case/0/p >> $case/../starts
END
"""
"""A solver whose pressure is that of the stream and 1000 (alpha - 3)^2 Pa more, whatever the mesh."""

CONVERGED = "echo 'SIMPLE solution converged in 2 iterations'"

PRESSURE_SOLVER = SOLVER.replace("FAILURE", "").replace("END", CONVERGED)
"""The same, which never fails."""


def stand_in(folder, monkeypatch, program, script):
    """Put a program first on the PATH; in its script ``$2`` is the case."""
    folder.mkdir(exist_ok=True)
    path = folder / program
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
