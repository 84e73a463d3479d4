"""What a report is made of, before anyone decides whether it becomes HTML, Markdown or text on a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from flexdesign.report import charts
from flexdesign.report.traces import Traces


@dataclass(frozen=True)
class Table:
    """A table of texts; the first column names the rows.

    Parameters
    ----------
    columns
        Column heads.
    rows
        Texts, one for each column.
    caption
        What it shows.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""

    @property
    def wordy(self) -> list[bool]:
        """For each column whether it holds words, which stand on the left, and not numbers: half its cells or more."""
        columns = zip(*self.rows, strict=True) if self.rows else [()] * len(self.columns)
        return [_words(cells) or index == 0 for index, cells in enumerate(columns)]


def _words(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell not in ("", "–")]
    return sum(not cell.lstrip("+-−± ").startswith(tuple("0123456789")) for cell in filled) * 2 > len(filled)


#: No name of a file has more letters, its ending not counted.
LONGEST = 100


class Live(Protocol):
    """What a page shows in place of a picture while its scripts run."""

    @property
    def kind(self) -> str:
        """The script that shows it: traces or view."""

    @property
    def curves(self) -> int:
        """How many curves share the room of a page."""

    def payload(self, points: int) -> dict[str, Any]:
        """Return its data for the page, with a limited number of points in a curve."""


@dataclass(frozen=True)
class Figure:
    """A picture in a file of its own.

    Parameters
    ----------
    file
        Its file name next to the report, ending in .png or .svg.
    data
        Its content.
    caption
        What it shows.
    live
        What the page shows in its place on a screen: curves to zoom into, a part to turn.
    alt
        What someone who cannot see it needs to know; none for what the drawing says of itself.
    """

    file: str
    data: bytes
    caption: str
    live: Live | None = None
    alt: str = ""

    @classmethod
    def of_traces(cls, file: str, traces: Traces, caption: str) -> Figure:
        """Return curves as a drawing, and as curves to zoom into where they run over an abscissa that increases."""
        live = traces if all(curve.x.size and (np.diff(curve.x) > 0).all() for curve in traces.every) else None
        return cls(file, traces.svg(), caption, live)

    @property
    def text(self) -> str:
        """The text in place of the picture where it cannot be seen."""
        return self.alt or charts.description(self.data) or self.caption

    @property
    def is_narrow(self) -> bool:
        """Whether a narrow window shows it whole; a wider drawing scrolls there."""
        return charts.is_narrow(self.data)

    def __post_init__(self) -> None:
        """Make a name for a file of any name that a run or a quantity has."""
        stem, dot, ending = self.file.rpartition(".")
        plain = "".join("_" if sign in '/\\:*?"<>|' or not sign.isprintable() else sign for sign in stem)
        object.__setattr__(self, "file", f"{plain[:LONGEST]}{dot}{ending}")


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs, then a text to copy, tables, and figures.

    A `folded` one is opened on demand; its `brief` is read before.
    The figures of a `gallery` are small and stand side by side.
    """

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    folded: bool = False
    gallery: bool = False
    brief: str = ""
    code: str = ""


@dataclass(frozen=True)
class Fact:
    """One number of a report's card.

    Parameters
    ----------
    name, value
        What it is, and the number with its unit.
    note
        Under which conditions, or what it is to be compared with.
    """

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Document:
    """A whole report.

    Parameters
    ----------
    title, summary
        Its heading and the answer in a few sentences.
    content
        The sections in order, or a function that draws them: it is called once, when they are first asked for.
    card
        The numbers that most readers look for, before the summary.
    warnings
        What a reader must know before using any of the numbers.
    picture
        File name of the figure that shows the answer, and stands next to it; none for the first, if
        possible of a section that is not folded.
    """

    title: str
    summary: Sequence[str]
    content: Sequence[Section] | Callable[[], Sequence[Section]] = ()
    card: Sequence[Fact] = ()
    warnings: Sequence[str] = ()
    picture: str = ""

    @cached_property
    def sections(self) -> Sequence[Section]:
        """The sections, in order."""
        return self.content() if callable(self.content) else self.content

    @property
    def figures(self) -> list[Figure]:
        """All figures, in order."""
        return [figure for section in self.sections for figure in section.figures]

    @cached_property
    def lead(self) -> Figure | None:
        """The figure that shows the answer."""
        named = (figure for figure in self.figures if figure.file == self.picture)
        first = (figure for section in self.sections if not section.folded for figure in section.figures)
        return next(named, None) or next(first, None) or next(iter(self.figures), None)

    @cached_property
    def body(self) -> list[Section]:
        """The sections without the figure next to the answer."""
        rest = [replace(s, figures=[f for f in s.figures if f is not self.lead]) for s in self.sections]
        return [s for s in rest if s.paragraphs or s.code or s.tables or s.figures]
