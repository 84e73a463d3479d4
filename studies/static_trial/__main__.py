"""The command ``python -m studies.static_trial``."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence

from flexdesign.analytic import static_model
from flexdesign.diagnosis.static_tables import diagnose
from flexdesign.diagnosis.static_tables.diagnose import TableDiagnosis
from studies.static_trial.cases import KINDS, Case, case, references

#: Share of right answers that is asked for.
REQUIRED = 0.9


def diagnose_case(given: Case) -> TableDiagnosis:
    """Return the diagnosis of a case."""
    return diagnose.diagnose(static_model.of_design(given.design), given.table)


def answer_text(found: TableDiagnosis) -> str:
    """Return the answer in a word or two."""
    return " + ".join(found.found.names) if found.verdict == "effects-found" else found.verdict


def is_right(given: Case, found: TableDiagnosis) -> bool:
    """Tell whether an answer is right."""
    if given.kind == "none":
        return found.verdict == "nothing-missing"
    if given.kind.startswith("outside"):
        return found.verdict == "unknown"
    named = {*found.found.names, *(name for group in found.groups for name in group)}
    return found.verdict == "effects-found" and len(found.found.names) == 1 and given.kind in named


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose every case, print the answers; return 1 if too few are right."""
    parser = argparse.ArgumentParser(prog="python -m studies.static_trial", description="Is what is hidden found?")
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}")
    parser.add_argument("--noise", type=float, default=1.0, help="standard deviation of a measurement [%%]")
    given = parser.parse_args(arguments)
    right = count = 0
    print(f"{'hidden':24}{'right':>8}{'in a group':>12}   answers")
    for kind in given.kinds or KINDS:
        cases = [made for n in references() if (made := case(n, kind, given.noise / 100)) is not None]
        found = [diagnose_case(each) for each in cases]
        good = sum(is_right(each, answer) for each, answer in zip(cases, found, strict=True))
        grouped = sum(bool(answer.groups) for answer in found)
        answers = ", ".join(f"{what} {times}" for what, times in Counter(map(answer_text, found)).most_common())
        print(f"{kind:24}{good:4}/{len(cases):<3}{grouped:12}   {answers}", flush=True)
        right, count = right + good, count + len(cases)
    print(f"{right} of {count} answers are right: {100 * right / count:.1f} %")
    return 0 if right >= REQUIRED * count else 1


if __name__ == "__main__":
    sys.exit(main())
