"""The command ``python -m studies.bonded_stacks``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from studies.bonded_stacks.actuator import Found, solve

#: Of the published matrices: their rigid mass, static condensation, and eigenvalues with the lower pad held.
PUBLISHED = Found(0.11533, -5.075, 1.753e6, (294.6, 525.2, 709.4, 1909.3))
VARIANTS = (
    ("clamped in the screw hole", {"in_hole": True}),
    ("clamped at the whole face", {"in_hole": False}),
    ("the same, stacks without mass", {"in_hole": False, "stack_mass": False}),
)


def main() -> int:
    """Print the published numbers, and for each variant its own and the differences from them."""
    print(f"{'':30}{'mass [g]':>16}{'lambda':>16}{'K_out [N/um]':>16}" + f"{'f [Hz]':>15} " * 4)
    print(f"{'published':30}" + "".join(f"{value:16.4g}" for value in _values(PUBLISHED)))
    with tempfile.TemporaryDirectory() as folder:
        for name, options in VARIANTS:
            found = solve(Path(folder), **options)
            pairs = zip(_values(found), _values(PUBLISHED), strict=True)
            print(
                f"{name:30}" + "".join(f"{own:8.4g} {100 * (own / their - 1):+5.1f} %" for own, their in pairs),
                flush=True,
            )
    return 0


def _values(found: Found) -> tuple[float, ...]:
    return 1e3 * found.mass, found.amplification, 1e-6 * found.output_stiffness, *found.frequencies


if __name__ == "__main__":
    sys.exit(main())
