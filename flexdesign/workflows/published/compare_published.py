"""Solve every published mechanism, and compare its published numbers with ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Literal

from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache
from flexdesign.workflows import validation
from flexdesign.workflows.published.closing import Closing, closing, model_of, neglected_effects
from flexdesign.workflows.published.folder import PublishedFolder, PublishedNumber, read
from flexdesign.workflows.validation import Validation, validate_stage
from flexdesign.workflows.validation.validate_stage import StageValidation

Progress = Callable[[str], None]
Verdict = Literal["agrees", "explained", "differs"]
#: What each verdict means.
VERDICTS: dict[Verdict, str] = {
    "agrees": "the numbers agree within the uncertainty",
    "explained": "they differ, and named effects that the published number leaves out close the gap",
    "differs": "they differ, and no effect of the catalogue closes the gap",
}


@dataclass(frozen=True)
class Compared:
    """A published number compared with ours.

    Parameters
    ----------
    number
        Theirs.
    ours
        Of finite elements, with its estimated error.
    closing
        The effects that close the gap, where there is one.
    neglected
        Where none do: what the effects that a formula neglects change in the compliance model, see `neglected_effects`.
    """

    number: PublishedNumber
    ours: Quantity
    closing: Closing | None = None
    neglected: Mapping[str, float] = field(default_factory=dict)

    @property
    def theirs(self) -> float:
        """The published number [SI]."""
        return self.number.printed.value(self.ours.si)

    @property
    def gap(self) -> float:
        """Theirs over ours, less one."""
        return self.theirs / self.ours.value - 1

    @property
    def allowed(self) -> float:
        """How far they may be apart, relative: what is known of theirs, and our estimated error."""
        return (self.number.half_width(self.ours.si) + (self.ours.half_width or 0.0)) / abs(self.ours.value)

    @property
    def verdict(self) -> Verdict:
        """One of `VERDICTS`."""
        if abs(self.gap) <= self.allowed:
            return "agrees"
        return "explained" if self.closing else "differs"


@dataclass(frozen=True)
class Mechanism:
    """One mechanism.

    Parameters
    ----------
    folder
        What was published.
    found
        Our finite elements.
    rows
        The numbers.
    """

    folder: PublishedFolder
    found: Validation | StageValidation
    rows: tuple[Compared, ...]


@dataclass(frozen=True)
class PublishedMechanisms:
    """All of them.

    Parameters
    ----------
    mechanisms
        In the order of their names.
    seconds
        How long it took.
    """

    mechanisms: tuple[Mechanism, ...]
    seconds: float

    @property
    def rows(self) -> list[Compared]:
        """All numbers."""
        return [row for mechanism in self.mechanisms for row in mechanism.rows]

    def counted(self) -> dict[str, int]:
        """Return how many numbers have each verdict."""
        return {verdict: sum(row.verdict == verdict for row in self.rows) for verdict in VERDICTS}


def run(folders: Sequence[Path], cache: Cache, progress: Progress = lambda _: None) -> PublishedMechanisms:
    """Solve mechanisms and compare them with what is published.

    Parameters
    ----------
    folders
        One for each mechanism, see `folder`.
    cache
        Where meshes and solutions are looked up and kept: an interrupted run goes on where it stopped.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If a folder cannot be used, or names a quantity that its validation does not find.
    """
    began = perf_counter()
    read_first = [read(folder) for folder in folders]
    found = [_solve(each, cache, lambda text, each=each: progress(f"{each.name}: {text}")) for each in read_first]  # type: ignore[misc]
    return PublishedMechanisms(tuple(found), perf_counter() - began)


def _solve(folder: PublishedFolder, cache: Cache, progress: Progress) -> Mechanism:
    solve = validate_stage.validate_stage if folder.study.design.is_stage else validation.validate
    mesh = folder.study.mesh.model_copy(update={"independent": False})  # the page has no place for that check
    found = solve(replace(folder.study, mesh=mesh), cache, progress)
    ours, model = by_key([*(c.fem for c in found.comparisons), *found.further]), model_of(folder.study.design)
    rows = []
    for number in folder.numbers:
        if number.key not in ours:
            remedy = f"{number.boundary}: no such quantity of this design{suggest(number.key, list(ours))}"
            raise InputError(folder.table, f"line {number.line}, column quantity", number.quantity, remedy)
        try:
            row = Compared(number, ours[number.key])
            differs = abs(row.gap) > row.allowed
        except ValueError as error:
            raise InputError(
                folder.table, f"line {number.line}, column unit", number.printed.unit, str(error)
            ) from None
        stated = number.kind == "formula" or number.neglects  # a simulation or a part leaves no elasticity out
        if differs and stated and model is not None and math.isfinite(row.gap):
            found_by = closing(model, number, 1 + row.gap, row.allowed)
            row = replace(row, closing=found_by, neglected={} if found_by else neglected_effects(model, number))
        rows.append(row)
    return Mechanism(folder, found, tuple(rows))
