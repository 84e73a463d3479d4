"""The command ``python -m studies.sensitivity``."""

from __future__ import annotations

import argparse
import secrets
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.hidden_effect_trial import trial
from studies.sensitivity import constants, report, settings

#: A fresh seed is smaller than this.
SEEDS = 10**6


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the cases under every setting, and write the report."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.sensitivity", description="What do answers owe to each decision constant?"
    )
    parser.add_argument("--seed", type=int, help="draws all cases [default: a fresh one, which is printed]")
    parser.add_argument("--cases", type=int, default=12, metavar="N", help="size of the sample [default: %(default)s]")
    parser.add_argument("--only", metavar="CONSTANT", help="one constant, e.g. criterion.SHARE")
    parser.add_argument("--jobs", type=int, default=trial.settings().jobs, help="processes [default: %(default)s]")
    parser.add_argument("--out", type=Path, default=Path("reports/sensitivity"), help="folder, with one for each seed")
    given = parser.parse_args(arguments)
    seed = secrets.randbelow(SEEDS) if given.seed is None else given.seed
    try:
        if seed < 0 or given.cases < 1:
            raise ValueError("a seed is zero or more, a sample one case or more")
        chosen = constants.chosen(given.only)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    out = trial.folder_of(given.out, seed)
    wanted = settings.variations(chosen, settings.numbers(given.cases))
    ended = settings.run(wanted, out, given.jobs, trial.settings().seconds, seed, _say)
    for line in report.write(ended, chosen, out, seed):
        print(line)
    print(out / "report.html")
    return 0


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
