"""The command ``python -m studies.notch_profiles``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from studies.notch_profiles import levers

HEAD = f"{'hinge':22}{'K_in [N/mm]':>18}{'model':>9}{'lambda':>8}{'K_out':>8}{'unknowns':>10}{'time':>7}"


def main() -> int:
    """Print one line for each profile: K_in, what the model is off by in three quantities, and the time of a leaf."""
    print(HEAD)
    leaf = 0.0
    with tempfile.TemporaryDirectory() as folder:
        levers.solve("leaf", Path(folder), "mesh.accuracy=0.05", "mesh.at_root=0.3")  # compiles and loads
        for profile in levers.PROFILES:
            found = levers.solve(profile, Path(folder))
            leaf = leaf or found.seconds
            k_in = found.fem[levers.KEYS[0]]
            off = [100 * (found.model[key].value / found.fem[key].value - 1) for key in levers.KEYS]
            stated = f"{1e-3 * k_in.value:.2f} ± {1e-3 * (k_in.half_width or 0):.2f}"
            print(
                f"{profile:22}{stated:>18}{off[0]:+8.2f}%{off[1]:+7.2f}%{off[2]:+7.2f}%{found.unknowns:10}"
                f"{found.seconds / leaf:6.1f}x",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
