"""The command ``python -m studies.error_bars``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Cache, default_folder
from flexdesign.report import render
from studies.error_bars import report, trial
from studies.error_bars.designs import COUNT, SEED, SampledDesign, curved_designs, designs
from studies.error_bars.findings import Case, judge

OUT = Path("reports/error_bars")


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve the designs and write the report; return 1 if too few estimates contain the reference."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.error_bars", description="Do the estimates of the discretisation error hold?"
    )
    parser.add_argument("--designs", type=int, default=COUNT, metavar="N", help=f"only the first N of each {COUNT}")
    parser.add_argument("--method", choices=["extruded", "wild"], help="only this one, of leaves")
    parser.add_argument("--curved", action="store_true", help="only the designs with curved necks")
    parser.add_argument("--seed", type=int, default=SEED, help="other designs, which no constant was chosen on")
    parser.add_argument("--fresh", action="store_true", help="solve again what is solved")
    parser.add_argument("--work", type=Path, help="folder of the single results; without it, in the cache")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the report")
    parser.add_argument("--result", type=Path, metavar="FILE", help="only write the report of this result.json again")
    given = parser.parse_args(arguments)
    if given.result:
        result = json.loads(given.result.read_text(encoding="utf-8"))
        return _write(report.cases_of(result), result, given.out)
    asked = _select_cases(given.designs, given.method, curved=given.curved, seed=given.seed)
    try:
        render.prepare(given.out)
        store = Cache(default_folder())
        work = given.work or store.folder / "error_bars"
        work = work if given.seed == SEED else work / f"seed-{given.seed}"
        if given.fresh:
            trial.forget(work)
        cases, began = [], perf_counter()
        for count, (sample, method) in enumerate(asked, 1):
            cases.append(_case(sample, method, work, store))
            left = (perf_counter() - began) / count * (len(asked) - count) / 60
            print(f"{count:3d}/{len(asked)}  {_line(cases[-1])}  [{left:.0f} min left]", file=sys.stderr, flush=True)
        return _write(cases, report.of(cases), given.out)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _write(cases: Sequence[Case], result: dict[str, Any], out: Path) -> int:
    render.write(out, report.document(cases), result, {})
    print(*report.summary(cases), out / "report.html", sep="\n")
    return 0 if _estimates_hold(cases) else 1


def _select_cases(
    count: int, method: trial.Method | None, *, curved: bool, seed: int = SEED
) -> list[tuple[SampledDesign, trial.Method]]:
    """Return designs and methods: those with leaves by every method, those with curved necks by extruded meshes."""
    methods: tuple[trial.Method, ...] = () if curved else (method,) if method else ("extruded", "wild")
    asked = [(d, how) for how in methods for d in designs(seed)[:count] if how == "extruded" or d.is_unstructured]
    if not method:
        asked += [(sample, "extruded") for sample in curved_designs(seed)[:count]]
    return asked


def _case(sample: SampledDesign, method: trial.Method, work: Path, store: Cache) -> Case:
    def say(text: str) -> None:
        print(f"design {sample.number}: {text}", file=sys.stderr, flush=True)

    return Case(
        sample, method, trial.solve_design(sample, method, work, store, say), trial.solve_reference(sample, work, say)
    )


def _line(case: Case) -> str:
    found = case.answer.error or ", ".join(f"{deviation.in_estimates:+.2f}" for deviation in case.deviations)
    return f"{case.sample.number:2d} {case.group:8s} {found}"


def _estimates_hold(cases: Sequence[Case]) -> bool:
    """Tell whether estimates hold, group by group, and every design has an answer."""
    of_groups = [[d for c in cases if c.group == group for d in c.deviations] for group in report.GROUPS]
    return all(case.deviations for case in cases) and all(judge(found).holds for found in of_groups if found)


if __name__ == "__main__":
    sys.exit(main())
