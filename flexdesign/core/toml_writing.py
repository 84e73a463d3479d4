"""Writing TOML: a new file from a table, and a change of a file that keeps its comments and its order."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.items import InlineTable, Item, Table
from tomlkit.toml_document import TOMLDocument


def with_comment(line: str, comment: str, column: int = 40) -> str:
    """Return a line of TOML with a comment that begins at a column.

    >>> with_comment('gain = "1 um/V"', "measured", 20)
    'gain = "1 um/V"     # measured'
    """
    return f"{line:<{column}}# {comment}"


def to_toml(content: Mapping[str, Any]) -> str:
    """Return a table as TOML: its own values, then the tables in it.

    A table in a list of tables stands whole in its own lines, the tables in it each in one.
    """
    return tomlkit.dumps(_order(content)).rstrip("\n") + "\n"


def _order(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table in TOML's order: values before tables, tables before lists of tables; empty tables left out."""
    tables = {name: value for name, value in content.items() if isinstance(value, Mapping)}
    lists = {name: value for name, value in content.items() if _is_of_tables(value)}
    values = {name: value for name, value in content.items() if name not in tables and name not in lists}
    inner = {name: _order(value) for name, value in tables.items() if value}
    return values | inner | {name: [_entry(entry) for entry in entries] for name, entries in lists.items()}


def _entry(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _inline(value) if isinstance(value, Mapping) else value for name, value in entry.items()}


def _inline(content: Mapping[str, Any]) -> InlineTable:
    table = tomlkit.inline_table()
    for name, value in content.items():
        table[name] = _inline(value) if isinstance(value, Mapping) else value
    return table


def _is_of_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def merge(original: str, before: str, after: str) -> str:
    """Return a file with the difference of two others applied: a three-way merge of TOML.

    Values that are the same before and after stay as the original writes them, with their comments. So do the comments
    of values that change, unless the comment was one of the text before.

    Parameters
    ----------
    original
        The file of the user.
    before, after
        What the program writes for the content of the original, and for the changed content.
    """
    document = tomlkit.parse(original)
    _merge(document, tomlkit.parse(before), tomlkit.parse(after))
    return tomlkit.dumps(document)


def _merge(original: Any, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
    for name in [name for name in before if name not in after and name in original]:
        del original[name]
    for name, new in after.items():
        old, there = before.get(name), original.get(name)
        if isinstance(new, Mapping) and isinstance(old, Mapping) and _is_open_table(there):
            _merge(there, old, new)
        elif _plain(old) != _plain(new):
            _put(original, name, new)
        if name in original and old is not None:
            _exchange_comment(original[name], old, new)


def _is_open_table(value: object) -> bool:
    return isinstance(value, Mapping) and not isinstance(value, InlineTable)


def _put(original: Any, name: str, new: Any) -> None:
    """Set a value under the same comment as the one it replaces."""
    old = original.get(name)
    if isinstance(old, InlineTable):
        original[name] = _inline(_plain(new))
    else:
        original[name] = tomlkit.item(_plain(new)) if isinstance(old, Item) else new
        if isinstance(new, Table) and not new.as_string().endswith("\n\n"):
            original[name].add(tomlkit.nl())  # the next table after an empty line
    if isinstance(old, Item) and old.trivia.comment:
        original[name].trivia.comment_ws = old.trivia.comment_ws
        original[name].trivia.comment = old.trivia.comment


def _exchange_comment(item: Any, old: Any, new: Any) -> None:
    """Give a value the new comment of the program where it has the old one."""
    if not all(isinstance(each, Item) for each in (item, old, new)) or isinstance(item, Mapping):
        return
    if old.trivia.comment and item.trivia.comment == old.trivia.comment:
        item.trivia.comment = new.trivia.comment
        item.trivia.comment_ws = new.trivia.comment_ws


def _plain(value: Any) -> Any:
    return value.unwrap() if isinstance(value, (Item, TOMLDocument)) else value
