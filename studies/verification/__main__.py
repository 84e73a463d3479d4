"""The command ``python -m studies.verification``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from flexdesign.core.errors import InputError
from flexdesign.report import render
from studies.verification import beams, elements, hinges, large, nafems, report
from studies.verification.finding import Finding, failures
from studies.verification.published_guide import published_guide

Problem = Callable[[], list[Finding]]

#: Every problem, by group.
PROBLEMS: Mapping[str, tuple[Problem, ...]] = {
    "Elements": (
        elements.patch_test,
        elements.rigid_motions,
        elements.manufactured_solution,
        elements.reciprocity_and_scaling,
    ),
    "Benchmarks": (nafems.elliptic_membrane, nafems.thick_plate, nafems.tapered_membrane),
    "Cantilevers": (beams.cantilevers,),
    "Hinges": (hinges.circular_hinge, hinges.own_mesh, hinges.leaf_hinge),
    "Large displacements": (large.bent_cantilever, large.parasitic_motion, published_guide),
}


def solve(problem: Problem) -> list[Finding]:
    """Solve a problem and note the time."""
    began = perf_counter()
    findings = problem()
    seconds = perf_counter() - began
    return [replace(finding, seconds=seconds) for finding in findings]


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve all problems and write the table; return 1 if a number lies outside its range."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.verification", description="Finite elements against known answers"
    )
    parser.add_argument("--out", type=Path, default=Path("reports/verification"), help="folder of the report")
    given = parser.parse_args(arguments)
    try:
        render.prepare(given.out)
        groups: dict[str, list[Finding]] = {}
        for group, problems in PROBLEMS.items():
            groups[group] = []
            for problem in problems:
                groups[group] += (found := solve(problem))
                print(f"{found[0].problem}: {found[0].seconds:.1f} s", file=sys.stderr)
        render.write(given.out, report.document(groups), report.of(groups), {})
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(given.out / "report.md")
    lost = failures([finding for group in groups.values() for finding in group])
    print(*lost, sep="\n", file=sys.stderr, end="\n" if lost else "")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
