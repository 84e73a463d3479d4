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

from flexdesign.core.errors import printable
from flexdesign.report.document import Document, Table


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


def brief(document: Document, table: Table, written: Sequence[Path]) -> None:
    """Print the card, the summary and one table of a report, and which files were written."""
    show(text(document, table), written)


def show(words: str, written: Sequence[Path]) -> None:
    """Print words as `text` returns them, and which files were written."""
    console = _console()
    console.print(Text(f"\n{words}"), soft_wrap=True)
    for path in written:
        console.print(f"  {path}", soft_wrap=True)


def text(document: Document, table: Table, *, closing: str = "", is_table_first: bool = False) -> str:
    """Return the card, the summary and one table of a report, and a closing sentence, as wide as the terminal."""
    console = _console(width=_console().width)
    with console.capture() as capture:
        console.print(Text(printable(document.title), style="bold"))
        _card(console, document)
        if is_table_first:
            console.print(_render(table))
        for paragraph in document.summary:
            console.print(f"{paragraph}\n")
        if not is_table_first:
            console.print(_render(table, wraps=True))
        if closing:
            console.print(closing)
    return capture.get()


def _card(console: Console, document: Document) -> None:
    """Print the card and the warnings of a report."""
    if document.card:
        rows = [[fact.name, fact.value, fact.note] for fact in document.card]
        console.print(_render(Table(["", "", ""], rows), wraps=True, headed=False))
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
        console.print(_render(table))
    return capture.get()


def _render(table: Table, *, wraps: bool = False, headed: bool = True) -> RichTable:
    rich_table = RichTable(
        title=table.caption or None, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0),
        show_header=headed,
    )  # fmt: skip
    for index, head in enumerate(table.columns):
        words = index < 1 or (wraps and table.wordy[index])
        # What is too long is broken into lines: nothing is cut off.
        rich_table.add_column(
            head, justify="left" if words else "right", no_wrap=index > 0 and not wraps, overflow="fold"
        )
    for row in table.rows:
        rich_table.add_row(*row)
    return rich_table
