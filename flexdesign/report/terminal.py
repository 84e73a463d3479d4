"""What a run says on the terminal: progress on stderr, the answer on stdout."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from flexdesign.errors import printable
from flexdesign.report import validation_report
from flexdesign.report.document import Document, Table
from flexdesign.validation import Validation


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show what is going on: a spinner on a terminal, a line each where stderr is a file."""
    console = Console(stderr=True, highlight=False, markup=False, emoji=False)
    began = perf_counter()
    if not console.is_terminal:
        yield lambda text: console.print(f"{perf_counter() - began:6.1f} s  {text}", soft_wrap=True)
        return
    with console.status("reading") as status:
        yield lambda text: status.update(Text(f"{text} ({perf_counter() - began:.0f} s)"))


def show(document: Document, validation: Validation, written: Sequence[Path]) -> None:
    """Print Table 1, the summary and where the report is."""
    console = _console()
    console.print(Text(f"\n{printable(document.title)}", style="bold"))
    _card(console, document)
    console.print(_drawn(_compact(validation_report.table_1(validation))))
    for paragraph in document.summary:
        console.print(f"{paragraph}\n")
    cached = sum(level.cached for level in validation.levels)
    origin = f"{cached} of {len(validation.levels)} solutions came from the cache" if cached else "nothing was cached"
    console.print(f"Solved in {validation.seconds:.0f} s; {origin}.")
    for path in written:
        console.print(f"  {path}", soft_wrap=True)


def brief(document: Document, table: Table, written: Sequence[Path]) -> None:
    """Print the summary, one table, and where the report is."""
    console = _console()
    console.print(Text(f"\n{printable(document.title)}", style="bold"))
    _card(console, document)
    for paragraph in document.summary:
        console.print(f"{paragraph}\n")
    console.print(_drawn(table, wraps=True))
    for path in written:
        console.print(f"  {path}", soft_wrap=True)


def _card(console: Console, document: Document) -> None:
    """Print the card and the warnings of a report."""
    if document.card:
        rows = [[fact.name, fact.value, fact.note] for fact in document.card]
        console.print(_drawn(Table(["", "", ""], rows), wraps=True, headed=False))
    for warning in document.warnings:
        console.print(f"Warning: {printable(warning)}")
    if document.card or document.warnings:
        console.print()


def _console(**options: Any) -> Console:
    """Return a terminal on which brackets and colons in what users wrote mean nothing."""
    return Console(highlight=False, markup=False, emoji=False, **options)


def plain(table: Table) -> str:
    """Return a table as plain text."""
    console = _console(width=200, no_color=True)
    with console.capture() as capture:
        console.print(_drawn(table))
    return capture.get()


def _compact(table: Table) -> Table:
    """Fit Table 1 into 80 columns: symbol and unit alone, and of several models the first and the last."""
    rows = []
    for name, boundary, fem, *rest in table.rows:
        value, _, tail = fem.partition(" ± ")
        error, _, unit = tail.partition(" ")
        cells = [cell.split()[0] for cell in (rest if len(rest) <= 4 else [*rest[:2], *rest[-2:]])]
        rows.append([f"{name.split()[-1]} {boundary}", f"{value} ± {error}", unit, *cells])
    kept = table.columns[3:] if len(table.columns) <= 7 else [*table.columns[3:5], *table.columns[-2:]]
    heads = ["err %" if head == "error" else head for head in kept]
    return Table(["", "FEM", "", *heads], rows, table.caption)


def _drawn(table: Table, *, wraps: bool = False, headed: bool = True) -> RichTable:
    drawn = RichTable(
        title=table.caption or None, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0),
        show_header=headed,
    )  # fmt: skip
    for index, head in enumerate(table.columns):
        words = index < 1 or (wraps and table.wordy[index])
        # What is too long is broken into lines: nothing is cut off.
        drawn.add_column(head, justify="left" if words else "right", no_wrap=index > 0 and not wraps, overflow="fold")
    for row in table.rows:
        drawn.add_row(*row)
    return drawn
