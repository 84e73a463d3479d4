"""Results kept by the content that made them: the same question is never computed twice.

A key is a hash of everything an answer depends on: the upstream result's content, options, the stage's version and the
libraries' versions. Entries are npz files with arrays, one JSON text and a checksum of both; they are written whole or
not at all. Processes that share a folder see each other's entries.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError

Arrays = dict[str, NDArray[Any]]
#: Members of an entry in addition to its arrays: the table, and the checksum of all.
TABLE, DIGEST = "table", "sha256"
#: How unfinished entries end, and after how long [s] nobody is writing them any more.
PART, ABANDONED = ".part", 3600.0
_damaged: dict[str, None] = {}


def default_folder() -> Path:
    """Return the cache folder: $FLEXDESIGN_CACHE, or flexdesign/ under $XDG_CACHE_HOME or ~/.cache.

    Raises
    ------
    InputError
        If nothing is set and there is no home folder.
    """
    if chosen := os.environ.get("FLEXDESIGN_CACHE"):
        return Path(chosen)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "flexdesign"
    except RuntimeError as error:
        remedy = "there is no home folder to keep results in; set it to a folder"
        raise InputError("environment", "FLEXDESIGN_CACHE", None, remedy) from error


def content_key(*parts: object) -> str:
    """Return the hash of numbers, texts, arrays and nested tables thereof.

    >>> content_key(1, 23) == content_key(12, 3)
    False
    """
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=_as_json).encode()).hexdigest()[:32]


def _as_json(piece: object) -> Any:
    if isinstance(piece, np.ndarray):
        return [str(piece.dtype), piece.shape, hashlib.sha256(np.ascontiguousarray(piece).tobytes()).hexdigest()]
    return repr(piece)


def forget_damaged() -> None:
    """Begin anew with what was damaged: at the start of each command."""
    _damaged.clear()


def damaged() -> tuple[str, ...]:
    """Return the entries that this command found damaged; what they held was computed again."""
    return tuple(_damaged)


def _digest(arrays: Mapping[str, NDArray[Any]], table: str) -> str:
    """Return the checksum of an entry: of names, types, sizes and numbers of its arrays, and of its table."""
    return content_key(table, {name: np.asarray(array) for name, array in arrays.items()})


def _put(made: Path, path: Path) -> None:
    """Put a file in its place; where another process holds the same entry open, that one is as good."""
    try:
        made.replace(path)
    except PermissionError:  # on Windows alone
        if not path.exists():
            raise
        made.unlink(missing_ok=True)


def _clear(folder: Path) -> None:
    """Remove what processes left behind that were killed while they wrote."""
    for left in folder.glob(f"*/*{PART}"):
        try:
            if time.time() - left.stat().st_mtime > ABANDONED:
                left.unlink()
        except OSError:  # another process has just done it
            continue


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
        """Return the arrays and the table stored under `key`, or None.

        A damaged entry counts as none: one that is cut short, or of which the checksum is not that of its content.
        `damaged` names it.
        """
        path = self._path(stage, key)
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as entry:
                arrays = {name: entry[name] for name in entry.files if name not in (TABLE, DIGEST)}
                table, digest = str(entry[TABLE]), str(entry[DIGEST]) if DIGEST in entry.files else None
            if digest is not None and digest != _digest(arrays, table):
                raise ValueError("another checksum")
            return arrays, json.loads(table)
        except FileNotFoundError:
            return None
        except Exception:  # zip, zlib, NumPy and JSON each have their own errors
            _damaged.setdefault(str(path))
            return None

    def prepare(self) -> None:
        """Make the folder, before long work begins.

        Raises
        ------
        InputError
            If it cannot be made or written to.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                pass
            _clear(self.folder)
        except OSError as error:
            raise self._input_error(error) from error

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
            with tempfile.NamedTemporaryFile(dir=path.parent, suffix=PART, delete=False) as file:
                temporary = file.name
                text = json.dumps(table)
                own = {TABLE: np.array(text), DIGEST: np.array(_digest(arrays, text))}
                np.savez_compressed(file, **arrays, **own)  # type: ignore[arg-type]
            _put(Path(temporary), path)
        except BaseException as error:
            if temporary:
                Path(temporary).unlink(missing_ok=True)
            if isinstance(error, OSError):
                raise self._input_error(error) from error
            raise

    def _input_error(self, error: OSError) -> InputError:
        why = "it is a file" if isinstance(error, FileExistsError) else error.strerror or error
        remedy = f"cannot keep results here ({why}); free space, or choose another folder with --cache"
        return InputError("cache", "folder", str(self.folder), remedy)

    def _path(self, stage: str, key: str) -> Path:
        return self.folder / stage / f"{key}.npz"


def open_cache(folder: str | Path | None = None) -> Cache:
    """Return the cache in a folder, or the user's own, ready to be written to.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    store = Cache(Path(folder) if folder else default_folder())
    store.prepare()
    return store
