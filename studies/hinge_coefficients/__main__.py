"""The command ``python -m studies.hinge_coefficients``."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

import numpy as np

from flexdesign.core.model import Root
from flexdesign.effects.hinge_compliance import roots, width
from studies.hinge_coefficients import notches, planar, plate

NAMES = ("MM", "MV", "NN", "NM")
ENDS = (1.25, 1.75, 2.0, 2.5, 3.5, 5.0, 8.0, 16.0)
FILLETS = (0.1, 0.25, 0.5, 1.0)
FLANKS = ((3.0, 1.5), (5.0, 1.2), (6.0, 1.0), (6.0, 3.0), (10.0, 2.0), (12.0, 1.0))
BLOCKS = ((4.0, 1.5), (8.0, 1.0), (8.0, 2.0), (12.0, 3.0), (16.0, 2.0))
PRESSED = ((6.0, 6.0), (9.0, 4.6), (12.0, 12.0), (12.0, 22.0), (16.0, 11.0))
Row = tuple[str, float, float]


def rows() -> Iterator[Row]:
    """Yield each coefficient: what it is, as solved, and as the program has it."""
    for depth in ENDS:
        yield from _of(f"end, a/t {depth:g}", planar.end(depth), Root("end", depth))
    for radius in FILLETS:
        yield from _of(f"end, a/t 6, R/t {radius:g}", planar.end(6.0, radius), Root("end", 6.0), radius)
    for depth, overhang in FLANKS:
        root = Root("flank", depth, overhang, height=4 * depth)
        yield from _of(f"flank, d/t {depth:g}, b/t {overhang:g}", planar.flank(depth, overhang, 4 * depth), root)
    for depth, overhang in BLOCKS:
        solved = planar.block(depth, overhang, max(1.5 * depth, 2.2 * overhang))
        _, _, nn, nm = roots.coefficients(Root("block", depth, overhang), 1.0)
        yield f"block, d/t {depth:g}, b/t {overhang:g}: NN", float(solved[0, 0]), nn
        yield f"block, d/t {depth:g}, b/t {overhang:g}: NM", float(solved[0, 1]), nm
    for depth, height in PRESSED:
        _, _, nn, _ = roots.coefficients(Root("flank", depth, 0.4 * height, height=height), 1.0)
        solved_nn = planar.pressed_root_compliance(depth, 0.4 * height, height)
        yield f"pressed block, d/t {depth:g}, h/t {height:g}: NN", solved_nn, nn
    for name, shape, neck in notches.CASES:
        solved, beams, program = notches.compliances(shape, neck)
        for number, motion in ((2, "rotation"), (0, "stretch"), (1, "sway")):
            yield (
                f"{name}, t/l {neck / (2 * shape.half_length):g}: {motion} over the beam's",
                float(solved[number, number] / beams[number, number]),
                float(program[number, number] / beams[number, number]),
            )
    for ratio in (0.05, 0.15, 0.4, 1.0, 3.0):
        yield f"relief, bent, l/w {ratio:g}", plate.bent(ratio), float(np.interp(ratio, width.RATIOS, width.BENDING))
        at = float(np.interp(ratio, width.RATIOS, width.STRETCHING))
        yield f"relief, stretched, l/w {ratio:g}", plate.relief(ratio), at


def _of(what: str, solved: planar.Array, root: Root, radius: float = 0.0) -> Iterator[Row]:
    mm, mv, nn, nm = roots.coefficients(root, 1.0, radius)
    found = (solved[2, 2], solved[1, 2], solved[0, 0], -solved[0, 2])
    for name, of_planar, of_program in zip(NAMES, found, (mm, mv, nn, nm), strict=True):
        if root.kind != "end" or name != "NM":
            yield f"{what}: {name}", float(of_planar), of_program


def main() -> int:
    """Print solved and interpolated coefficients."""
    print(f"{'':52}{'solved':>9}{'program':>9}{'less':>9}")
    worst = 0.0
    for what, solved, program in rows():
        print(f"{what:52}{solved:9.3f}{program:9.3f}{program - solved:+9.3f}", flush=True)
        worst = max(worst, math.fabs(program - solved))
    print(f"the largest difference is {worst:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
