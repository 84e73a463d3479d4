"""What every program of `studies.benchmarks.fem_peers` is given, and what it answers.

The case is the upper part, z > 0, of the right half, x > 0, of a sharp-rooted bridge amplifier: a plan, drawn out. The
programs build it with their own geometry kernels from the corners of that plan, so that none pays for another's.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

Corner = tuple[float, float]


@dataclass(frozen=True)
class Case:
    """A quarter of an amplifier.

    Parameters
    ----------
    name
        Of the design.
    outline
        Corners (x, y) of the plan, counter-clockwise [mm].
    depth
        From the symmetry plane z = 0 to the free face [mm].
    input_x, input_height
        Where the face lies that the actuator pushes, and how high it is [mm].
    youngs_modulus, poissons_ratio
        E [MPa] and nu.
    """

    name: str
    outline: tuple[Corner, ...]
    depth: float
    input_x: float
    input_height: float
    youngs_modulus: float
    poissons_ratio: float

    @classmethod
    def of(cls, design: Any) -> Case:
        """Return the case of a design of the part `BridgeAmplifier`."""
        part, metal = design.part(), design.material

        def half(upper: list[Corner], lower: list[Corner]) -> list[Corner]:
            return [(0.0, upper[0][1]), *upper, *((x, -y) for x, y in reversed(lower)), (0.0, -lower[0][1])]

        outer = half(part.outer_corners(part.output_block_height), part.outer_corners(part.ground_block_height))
        inner = half(part.inner_corners(), part.inner_corners())
        around = [*inner, *reversed(outer)]
        return cls(
            name=design.name,
            outline=tuple((1e3 * x, 1e3 * y) for x, y in around),
            depth=1e3 * part.width / 2,
            input_x=1e3 * part.input_block[0],
            input_height=1e3 * part.input_block_height,
            youngs_modulus=1e-6 * metal.youngs_modulus,
            poissons_ratio=metal.poissons_ratio,
        )

    @property
    def roots(self) -> tuple[Corner, ...]:
        """The re-entrant corners, where the stress is singular [mm]."""
        corners = self.outline
        sides = zip(corners[-1:] + corners[:-1], corners, corners[1:] + corners[:1], strict=True)
        return tuple(b for a, b, c in sides if (b[0] - a[0]) * (c[1] - b[1]) < (b[1] - a[1]) * (c[0] - b[0]) - 1e-9)

    @property
    def ground_y(self) -> float:
        """Where the held face lies [mm]."""
        return min(y for _, y in self.outline)

    @property
    def traction(self) -> float:
        """Of one newton on the whole input face [MPa]; this part has half of that face."""
        return 1 / (2 * self.input_height * self.depth)

    def stiffness(self, work: float) -> float:
        """Return K_in [N/mm] from what the traction does on this part [N mm]: the extension is that of two inputs."""
        return 1 / (4 * work)


@dataclass(frozen=True)
class PeerResult:
    """What a program found: K_in [N/mm], its unknowns, and seconds for geometry and mesh, and for the rest."""

    stiffness: float
    unknowns: int
    mesh: float
    solve: float


class Stopwatch:
    """Seconds since the last look."""

    def __init__(self) -> None:
        self._began = perf_counter()

    def lap(self) -> float:
        """Return the seconds since the last lap [s], and begin another."""
        last, self._began = self._began, perf_counter()
        return self._began - last


def serve(solve: Callable[..., PeerResult]) -> None:
    """Read a case and settings from the command line, solve, and print the answer."""
    table, settings = map(json.loads, sys.argv[1:3])
    outline = tuple((x, y) for x, y in table.pop("outline"))
    print(json.dumps(asdict(solve(Case(outline=outline, **table), **settings))))
