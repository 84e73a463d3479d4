"""The command ``python -m studies.hidden_effect_trial``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.hidden_effect_trial import trial
from studies.hidden_effect_trial.cases import SEED
from studies.hidden_effect_trial.scoring import error_ratio


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trial, or one case of it, and write the report."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.hidden_effect_trial", description="Does the diagnosis name what was hidden?"
    )
    parser.add_argument(
        "--imperfect", action="store_true", help="benches with structural errors that no effect describes"
    )
    parser.add_argument("--rough", action="store_true", help="stage models that are off by up to 40 %%, and say so")
    parser.add_argument(
        "--only", metavar="KIND", help="none, single, pair, outside, faint, an effect, or a structural error"
    )
    parser.add_argument("--seed", type=int, default=SEED, help="draws all cases [default: %(default)s, for training]")
    parser.add_argument("--sample", type=int, metavar="K", help="K cases of each single effect, others in proportion")
    parser.add_argument("--cases", type=int, metavar="N", help="only the first N of what is asked for")
    parser.add_argument("--ci", action="store_true", help="only the part for continuous integration")
    parser.add_argument("--case", type=int, metavar="NUMBER", help="one case, again, and what was said of it")
    parser.add_argument("--draw", action="store_true", help="make the recordings and diagnose nothing")
    parser.add_argument("--jobs", type=int, help="processes")
    parser.add_argument("--fresh", action="store_true", help="do again what is done")
    parser.add_argument("--report", action="store_true", help="only write the report of what is done")
    parser.add_argument(
        "--out", type=Path, default=trial.OUT, help="folder of what comes of it, with one for each seed"
    )
    given = parser.parse_args(arguments)
    kind = "imperfect" if given.imperfect else "rough" if given.rough else ""
    settings, out = trial.settings(), trial.folder_of(given.out, given.seed, kind)
    try:
        if given.seed < 0 or (given.sample is not None and given.sample < 1):
            raise ValueError("a seed is zero or more, a sample one or more")
        settings = settings if given.sample is None else settings.sample(given.sample)
        if given.case is not None:
            return _one(given.case, out, given.seed, given.draw)
        if given.imperfect and given.rough:
            raise ValueError("--imperfect and --rough are trials of their own")
        choose = {"imperfect": settings.imperfect_numbers, "rough": settings.rough_numbers}.get(kind, settings.numbers)
        numbers = list(settings.ci) if given.ci else choose(given.only, given.cases)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if given.draw:
        for number in numbers:
            print(trial.make_case(number, out, given.seed)[0], flush=True)
        return 0
    if given.report:
        known = trial.read_outcomes(out, given.seed)
        outcomes = [known[n] for n in numbers if n in known]
    else:
        jobs = settings.jobs if given.jobs is None else given.jobs
        outcomes = trial.run(numbers, out, jobs, settings.seconds, _say, given.fresh, given.seed)
    from studies.hidden_effect_trial import imperfect_report, report

    write = imperfect_report.write if given.imperfect else report.write
    for line in write(outcomes, out, given.seed):
        print(line)
    print(out / "report.html")
    return 0 if all(outcome.found is not None for outcome in outcomes) else 1


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _one(number: int, out: Path, seed: int, draw: bool) -> int:
    folder, answer = trial.make_case(number, out, seed)
    print(folder)
    if draw:
        return 0
    outcome = trial.run_case(number, out, seed=seed)
    trial.append_outcome(outcome, out)
    print(trial.outcome_text(outcome))
    if outcome.found is not None:
        times = error_ratio(answer, outcome.found)
        print(f"error {1e6 * outcome.found.error:.4g} um, {times:.3g} times the floor, {outcome.found.seconds:.1f} s")
        for name, (hit, width) in outcome.found.inside.items():
            print(f"{name}: interval of ±{100 * width:.2g} % {'holds' if hit else 'misses'} the truth")
    return 0 if outcome.found is not None else 1


if __name__ == "__main__":
    sys.exit(main())
