"""The performance table: flexdesign and its peers, as ratios measured in one run::

    python -m studies.benchmarks                      # half an hour on an idle machine
    python -m studies.benchmarks simulation fits      # some of the tasks
    python -m studies.benchmarks --result FILE        # the report of a kept result.json

Both sides of a row solve the same task to the same accuracy, one after the other. A ratio is that of processor times,
which other load disturbs less than wall times: how many times as long the peer takes as flexdesign. Peers that are not
installed are named, and left out. Each module of this folder measures one task in more detail.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from flexdesign.core import subprocess_call, units
from flexdesign.core.versions import installed
from flexdesign.design import design
from flexdesign.dynamics.simulate import TOLERANCE
from flexdesign.fem.multifidelity import FastSolid
from flexdesign.report import charts, render
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.terminal import plain
from studies.benchmarks import dynamics, dynamics_peer, fem_peers, least_squares, stage_monolithic, sweep_evaluators
from studies.benchmarks.fem_peer_case import Case

#: Signal chains, of `dynamics_peer.CHAINS`, and how long they are simulated [s].
CHAINS, SIGNAL = ("full", "full, closed loop", "three axes, closed loop"), 2.0
#: Designs of a sweep, and how many of them are also solved one by one.
DESIGNS, ANEW = 100, 4
#: Cases of the trial whose fits are solved: friction, a delay, statics, a slow effect, and none.
CASES = (10002, 20004, 20300, 21101, 22101)
HEADS = ("task", "at equal", "peer", "flexdesign", "peer / flexdesign")


@dataclass(frozen=True)
class Row:
    """One comparison.

    Parameters
    ----------
    task, equal
        What both sides do, and the accuracy that both reach.
    peer
        The other program or method.
    own, other
        Processor time of flexdesign and of the peer [s].
    """

    task: str
    equal: str
    peer: str
    own: float
    other: float

    @property
    def ratio(self) -> float:
        """How many times as long the peer takes."""
        return self.other / self.own

    @property
    def rounded(self) -> float:
        """The ratio with two digits: no digit of a time beyond the second is repeated."""
        return float(f"{self.ratio:.2g}")

    def cells(self) -> list[str]:
        """Return the row of the table."""
        own = f"{units.significant(self.own, 2)} s"
        return [self.task, self.equal, self.peer, own, f"{self.rounded:g}"]


def processor_time() -> float:
    """Return the processor time of this process and of those that it has ended [s]."""
    subprocess_call._helper.end()  # the mesher's process counts once it has ended
    return sum(os.times()[:4])


def taken(action: Callable[[], object], clock: Callable[[], float] = time.process_time) -> float:
    """Return the processor time of something [s]."""
    begin = clock()
    action()
    return clock() - begin


def finite_elements() -> Iterator[Row]:
    """Yield, for each accuracy of K_in, the peer that takes least."""
    name = "bridge_amplifier"
    case, truth = Case.of(design.read(design.find(name))), fem_peers.reference(name)
    entries = fem_peers.everything(case, truth)
    for accuracy in fem_peers.ACCURACIES:
        chosen = {program: entry.run.cpu for program, entry in fem_peers.cheapest(accuracy, entries).items()}
        own = chosen.pop("flexdesign", math.nan)
        for program, other in sorted(chosen.items(), key=lambda item: item[1]):
            yield Row("finite elements, K_in", f"{100 * accuracy:g} % of its limit", program, own, other)


def sweep() -> Iterator[Row]:
    """Yield a sweep by finite elements and designs that are meshed and solved one by one."""
    designs, fast = sweep_evaluators.sample(DESIGNS, 1), FastSolid(sweep_evaluators.ACCURACY)
    own = taken(lambda: [fast.evaluate(given) for given in designs], processor_time)
    chosen = [designs[i] for i in np.linspace(0, DESIGNS - 1, ANEW).astype(int)]
    one_by_one = partial(sweep_evaluators.lean, coarsenesses=sweep_evaluators.STEPS, accuracy=sweep_evaluators.ACCURACY)
    other = taken(lambda: [one_by_one(given) for given in chosen], processor_time) * DESIGNS / ANEW
    equal = f"{100 * sweep_evaluators.ACCURACY:g} % estimated error"
    yield Row(f"sweep, {DESIGNS} designs", equal, "each meshed and solved anew", own, other)


def simulation() -> Iterator[Row]:
    """Yield chains and SciPy's fastest method with a compiled right-hand side."""
    for name in CHAINS:
        right = dynamics_peer.reference(name, dynamics.MEASURED)
        steps, _ = dynamics.fewest_steps(name, "multisine", right)
        run = partial(dynamics.make_runner(name, SIGNAL), substeps=steps)
        way = dynamics_peer.best(name, wanted=TOLERANCE, seconds=dynamics.MEASURED)
        options = {key: value for key, value in way.items() if key not in ("error", "wall")}
        own, other = [], []
        for _ in range(dynamics.TURNS):
            own.append(taken(run))
            other.append(taken(partial(dynamics_peer.solve, name, SIGNAL, **options)))
        peer = f"SciPy {way['method']}, compiled"
        yield Row(f"simulation: {name}, {SIGNAL:g} s", f"{TOLERANCE:g} of the stroke", peer, min(own), min(other))


