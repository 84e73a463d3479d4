"""How much processor time ``flexdesign`` takes to start, also as multiples of the start of Python itself::

    python -m studies.benchmarks.startup

Measured are commands that solve nothing, and those that solve up to where they begin: all of their input is read, and
then refused. Each runs in turns with ``python -c pass``, so that other load meets both; the shortest counts. On an idle
machine this is the time that a user waits.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence

#: How often each command runs.
TURNS = 5
PYTHON = (sys.executable, "-c", "pass")
FLEXDESIGN = (sys.executable, "-m", "flexdesign")
#: Commands that solve nothing.
LIGHT: Mapping[str, Sequence[str]] = {
    "flexdesign --version": ("--version",),
    "flexdesign --help": ("--help",),
    "flexdesign validate --help": ("validate", "--help"),
    "flexdesign effects": ("effects",),
    "flexdesign materials": ("materials",),
}
#: Commands that solve: all that they import, and their input read, but for the last file, which is not there.
HEAVY: Mapping[str, Sequence[str]] = {
    "flexdesign validate": ("validate", "bridge_amplifier", "--set", "mesh.accuracy=no"),
    "flexdesign simulate": ("simulate", "lin2019_stage", "not_there"),
    "flexdesign diagnose": ("diagnose", "lin2019_stage", "not_there"),
    "flexdesign sweep": ("sweep", "hinge_thickness", "--set", "evaluator=no"),
}


def seconds(command: Sequence[str]) -> float:
    """Return the processor time of a command [s], whatever it says: other load disturbs it less than wall time."""
    given = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": {**os.environ, "OMP_NUM_THREADS": "1"}}
    process = subprocess.Popen(command, **given)  # type: ignore[call-overload]
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return float(used.ru_utime + used.ru_stime)


def measure(turns: int = TURNS) -> dict[str, float]:
    """Return the time of each command [s], the shortest of some turns; the first is Python itself."""
    commands = {"python -c pass": PYTHON} | {name: (*FLEXDESIGN, *words) for name, words in {**LIGHT, **HEAVY}.items()}
    found = dict.fromkeys(commands, float("inf"))
    for _ in range(turns):
        for name, command in commands.items():
            found[name] = min(found[name], seconds(command))
    return found


def main() -> None:
    """Print the table."""
    found = measure()
    python = found["python -c pass"]
    for name, took in found.items():
        print(f"{name:30}{1e3 * took:8.0f} ms{took / python:8.1f} x")


if __name__ == "__main__":
    main()
