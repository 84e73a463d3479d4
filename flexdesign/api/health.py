"""The installation from Python."""

from __future__ import annotations

from pathlib import Path

from flexdesign.api.result import Result
from flexdesign.core import versions
from flexdesign.report.document import Document, Section, Table
from flexdesign.workflows.doctor import Health, examine


def doctor(cache: str | Path | None = None) -> Result[Health]:
    """Say what the installation has and lacks, and how to get it.

    Parameters
    ----------
    cache
        Folder of the cache; the default one without it.

    Returns
    -------
    Result
        With `items` and `is_sound`.
    """
    found = examine(Path(cache) if cache else None)
    rows = [[item.name, item.state, item.found, item.remedy or "–"] for item in found.items]
    table = Table(["", "state", "found", "what to do"], rows)
    problems = [item.name for item in found.items if item.state == "problem"]
    missing = [item.name for item in found.items if item.state == "missing"]
    message = f"Problems: {', '.join(problems)}." if problems else "No problem."
    message = f"{message} Optional and missing: {', '.join(missing)}." if missing else message
    return Result(
        found,
        Document("flexdesign doctor", [message], [Section("Installation", tables=[table])]),
        table,
        lambda: {"items": list(found.items), "is_sound": found.is_sound, "made_by": versions.installed()},
        numbers={item.name: item.state for item in found.items},
    )
