"""What a command found: a value that prints itself, holds numbers by name, and writes its report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from flexdesign.core.errors import InputError, suggest
from flexdesign.core.serialise import to_json
from flexdesign.report import render, terminal
from flexdesign.report.document import Document, Table

if TYPE_CHECKING:
    import pandas

Found = TypeVar("Found")


def _none(_: Path) -> dict[str, str | bytes]:
    return {}


@dataclass(frozen=True, eq=False, repr=False)
class Result(Generic[Found]):
    """The result of a command.

    Attributes of `found` are attributes of the result: ``fd.diagnose(model, runs).verdict``.

    Parameters
    ----------
    found
        What was computed.
    document
        The report; its pictures are drawn when it is written.
    table
        The table that represents it on the terminal.
    serialise
        Returns result.json's content.
    files
        Returns, for the folder of the report, what is written next to it: text by file name.
    numbers
        Numbers by name, for ``result["K_in"]``.
    rows
        Returns one row of plain values for each line of `to_dataframe`; without it that has the texts of `table`.
    closing, is_table_first
        How the terminal shows it: a last sentence, and whether the table stands before the summary.
    """

    found: Found
    document: Document
    table: Table
    serialise: Callable[[], dict[str, Any]]
    files: Callable[[Path], Mapping[str, str | bytes]] = _none
    numbers: Mapping[str, Any] = field(default_factory=dict)
    rows: Callable[[], Sequence[Mapping[str, Any]]] | None = None
    closing: str = ""
    is_table_first: bool = False

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of what was found."""
        if name.startswith("__") or name == "found":
            raise AttributeError(name)
        return getattr(self.found, name)

    def __getitem__(self, name: str) -> Any:
        """Return a number by its name.

        Raises
        ------
        KeyError
            If there is none of this name; the message suggests one.
        """
        if name not in self.numbers:
            raise KeyError(f"{name}{suggest(name, sorted(self.numbers))}")
        return self.numbers[name]

    def __contains__(self, name: object) -> bool:
        """Tell whether there is a number of this name."""
        return name in self.numbers

    def __iter__(self) -> Iterator[str]:
        """Go through the names of the numbers."""
        return iter(self.numbers)

    def __str__(self) -> str:
        """Return what the command line prints."""
        return terminal.text(self.document, self.table, closing=self.closing, is_table_first=self.is_table_first)

    def __repr__(self) -> str:
        """Return the title and what was computed."""
        return f"<{self.document.title}: {type(self.found).__name__}>"

    def _repr_html_(self) -> str:
        """Return title, summary and table for a notebook."""
        heads = "".join(f"<th>{escape(head)}</th>" for head in self.table.columns)
        rows = "".join(f"<tr>{''.join(f'<td>{escape(c)}</td>' for c in row)}</tr>" for row in self.table.rows)
        words = "".join(f"<p>{escape(text)}</p>" for text in [*self.document.warnings, *self.document.summary])
        return f"<h4>{escape(self.document.title)}</h4>{words}<table><tr>{heads}</tr>{rows}</table>"

    def to_dict(self) -> dict[str, Any]:
        """Return result.json's content: every number with its unit, and what made it."""
        return self._serialised

    @cached_property
    def _serialised(self) -> dict[str, Any]:
        found: dict[str, Any] = to_json(self.serialise())
        return found

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the result as a pandas table.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise InputError("environment", "pandas", None, "is not installed; run pip install pandas") from None
        if self.rows is not None:
            return pandas.DataFrame.from_records(list(self.rows()))
        return pandas.DataFrame([list(row) for row in self.table.rows], columns=list(self.table.columns))

    def report(self, folder: str | Path) -> list[Path]:
        """Write report.html, report.md, result.json, the pictures and the other files into a folder; return all paths.

        Raises
        ------
        InputError
            If the folder cannot be written.
        """
        place = Path(folder)
        render.prepare(place)
        return render.write(place, self.document, self.to_dict(), self.files(place))
