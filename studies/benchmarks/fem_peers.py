"""How soon a bridge amplifier's input stiffness is known to 1 % and to 0.3 %: flexdesign and its peers::

    python -m studies.benchmarks.fem_peers                          # several minutes
    python -m studies.benchmarks.fem_peers lin2019_amplifier_xy     # another amplifier, with sharp roots

All solve the same quarter, ground face held, even traction on the input face, each in a process of its own with two
threads, from an interpreter that has imported nothing to the answer. Each program tries settings of its own, from cheap
to expensive; of those that reach an accuracy the one of least processor time is run again, in turns with the others',
and its best wall time counts. What a program needs and is not there is named, and left out.

The truth is the limit of graded hexahedra (`fem_peer_reference`), which share no code with any of them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from typing import Any

from flexdesign.design import design
from studies.benchmarks import (
    fem_peer_calculix,
    fem_peer_flexdesign,
    fem_peer_gmsh,
    fem_peer_ngsolve,
    fem_peer_reference,
    fem_peer_solvers,
)
from studies.benchmarks.fem_peer_case import Case, PeerResult

ACCURACIES = (0.01, 0.003)
#: How often the fastest settings run again, in turns; seconds after which a run is given up.
TURNS, LONGEST = 1, 300.0
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "2")
PROGRAMS: Mapping[str, Any] = {
    "flexdesign": fem_peer_flexdesign,
    "NGSolve": fem_peer_ngsolve,
    "gmsh + scikit-fem": fem_peer_gmsh,
    "gmsh + CalculiX": fem_peer_calculix,
}


class Failed(Exception):
    """A run that gave no answer; the message is its last words."""


@dataclass(frozen=True)
class Run:
    """What a process answered, its wall and processor time [s], and the most memory it had [bytes]."""

    output: dict[str, Any]
    wall: float
    cpu: float
    memory: int


@dataclass(frozen=True)
class Entry:
    """A program with one of its settings, what it found, and its relative error."""

    program: str
    settings: Mapping[str, Any]
    run: Run
    answer: PeerResult
    error: float


def run(module: Any, *arguments: str) -> Run:
    """Run a module in a process of its own and read the JSON that it prints last.

    Raises
    ------
    Failed
        If it fails, or takes too long.
    """
    command = [sys.executable, "-m", module.__name__, *arguments]
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=out, stderr=err, env={**os.environ, **THREADS})
        watchdog = threading.Timer(LONGEST, process.kill)
        watchdog.start()
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - began
        watchdog.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        for stream in (out, err):
            stream.seek(0)
        if process.returncode:
            words = err.read().strip().splitlines() or [f"given up after {wall:.0f} s"]
            raise Failed(words[-1])
        output = json.loads(out.read().strip().splitlines()[-1])
    return Run(output, wall, used.ru_utime + used.ru_stime, 1024 * used.ru_maxrss)


def run_program(program: str, case: Case, settings: Mapping[str, Any], truth: float) -> Entry:
    """Run a program with settings; `truth` is K_in [N/mm]."""
    table = {**asdict(case), "outline": list(case.outline)}
    done = run(PROGRAMS[program], json.dumps(table), json.dumps(settings))
    answer = PeerResult(**done.output)
    return Entry(program, settings, done, answer, answer.stiffness / truth - 1)


def reference(name: str) -> float:
    """Return the converged K_in [N/mm]; print where it comes from, and how far it may be off."""
    found = run(fem_peer_reference, name).output
    print("hexahedra: {:.1f}, {:.1f} N/mm; on record {:.1f} N/mm".format(*found["meshes"]))
    print(f"converged K_in: {found['limit']:.1f} N/mm, within {100 * found['doubt']:.2g} %\n", flush=True)
    return float(found["limit"])


def is_installed(program: str) -> bool:
    """Tell whether a program is there; say how to get it if not."""
    packages = {"NGSolve": ["ngsolve"], "gmsh + scikit-fem": ["gmsh", "skfem"], "gmsh + CalculiX": ["gmsh"]}
    missing = [name for name in packages.get(program, []) if find_spec(name) is None]
    if missing:
        names = " ".join(missing).replace("skfem", "scikit-fem")
        print(f"{program} is not installed: pip install {names}")
    elif program == "gmsh + CalculiX" and fem_peer_calculix.executable() is None:
        print(f"{program}: no executable ccx on the path, and CCX names none: apt install calculix-ccx")
        return False
    return not missing


COLUMNS = ("unknowns", 9), ("error", 9), ("wall", 9), ("start", 8), ("mesh", 8), ("solve", 8), ("cpu", 9), ("memory", 9)
HEAD = f"{'':19}{'settings':64}" + "".join(f"{title:>{width}}" for title, width in COLUMNS)


def line(entry: Entry) -> str:
    """Return an entry as a row of the table; start is what neither mesh nor solve account for, imports above all."""
    answer, done = entry.answer, entry.run
    start = done.wall - answer.mesh - answer.solve
    settings = ", ".join(f"{key} {value}" for key, value in entry.settings.items())
    return (
        f"{entry.program:19}{settings:64}{answer.unknowns:9}{100 * entry.error:+7.2f} %{done.wall:7.1f} s"
        f"{start:6.1f} s{answer.mesh:6.1f} s{answer.solve:6.1f} s{done.cpu:7.1f} s{done.memory / 2**20:6.0f} MB"
    )


def everything(case: Case, truth: float) -> list[Entry]:
    """Run every program that is there with all its settings."""
    entries = []
    print(HEAD, flush=True)
    for program, module in PROGRAMS.items():
        if not is_installed(program):
            continue
        for settings in module.SETTINGS:
            try:
                entries.append(run_program(program, case, settings, truth))
            except Failed as failure:
                print(f"{program:19}{settings}: {failure}", flush=True)
            else:
                print(line(entries[-1]), flush=True)
    return entries


def cheapest(accuracy: float, entries: Sequence[Entry]) -> dict[str, Entry]:
    """Return of each program the entry that reaches an accuracy in the least processor time."""
    chosen: dict[str, Entry] = {}
    for entry in sorted(entries, key=lambda entry: entry.run.cpu):  # other load disturbs it less than the wall time
        if abs(entry.error) <= accuracy:
            chosen.setdefault(entry.program, entry)
    return chosen


def at(accuracy: float, entries: Sequence[Entry], case: Case, truth: float) -> dict[str, float]:
    """Print the fastest settings of each program that reach an accuracy, run anew in turns; return their times [s]."""
    print(f"\nK_in to {100 * accuracy:g} %, the best of {1 + TURNS} runs\n{HEAD}")
    chosen = cheapest(accuracy, entries)
    again = [run_program(name, case, entry.settings, truth) for _ in range(TURNS) for name, entry in chosen.items()]
    again += chosen.values()
    walls: dict[str, float] = {}
    for program in chosen:
        fastest = min((entry for entry in again if entry.program == program), key=lambda entry: entry.run.wall)
        walls[program] = fastest.run.wall
        print(line(fastest), flush=True)
    for program in {entry.program for entry in entries} - set(chosen):
        print(f"{program:19}reaches it with none of its settings")
    own, others = walls.get("flexdesign"), {name: wall for name, wall in walls.items() if name != "flexdesign"}
    if own and others:
        best = min(others, key=lambda name: others[name])
        print(f"the best peer, {best}, takes {others[best] / own:.1f} times as long as flexdesign")
    return walls


def other_ways(case: Case, truth: float) -> None:
    """Print what flexdesign takes without the symmetry, and with the mesher for any solid."""
    for title, ways in fem_peer_flexdesign.OTHER_WAYS.items():
        print(f"\n{title}\n{HEAD}")
        for settings in ways:
            print(line(run_program("flexdesign", case, settings, truth)), flush=True)


def on_this_machine(name: str) -> None:
    """Print flexdesign's other times, and those of solvers."""
    print("\non this machine")
    for task in ("modes", "large"):
        done = run(fem_peer_solvers, task, name)
        unknowns = done.output.pop("unknowns")
        times = ", ".join(f"{what} {seconds:.2f} s" for what, seconds in done.output.items())
        what = {"modes": f"{fem_peer_solvers.MODES} modes", "large": "an iteration under large displacements"}[task]
        total = sum(seconds for key, seconds in done.output.items() if key != "once")
        print(f"{what} at {unknowns} unknowns: {total:.2f} s ({times})", flush=True)
    print(f"{'':10}{'unknowns':>9}{'factor':>9}{'solve':>9}{'residual':>10}{'memory':>10}")
    for unknowns in ("40 k", "100 k"):
        for solver, package in fem_peer_solvers.PIP.items():
            if find_spec(package) is None:
                print(f"{solver} is not installed: pip install {package}")
                continue
            try:
                done = run(fem_peer_solvers, "factor", name, unknowns, solver)
            except Failed as failure:
                print(f"{solver:10}{unknowns:>9} {failure}", flush=True)
                continue
            found = done.output
            print(
                f"{solver:10}{found['unknowns']:9}{found['factor']:7.2f} s{found['solve']:7.2f} s"
                f"{found['residual']:10.0e}{done.memory / 2**20:7.0f} MB",
                flush=True,
            )


def main(name: str = "bridge_amplifier") -> None:
    """Print everything."""
    before = os.getloadavg()[0]
    print(f"load before the run: {before:.1f} on {os.cpu_count()} processors; times are fair where it is near zero\n")
    case, truth = Case.of(design.read(design.find(name))), reference(name)
    entries = everything(case, truth)
    for accuracy in ACCURACIES:
        at(accuracy, entries, case, truth)
    other_ways(case, truth)
    on_this_machine(name)


if __name__ == "__main__":
    main(*sys.argv[1:])
