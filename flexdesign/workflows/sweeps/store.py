"""Answers kept in a folder, each under the hash of its question, so that nothing is ever computed twice or lost.

A file holds the answers of one batch and is written whole or not at all; its name follows from the questions. Sweeps
that share a folder, at the same time or later, never write different things under one name.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from flexdesign.core.model import Quantity
from flexdesign.core.result_cache import Cache, content_key
from flexdesign.workflows.sweeps.results import Results

#: Format of the files, and the folder in which they are.
FORMAT, STAGE = 1, "cases"


class Store:
    """The answers in a folder.

    Parameters
    ----------
    folder
        Where they are; it is made when the first is kept.
    """

    def __init__(self, folder: Path) -> None:
        self._cache = Cache(folder)
        self._batches: list[Results] = []
        self._where: dict[str, tuple[int, int]] = {}
        self._read: set[str] = set()

    def refresh(self) -> None:
        """Read what has come since; a damaged file counts as none."""
        for path in sorted((self._cache.folder / STAGE).glob("*.npz")):
            if path.stem in self._read:
                continue
            self._read.add(path.stem)
            if (entry := self._cache.load(STAGE, path.stem)) is None or entry[1].get("format") != FORMAT:
                continue
            arrays, table = entry
            kinds = {key: Quantity(value=math.nan, **kind) for key, kind in table["kinds"].items()}
            values = {key: arrays["values"][i] for i, key in enumerate(kinds)}
            sigmas = {key: arrays["sigmas"][i] for i, key in enumerate(kinds)}
            self._add(table["keys"], Results(kinds, values, sigmas, table["errors"], arrays["seconds"]))

    def __contains__(self, key: str) -> bool:
        return key in self._where

    def find(self, keys: Sequence[str]) -> Results:
        """Return the answers to some questions, in their order.

        Raises
        ------
        KeyError
            If one is not there.
        """
        where = np.array([self._where[key] for key in keys], dtype=np.intp).reshape(len(keys), 2)
        batches = np.unique(where[:, 0])
        parts = ((b, np.flatnonzero(where[:, 0] == b)) for b in batches)
        return Results.concatenate(((self._batches[b], where[at, 1], at) for b, at in parts), len(keys))

    def keep(self, keys: Sequence[str], results: Results) -> None:
        """Write the answers of a batch.

        Raises
        ------
        InputError
            If the folder cannot be written; nothing half-written stays.
        """
        kinds = {key: asdict(kind) for key, kind in results.kinds.items()}
        for kind in kinds.values():
            del kind["value"], kind["half_width"]
        shape = (len(kinds), len(keys))
        arrays = {
            "values": np.array(list(results.values.values())).reshape(shape),
            "sigmas": np.array(list(results.sigmas.values())).reshape(shape),
            "seconds": results.seconds,
        }
        name = content_key(list(keys))
        table = {"format": FORMAT, "keys": list(keys), "kinds": kinds, "errors": list(results.errors)}
        self._cache.store(STAGE, name, arrays, table)
        self._read.add(name)
        self._add(keys, results)

    def _add(self, keys: Sequence[str], results: Results) -> None:
        self._where |= {key: (len(self._batches), row) for row, key in enumerate(keys)}
        self._batches.append(results)
