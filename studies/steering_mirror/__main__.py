"""The command ``python -m studies.steering_mirror``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from flexdesign.core.errors import InputError
from flexdesign.report import render
from studies.steering_mirror import report
from studies.steering_mirror.findings import investigate
from studies.steering_mirror.recordings import read


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and write its report; next to it the modal axes as `diagnose` reads them."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.steering_mirror", description="Diagnosis of a fine steering mirror, mode by mode"
    )
    default = Path(os.environ.get("FLEXDESIGN_RECORDINGS", ".")) / "steering-mirror"
    parser.add_argument("recordings", type=Path, nargs="?", default=default, help="folder of the arrays")
    parser.add_argument("--out", type=Path, default=Path("reports/steering_mirror"), help="folder of the report")
    given = parser.parse_args(arguments)
    try:
        render.prepare(given.out)
        findings = investigate(read(given.recordings), given.out / "modal", lambda said: print(said, file=sys.stderr))
        render.write(given.out, report.document(findings), report.of(findings), {})
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(given.out / "report.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
