"""The command ``python -m studies.ablation``."""

from __future__ import annotations

import argparse
import secrets
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.ablation import ablation, parts, recordings, report
from studies.hidden_effect_trial import trial

#: A fresh seed is smaller than this.
SEEDS = 10**6


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the cases with all parts and without each, and write the report."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.ablation", description="What do answers owe to each part of the diagnosis?"
    )
    parser.add_argument("--seed", type=int, help="draws all cases [default: a fresh one, which is printed]")
    parser.add_argument(
        "--sample", type=int, default=1, metavar="K", help="cases of each effect [default: %(default)s]"
    )
    parser.add_argument("--cases", type=int, metavar="N", help="only the first N, of all kinds in turn")
    parser.add_argument("--most", type=int, default=8, metavar="N", help="cases for each part [default: %(default)s]")
    parser.add_argument("--only", metavar="PART", help="one part, e.g. escape")
    parser.add_argument(
        "--recordings", type=Path, metavar="FOLDER", help="recordings of others, as studies.real_recordings reads them"
    )
    parser.add_argument("--jobs", type=int, default=trial.settings().jobs, help="processes [default: %(default)s]")
    parser.add_argument("--out", type=Path, default=Path("reports/ablation"), help="folder, with one for each seed")
    given = parser.parse_args(arguments)
    seed = secrets.randbelow(SEEDS) if given.seed is None else given.seed
    try:
        if seed < 0 or min(given.sample, given.most, 1 if given.cases is None else given.cases) < 1:
            raise ValueError("a seed is zero or more; a sample and numbers of cases are one or more")
        chosen = parts.chosen(given.only)
        there = [] if given.recordings is None else recordings.find(given.recordings)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if there:
        out = given.out / "recordings"
        answers = recordings.run(there, given.recordings, chosen, out, given.jobs, _say)
        lines = recordings.write(answers, chosen, out)
    else:
        settings, out = trial.settings().sample(given.sample), trial.folder_of(given.out, seed)
        numbers = _mixed([*settings.numbers(), *settings.imperfect_numbers()])[: given.cases]
        found = ablation.run(numbers, chosen, given.most, out, given.jobs, seed, _say)
        lines = report.write(found, chosen, out, seed)
    for line in lines:
        print(line)
    print(out / "report.html")
    return 0


def _mixed(numbers: Sequence[int]) -> list[int]:
    """Return numbers in an order that takes kinds in turn, so that the first few are of many kinds.

    >>> _mixed([10000, 10001, 10002, 20000, 20100])
    [10000, 20000, 10001, 20100, 10002]
    """
    kinds: dict[int, list[int]] = {}
    for number in numbers:
        kinds.setdefault(number // 10000, []).append(number)
    longest = max(map(len, kinds.values()), default=0)
    return [kind[k] for k in range(longest) for kind in kinds.values() if k < len(kind)]


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
