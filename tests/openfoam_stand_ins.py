"""Programs that stand in for those of OpenFOAM: shell scripts on the PATH that do what a solver may do."""

import os
import stat


def stand_in(folder, monkeypatch, program, script):
    """Put a program first on the PATH; in its script ``$2`` is the case."""
    folder.mkdir(exist_ok=True)
    path = folder / program
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