def fits() -> Iterator[Row]:
    """Yield the fits of a diagnosis and SciPy's trust-region method, where both reach the same cost."""
    tasks = [task for number in CASES for task in least_squares.tasks_of_case(number, least_squares.cases.SEED)]
    for label, manner in least_squares.MANNERS.items():
        pairs = list[tuple[float, float]]()
        for task in tasks:
            found = least_squares.compare_solvers(task, manner)
            own, other = found["own"], found["SciPy"]
            if not least_squares.is_lower(own, other) and not least_squares.is_lower(other, own):
                pairs.append((own.seconds, other.seconds))
            print(f"  {label}, {task.name}: {own.cost:.2f}, SciPy {other.cost:.2f}", flush=True)
        total, total_of_other = np.sum(pairs, axis=0)
        name = f"diagnosis: {len(pairs)} fits {label}"
        yield Row(name, "sum of squares", "SciPy least_squares (trf)", total, total_of_other)


def superelements() -> Iterator[Row]:
    """Yield the stage of condensed parts and the stage in one piece."""
    own, other = stage_monolithic.main()
    yield Row("stage, statics and six modes", "mesh of the parts", "the stage in one piece", own, other)


TASKS: Mapping[str, Callable[[], Iterator[Row]]] = {
    "finite_elements": finite_elements,
    "sweep": sweep,
    "simulation": simulation,
    "fits": fits,
    "superelements": superelements,
}


def document(rows: Sequence[Row], processors: int, load: float) -> Document:
    """Return the report: how much longer the peers take, as bars and as a table."""
    ratios = [row.rounded for row in rows]
    longer = sum(ratio > 1 for ratio in ratios)
    summary = [
        f"Peers take {min(ratios):g} to {max(ratios):g} times the processor time of flexdesign; "
        f"more in {longer} of {len(rows)} comparisons.",
        f"Times are those of the machine of this run: {processors} processors; load at the end of the run: {load:.1f}.",
    ]
    bars = Figure(
        "ratios.svg", _draw(rows), "Processor time of the peer over that of flexdesign; logarithmic",
        alt=f"Bars of the ratios in the table, {min(ratios):g} to {max(ratios):g}, on a logarithmic axis",
    )  # fmt: skip
    return Document(
        "Performance ratios", summary, [Section("Ratios", (), [Table(HEADS, [r.cells() for r in rows])], [bars])]
    )


def _draw(rows: Sequence[Row]) -> bytes:
    figure, axes = charts.drawing(charts.NARROW, 0.42 * len(rows) + 0.8)
    places = range(len(rows))
    colours = [charts.COLOURS[row.rounded < 1] for row in rows]
    axes.set_xscale("log")
    axes.barh(places, [row.ratio - 1 for row in rows], left=1.0, height=0.6, color=colours)
    for place, row in zip(places, rows, strict=True):
        axes.annotate(
            f"{row.rounded:g}", (max(row.ratio, 1.0), place), (4, 0), textcoords="offset points", va="center",
            color=charts.NEUTRAL, fontsize=9,
        )  # fmt: skip
    axes.axvline(1.0, color=charts.NEUTRAL, linewidth=1)
    axes.set_yticks(places, [f"{row.task},\n{row.peer}" for row in rows])
    axes.set_xlim(min(0.5, *(0.8 * row.ratio for row in rows)), 2 * max(row.ratio for row in rows))
    axes.invert_yaxis()
    axes.set_xlabel("peer / flexdesign")
    return charts.svg(figure)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it."""
    parser = argparse.ArgumentParser(prog="python -m studies.benchmarks", description="flexdesign and its peers")
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"of {', '.join(TASKS)} [default: all]")
    parser.add_argument("--result", type=Path, metavar="FILE", help="write the report of a kept result.json")
    parser.add_argument("--out", type=Path, default=Path("reports/benchmarks"), help="folder of the report")
    given = parser.parse_args(arguments)
    if unknown := [name for name in given.tasks if name not in TASKS]:
        parser.error(f"{unknown[0]} is none of {', '.join(TASKS)}")
    render.prepare(given.out)
    if given.result:
        kept = json.loads(given.result.read_text(encoding="utf-8"))
        rows = [Row(**{name: row[name] for name in Row.__annotations__}) for row in kept["rows"]]
        render.write(given.out, document(rows, kept["processors"], kept["load"]), kept, {})
        return 0
    rows = list[Row]()
    # Finite elements first: the peak memory of a process counts as that of those it starts.
    for name in (name for name in TASKS if name in (given.tasks or TASKS)):
        for row in TASKS[name]():
            rows.append(row)
            print(*row.cells(), sep=" | ", flush=True)
    processors, load = os.cpu_count() or 1, round(os.getloadavg()[0], 1)
    result = {
        "processors": processors,
        "load": load,
        "rows": [{**vars(row), "ratio": row.ratio} for row in rows],
        "versions": installed(["numpy", "scipy", "numba", "scikit-fem", "ngsolve", "gmsh"]),
    }
    render.write(given.out, document(rows, processors, load), result, {})
    print(plain(Table(HEADS, [row.cells() for row in rows])), given.out / "report.html", sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
