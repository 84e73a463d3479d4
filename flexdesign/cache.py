"""Results kept by the content that made them: the same question is never computed twice.

A key is a hash of everything an answer depends on: the upstream result's content, options, the stage's version and the
libraries' versions. Entries are npz files with arrays and one JSON text; they are written whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError

Arrays = dict[str, NDArray[Any]]


def default_folder() -> Path:
    """Return the cache folder: $FLEXDESIGN_CACHE, or flexdesign/ under $XDG_CACHE_HOME or ~/.cache."""
    if chosen := os.environ.get("FLEXDESIGN_CACHE"):
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "flexdesign"


def content_key(*parts: object) -> str:
    """Return the hash of numbers, texts, arrays and nested tables thereof."""
    digest = hashlib.sha256()
    for piece in parts:
        if isinstance(piece, np.ndarray):
            digest.update(f"{piece.dtype}{piece.shape}".encode())
            digest.update(np.ascontiguousarray(piece).tobytes())
        else:
            digest.update(json.dumps(piece, sort_keys=True, default=repr).encode())
    return digest.hexdigest()[:32]


@dataclass(frozen=True)
class Cache:
    """A folder of results.

    Parameters
    ----------
    folder
        Where they are kept.
    """

    folder: Path

    def load(self, stage: str, key: str) -> tuple[Arrays, dict[str, Any]] | None:
        """Return the arrays and the table stored under `key`, or None; a damaged entry counts as none."""
        try:
            with np.load(self._path(stage, key), allow_pickle=False) as entry:
                arrays = {name: entry[name] for name in entry.files if name != "table"}
                return arrays, json.loads(str(entry["table"]))
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):
            return None

    def store(self, stage: str, key: str, arrays: Mapping[str, NDArray[Any]], table: Mapping[str, Any]) -> None:
        """Keep arrays and a JSON-ready table under `key`.

        Raises
        ------
        InputError
            If the folder cannot be written or is full; nothing half-written stays.
        """
        path = self._path(stage, key)
        temporary = ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
                temporary = file.name
                np.savez_compressed(file, **arrays, table=np.array(json.dumps(table)))  # type: ignore[arg-type]
            Path(temporary).replace(path)
        except OSError as error:
            if temporary:
                Path(temporary).unlink(missing_ok=True)
            remedy = (
                f"cannot keep results here ({error.strerror}); free space, or set FLEXDESIGN_CACHE to another folder"
            )
            raise InputError(self.folder, "", None, remedy) from error

    def _path(self, stage: str, key: str) -> Path:
        return self.folder / stage / f"{key}.npz"
