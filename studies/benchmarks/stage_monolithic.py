"""A stage of condensed parts between rigid bodies, and the same stage solved in one piece, all of it elastic::

    python -m studies.benchmarks.stage_monolithic                         # a few minutes, and some gigabytes
    python -m studies.benchmarks.stage_monolithic lin2019_xyz_stage 3.0   # finer meshes; 5.0 are the default

Both use the same meshes of the parts, so that what differs is what condensing leaves out: how port faces may deform,
and that bodies bend. Meshes are made before the clocks start, which count processor time. Either way finds the
compliance between the drives of all axes and the table's three translations, and six modes.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.design import design
from flexdesign.fem.meshing import domain, methods
from flexdesign.fem.stage_condensation import DEGREE, HINGE_MODES, MODES
from flexdesign.fem.superelements import superelement
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from studies.benchmarks.monolithic import MonolithicStage, WholePart, mirror_part

Array = NDArray[np.float64]
#: How many modes, and the edge length of the elements of the bodies [m].
COUNT, BOX = 6, 4e-3


def solve_condensed(read: Any, assembly: Any, meshes: Sequence[Any]) -> tuple[Array, Array, float]:
    """Return compliance, frequencies and seconds of the stage put together from condensed parts."""
    began, parts = process_time(), {}
    for (piece, elements), (body, mesh) in zip(assembly.kinds(), meshes, strict=True):
        modes = MODES if any(port.role == "input" for port in piece.ports()) else HINGE_MODES
        part = superelement.condense(piece, read.material, body, mesh, degree=DEGREE, mode_count=modes)
        parts |= {element.name: part for element in elements}
    ready = process_time() - began
    stage = AssembledStage(assembly, parts, read.material.density)
    centre = np.array(assembly.body(assembly.table).boxes[0].centre)
    rows = np.vstack([*(stage.drive(axis) for axis in assembly.axes), stage.motion(assembly.table, centre)[:3]])
    compliance = rows @ np.linalg.solve(stage.stiffness, rows.T)
    frequencies = np.array([mode.frequency for mode in stage.modes(COUNT)])
    seconds = process_time() - began
    print(f"condensed: {stage.size} unknowns, parts {ready:.2f} s, stage {seconds - ready:.2f} s", flush=True)
    return compliance, frequencies, seconds


def monolithic(read: Any, assembly: Any, parts: dict[str, WholePart]) -> tuple[Array, Array, float]:
    """Return the same of the stage in one piece."""
    began = process_time()
    stage = MonolithicStage(assembly, parts, read.material, BOX)
    drives = [
        np.sum([sign * stage.extension(name) for name, sign in axis.drives.items()], axis=0)
        for axis in assembly.axes.values()
    ]
    rows = np.vstack([*drives, stage.translation(assembly.table)])
    compliance = rows @ stage.statics(rows.T)
    static = process_time() - began
    frequencies = stage.frequencies(COUNT)
    seconds = process_time() - began
    print(
        f"in one piece: {stage.unknowns} unknowns, statics {static:.1f} s, modes {seconds - static:.1f} s", flush=True
    )
    return compliance, frequencies, seconds


def main(name: str = "lin2019_xyz_stage", coarseness: str = "5.0") -> tuple[float, float]:
    """Solve both ways, and print how they differ and what they take; return these times [s], condensed first."""
    read = design.read(design.find(name))
    assembly = read.stage().assembly()
    meshes, parts = [], {}
    for piece, elements in assembly.kinds():
        body = domain.of_part(piece, chord=domain.chord(piece))
        grading = methods.Grading(body, piece.linkage().members, *methods.EXTRUDED_GRADING, None)
        meshes.append((body, methods.Extruded(grading).mesh(float(coarseness))))
        whole = mirror_part(meshes[-1][1], body)
        parts |= {element.name: whole for element in elements}
    quick, own, short = solve_condensed(read, assembly, meshes)
    slow, others, long = monolithic(read, assembly, parts)
    print("\nstiffness and amplification, condensed over in one piece")
    for i, axis in enumerate(assembly.axes):
        k_in, k_out = slow[i, i] / quick[i, i], slow[3 + i, 3 + i] / quick[3 + i, 3 + i]
        ratio = (quick[3 + i, i] / quick[i, i]) / (slow[3 + i, i] / slow[i, i])
        errors = ", ".join(f"{what} {100 * (value - 1):+.2f} %" for what, value in
                           (("K_in", k_in), ("K_out", k_out), ("lambda", ratio)))  # fmt: skip
        print(f"  {axis}: {errors}")
    print("modes: " + ", ".join(f"{f:.2f} Hz {100 * (f / g - 1):+.2f} %" for f, g in zip(own, others, strict=True)))
    print(f"{long:.1f} s in one piece, {short:.2f} s condensed: {long / short:.0f} times")
    return short, long


if __name__ == "__main__":
    main(*sys.argv[1:])
