"""CalculiX on gmsh's quadratic tetrahedra: the meshes of `fem_peer_gmsh`, written as an input deck and read back.

The executable is ``ccx`` on the path, or what the environment variable CCX names.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from studies.benchmarks import fem_peer_gmsh
from studies.benchmarks.fem_peer_case import Case, PeerResult, Stopwatch, serve

#: Meshes in layers, a coarse and a fine one: nothing but the solver is another's.
SETTINGS = fem_peer_gmsh.SETTINGS[1::3]
#: gmsh's order of a tetrahedron's nodes in that of C3D10: they differ in the last two.
ORDER = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
#: Corners and middles of its faces.
FACES = np.array([[0, 1, 2, 4, 5, 6], [0, 3, 1, 7, 8, 4], [1, 3, 2, 8, 9, 5], [2, 3, 0, 9, 7, 6]])


def executable() -> str | None:
    """Return the solver's path, or None."""
    return shutil.which(os.environ.get("CCX", "ccx"))


def deck(case: Case, points: np.ndarray, tets: np.ndarray, pushed: np.ndarray, forces: np.ndarray) -> str:
    """Return the input file."""
    x, y, z = points.T
    sets = {"GROUND": abs(y - case.ground_y), "MIDDLE": abs(x), "BACK": abs(z)}

    def rows(table: Any) -> str:
        return "\n".join(", ".join(map(str, row)) for row in table)

    numbered = np.arange(1, len(points) + 1)
    places = [[f"{coordinate:.13g}" for coordinate in point] for point in points]  # it reads twenty characters each
    lines = ["*NODE, NSET=ALL", rows((n, *place) for n, place in zip(numbered, places, strict=True))]
    lines += ["*ELEMENT, TYPE=C3D10, ELSET=BODY", rows((n, *nodes) for n, nodes in enumerate(tets + 1, 1))]
    for name, away in sets.items():
        lines += [f"*NSET, NSET={name}", "\n".join(map(str, numbered[away < 1e-7]))]
    lines += ["*NSET, NSET=PUSHED", "\n".join(map(str, pushed + 1))]
    lines += ["*MATERIAL, NAME=METAL", "*ELASTIC", f"{case.youngs_modulus}, {case.poissons_ratio}"]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=METAL", "*BOUNDARY", "GROUND, 1, 3", "MIDDLE, 1", "BACK, 3"]
    lines += ["*STEP", "*STATIC", "*CLOAD", rows((n + 1, 1, float(f)) for n, f in zip(pushed, forces, strict=True))]
    return "\n".join([*lines, "*NODE PRINT, NSET=PUSHED", "U", "*END STEP", ""])


def solve(case: Case, **settings: Any) -> PeerResult:
    """Solve; the answer's seconds for solving hold those for writing and reading."""
    watch = Stopwatch()
    points, tets = fem_peer_gmsh.make_mesh(case, **settings, order=2)
    took = watch.lap()
    tets = tets[:, ORDER]
    faces = tets[:, FACES].reshape(-1, 6)
    faces = faces[(abs(points[faces][:, :, 0] - case.input_x) < 1e-7).all(axis=1)]
    a, b, c = points[faces[:, :3]].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    # On a plane quadratic triangle an even traction acts on the middles alone.
    forces = np.bincount(faces[:, 3:].ravel(), np.repeat(case.traction * areas / 3, 3), minlength=len(points))
    pushed = np.flatnonzero(forces)
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "job"
        job.with_suffix(".inp").write_text(deck(case, points, tets, pushed, forces[pushed]))
        program = executable() or "ccx"
        subprocess.run([program, "-i", "job"], cwd=folder, check=True, capture_output=True, timeout=900)
        found = [line.split() for line in job.with_suffix(".dat").read_text().splitlines()]
    moved = {int(row[0]) - 1: float(row[1]) for row in found if len(row) == 4 and row[0].isdigit()}
    work = sum(float(forces[n]) * moved[n] for n in pushed.tolist())
    return PeerResult(case.stiffness(work), 3 * len(points), took, watch.lap())


if __name__ == "__main__":
    serve(solve)
