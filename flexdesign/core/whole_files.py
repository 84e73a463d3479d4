"""Files that are written whole or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(folder: Path) -> Iterator[Path]:
    """Yield a scratch folder, whose files move to `folder` once all are written; those that are there are replaced.

    After an error or an interruption nothing has changed.

    Parameters
    ----------
    folder
        Where the files go; it must exist. The scratch folder is in it, so that moving is renaming.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    with tempfile.TemporaryDirectory(dir=folder, prefix=".writing-") as scratch:
        yield Path(scratch)
        for file in sorted(Path(scratch).iterdir()):
            file.replace(folder / file.name)
