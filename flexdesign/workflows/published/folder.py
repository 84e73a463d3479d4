"""A published mechanism is a folder: one TOML file, its design or study, and one CSV file, the published numbers.

The CSV file has the columns ``quantity,value,unit,sigma,boundary,place,kind,neglects``, and optionally ``note``.
Quantity and boundary are those of a validation. Without a sigma a number is known to half a unit of its last digit. The
place says where it is printed, the kind what made it (`KINDS`), and `neglects` names the static effects that a formula
leaves out, with spaces between. The note says what is known of a difference that no effect explains. Lines that begin
with ``#`` are comments.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flexdesign.core import data_files, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity
from flexdesign.core.printed_numbers import Printed
from flexdesign.core.toml_files import is_folder
from flexdesign.design import study as studies
from flexdesign.design.study import Study
from flexdesign.effects import statics

HEAD = ("quantity", "value", "unit", "sigma", "boundary", "place", "kind", "neglects")
#: A column that may follow them.
NOTE = "note"
#: What a published number is.
KINDS = ("formula", "simulation", "measurement")
#: Where such folders are, below the folder of studies.
FOLDER = "published"


@dataclass(frozen=True)
class PublishedNumber:
    """One number that somebody published.

    Parameters
    ----------
    quantity, boundary
        As a validation names them.
    printed
        Its place and its text with unit.
    sigma
        Its standard deviation, as text with unit; empty where not stated.
    kind
        One of `KINDS`.
    neglects
        Static effects that it leaves out, where known.
    line
        Of its file.
    note
        What is known of its difference from ours, besides effects.
    """

    quantity: str
    boundary: str
    printed: Printed
    sigma: str
    kind: str
    neglects: tuple[str, ...]
    line: int
    note: str = ""

    @property
    def key(self) -> str:
        """Name and boundary in one word, as `Quantity.key`."""
        return Quantity(self.quantity, 0.0, "", "", self.boundary).key

    def half_width(self, si: str) -> float:
        """Return how closely it is known [SI]: two standard deviations, or half a unit of its last digit."""
        return 2 * units.from_text(self.sigma, si) if self.sigma else self.printed.half_digit(si)


@dataclass(frozen=True)
class PublishedFolder:
    """What a folder holds.

    Parameters
    ----------
    name
        Of the folder.
    study
        How its design is solved.
    table
        The file of the numbers.
    numbers
        The published numbers, in the order of the file.
    source
        The comment at the head of the file.
    """

    name: str
    study: Study
    table: Path
    numbers: tuple[PublishedNumber, ...]
    source: str


def find(names: Sequence[str | Path] = ()) -> list[Path]:
    """Return folders of published mechanisms: those of these names or paths, or without any all that there are.

    Raises
    ------
    InputError
        If there is none of a name.
    """
    bases = dict.fromkeys(base / "studies" / FOLDER for base in (Path(), data_files.root()))
    known = {path.name: path for base in reversed(bases) if is_folder(base) for path in sorted(base.iterdir())
             if is_folder(path) and any(path.glob("*.toml"))}  # fmt: skip
    if not names:
        return [known[name] for name in sorted(known)]
    found = []
    for name in names:
        folder = Path(name) if is_folder(Path(name)) else known.get(str(name))
        if folder is None:
            remedy = f"is no folder of a published mechanism{suggest(str(name), list(known))}"
            raise InputError("command line", "MECHANISM", str(name), remedy)
        found.append(folder)
    return found


def read(folder: Path) -> PublishedFolder:
    """Read the folder of a published mechanism.

    Raises
    ------
    InputError
        If it has not one TOML and one CSV file, or something in them cannot be used.
    """
    toml, table = (_only(folder, ending) for ending in ("toml", "csv"))
    study = studies.read(toml)
    try:
        text = table.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(table, "", None, "cannot be read as UTF-8 text; save it anew") from error
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    source = " ".join(line.lstrip("# ").strip() for _, line in lines if line.startswith("#"))
    cells = [(number, next(csv.reader([line]))) for number, line in lines if not line.startswith("#")]
    if not cells or tuple(cells[0][1]) not in (HEAD, (*HEAD, NOTE)):
        raise InputError(table, "header", None, f"the first line is {','.join(HEAD)}, and may end with ,{NOTE}")
    if len(cells) == 1:
        raise InputError(table, "", None, "holds no number; write one in each line")
    numbers = tuple(_number(table, *each, cells[0][1]) for each in cells[1:])
    return PublishedFolder(folder.name, study, table, numbers, source)


def _only(folder: Path, ending: str) -> Path:
    files = sorted(folder.glob(f"*.{ending}"))
    if len(files) != 1:
        remedy = "has to hold one TOML file, the design or study, and one CSV file, the published numbers"
        raise InputError(folder, f"*.{ending}", f"{len(files)} files", remedy)
    return files[0]


def _number(table: Path, line: int, cells: Sequence[str], head: Sequence[str]) -> PublishedNumber:
    if len(cells) != len(head):
        raise InputError(table, f"line {line}", f"{len(cells)} cells", f"the header has {len(head)}")
    row = dict(zip(head, (cell.strip() for cell in cells), strict=True))
    for name in ("quantity", "boundary", "place"):
        if not row[name]:
            raise InputError(table, f"line {line}, column {name}", None, "is empty")
    if row["kind"] not in KINDS:
        remedy = f"is none of {', '.join(KINDS)}{suggest(row['kind'], KINDS)}"
        raise InputError(table, f"line {line}, column kind", row["kind"], remedy)
    neglects = tuple(row["neglects"].split())
    for name in neglects:
        if name not in statics.BY_DRAWING:
            remedy = f"is no effect of a drawing{suggest(name, statics.BY_DRAWING)}"
            raise InputError(table, f"line {line}, column neglects", name, remedy)
    unit = row["unit"] if row["unit"] != "1" else ""
    _require_number(table, line, row)
    text = f"{row['value']} {unit}".rstrip()
    printed = Printed(row["place"], row["quantity"], text)
    sigma = f"{row['sigma']} {unit}".rstrip() if row["sigma"] else ""
    note = row.get(NOTE, "")
    return PublishedNumber(row["quantity"], row["boundary"], printed, sigma, row["kind"], neglects, line, note)


def _require_number(table: Path, line: int, row: Mapping[str, str]) -> None:
    for name in ("value", "sigma"):
        if name == "sigma" and not row[name]:
            continue
        try:
            value = float(row[name])
        except ValueError:
            value = 0.0
        if value == 0 or value - value != 0 or (name == "sigma" and value < 0):
            remedy = "is no number to compare with; write a finite number that is not zero, with a decimal point"
            raise InputError(table, f"line {line}, column {name}", row[name] or None, remedy)
