"""Published mechanisms from Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from flexdesign.api.result import Result
from flexdesign.core.result_cache import open_cache
from flexdesign.report import published_report
from flexdesign.workflows import published as workflow
from flexdesign.workflows.published import PublishedMechanisms

Progress = Callable[[str], None]


def published(
    *mechanisms: str | Path, cache: str | Path | None = None, progress: Progress = lambda _: None
) -> Result[PublishedMechanisms]:
    """Compare published numbers of mechanisms with ours, and name the effect that closes each gap.

    Parameters
    ----------
    mechanisms
        Folders, or names of folders in studies/published; all of these by default.
    cache
        Folder of meshes and solutions; default that of the command line.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If a folder cannot be used.
    """
    found = workflow.run(workflow.find(mechanisms), open_cache(cache), progress)
    return Result(
        found,
        published_report.document(found),
        published_report.overview(found),
        partial(published_report.result, found),
        rows=partial(published_report.rows, found),
    )
