"""The command ``python -m studies.lin2019_gains``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from flexdesign.core.errors import InputError
from flexdesign.report import render
from studies.lin2019_gains import report, result
from studies.lin2019_gains.findings import investigate
from studies.lin2019_gains.printed import AXES


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.lin2019_gains", description="Plants of the printed gains of Lin et al. (2019)"
    )
    parser.add_argument("--out", type=Path, default=Path("reports/lin2019_gains"), help="folder of the report")
    folder = parser.parse_args(arguments).out
    try:
        render.prepare(folder)
        findings = [investigate(axis) for axis in AXES]
        render.write(folder, report.document(findings), result.of(findings), {})
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{folder / 'report.html'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
