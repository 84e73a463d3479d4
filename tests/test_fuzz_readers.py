"""Damaged files through every reader: half a seeded minute here, hours with ``python -m studies.fuzz_readers``."""

from __future__ import annotations

import logging
from pathlib import Path
from random import Random

import pytest

from flexdesign.core.errors import InputError
from studies.fuzz_readers import hunting, readers
from studies.fuzz_readers.hunting import Finding, Hunt
from studies.fuzz_readers.mutations import WAYS, damage

#: Of each reader.
INPUTS = 150


@pytest.mark.parametrize("name", readers.READERS)
def test_every_reader_reads_a_damaged_file_or_says_in_one_message_what_is_wrong(tmp_path: Path, name: str) -> None:
    said = list[str]()

    def report(finding: Finding, kept: Path) -> None:
        said.append(f"{finding.cause}\n{finding.details[-1500:]}")

    hunt = Hunt(2026, tmp_path, report)
    hunt.run(name, 0, INPUTS)
    assert not said, "\n\n".join(said)
    # As many as that are neither all refused nor all read.
    assert 0 < hunt.refused[name] < INPUTS or name == "answers"


def test_the_same_seed_gives_the_same_damage() -> None:
    text = b"a = 1\nb = [2, 3]\n"
    for kind in WAYS:
        first, again, other = (damage(text, kind, Random(f"{seed} {kind}")) for seed in (1, 1, 9))
        assert first == again and (first, text) != (other, other)


# --- what counts as a finding: readers made for it


def tried(folder: Path, monkeypatch: pytest.MonkeyPatch, read: object) -> str:
    """Return the cause that is found with a reader of an undamaged file."""
    made = readers.Reader(read, {"a.txt": lambda: b"text"}, {"a.txt": "table"})  # type: ignore[arg-type]
    monkeypatch.setitem(readers.READERS, "made", made)
    monkeypatch.setattr(hunting, "LONGEST", 0.3)
    hunt = Hunt(1, folder)
    hunt.run("made", 1, 1)
    return "; ".join(cause for _, cause in hunt.causes)


def refuses(remedy: str, field: str = "a") -> object:
    def read(folder: Path) -> None:
        raise InputError(folder / "a.txt", field, "b", remedy)

    return read


def waits(folder: Path) -> None:
    while True:
        pass


def leaves(folder: Path) -> None:
    (folder / "out").mkdir()
    (folder / "out" / "half.csv").touch()
    raise InputError(folder / "a.txt", "a", None, "write b")


@pytest.mark.parametrize(
    ("read", "cause"),
    [
        (lambda folder: {}["a"], "KeyError"),
        (waits, "hang"),
        (refuses("invalid literal for int() with base 10"), "jargon"),
        (refuses(""), "no remedy"),
        (leaves, "files are left"),
        (lambda folder: print("read"), "terminal"),
        (lambda folder: logging.getLogger("library").warning("cut short"), "terminal"),
        (refuses("write b"), ""),
        (lambda folder: None, ""),
    ],
)
def test_what_must_not_happen_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: object, cause: str
) -> None:
    found = tried(tmp_path, monkeypatch, read)
    assert cause in found and bool(found) == bool(cause)
