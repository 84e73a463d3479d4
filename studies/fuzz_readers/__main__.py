"""The command ``python -m studies.fuzz_readers``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from studies.fuzz_readers.hunting import Finding, Hunt
from studies.fuzz_readers.readers import READERS

#: Inputs of one reader before the next has its turn, where minutes are given.
TURN = 50


def main(arguments: Sequence[str] | None = None) -> int:
    """Read damaged files and say what was found; 1 if anything was."""
    parser = argparse.ArgumentParser(prog="python -m studies.fuzz_readers", description="Damaged files through readers")
    parser.add_argument("--seed", type=int, default=1, help="the same seed gives the same inputs [default: 1]")
    parser.add_argument("--inputs", type=int, default=200, help="of each reader [default: 200]")
    parser.add_argument("--reader", choices=sorted(READERS), action="append", help="one alone; may be repeated")
    parser.add_argument("--minutes", type=float, help="go on for so long, whatever the number of inputs")
    parser.add_argument("--first", type=int, default=0, help="number of the first input [default: 0]")
    parser.add_argument("--out", type=Path, default=Path("reports/fuzz_readers"), help="folder for files that are kept")
    given = parser.parse_args(arguments)
    chosen, began = given.reader or list(READERS), time.monotonic()

    def report(finding: Finding, kept: Path) -> None:
        print(f"{finding.reader}: {finding.cause}\n    {kept}", flush=True)

    hunt = Hunt(given.seed, given.out, report)
    if given.minutes is None:
        for name in chosen:
            hunt.run(name, given.first, given.inputs)
    else:
        first = given.first
        while time.monotonic() - began < 60 * given.minutes:
            for name in chosen:
                hunt.run(name, first, TURN)
            first += TURN
    print(f"{hunt.inputs.total()} inputs in {time.monotonic() - began:.0f} s")
    for name, count in hunt.inputs.items():
        several = sum(times for (reader, _), times in hunt.causes.items() if reader == name)
        causes = sum(reader == name for reader, _ in hunt.causes)
        print(f"{name:20} {count:7} inputs, {hunt.refused[name]:7} refused, {several:5} findings of {causes} causes")
    return 1 if hunt.causes else 0


if __name__ == "__main__":
    sys.exit(main())
