"""Numbers that somebody printed, as a file has them: each as text with its unit, under its place in the publication."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from pydantic import Field

from flexdesign.core import data_files, toml_files, units
from flexdesign.core.errors import InputError
from flexdesign.core.toml_files import Table

#: A text that every such file holds.
MARK = "[printed."


@dataclass(frozen=True)
class Printed:
    """A printed number.

    Parameters
    ----------
    place, name
        Where it stands, such as ``"Table 1, model"``, and what it is called in the file.
    text
        As printed, with its unit.
    """

    place: str
    name: str
    text: str

    @property
    def unit(self) -> str:
        """The unit as printed; empty if there is none."""
        return self.text.partition(" ")[2]

    def value(self, si: str) -> float:
        """Return the number in an SI unit."""
        return units.from_text(self.text, si)

    def half_digit(self, si: str) -> float:
        """Return half a unit of its last digit, in an SI unit: how closely a rounded number is known."""
        number = self.text.partition(" ")[0]
        exponent = int(Decimal(number).as_tuple().exponent)
        return 0.5 * 10.0**exponent * units.factor(self.unit or "1", si)


@dataclass(frozen=True)
class Publication:
    """What a publication prints, and which studies repeat it.

    Parameters
    ----------
    name, title
        Of the file.
    stage, model, experiments
        The study of the stage, its model for simulations, and the study of experiments.
    printed
        The numbers by place and name.
    """

    name: str
    title: str
    stage: str
    model: str
    experiments: str
    printed: Mapping[tuple[str, str], Printed]

    def __call__(self, place: str, name: str) -> Printed:
        """Return a number by its place and name."""
        return self.printed[place, name]


class _File(Table):
    format: int
    title: str = ""
    stage: str
    model: str
    experiments: str
    printed: dict[str, dict[str, Any]] = Field(examples=['[printed."Table 1"]'])


def find(name: str | Path) -> Path:
    """Return a file of printed numbers: a path, or a bare name looked up in studies/, here and as shipped.

    Raises
    ------
    InputError
        If there is no such file.
    """
    return data_files.find(name, "publication", MARK, "PUBLICATION")


def read(name: str | Path) -> Publication:
    """Read a file of printed numbers, see `find`.

    Raises
    ------
    InputError
        If there is no such file, or a number cannot be read.
    """
    path = find(name)
    checked = toml_files.check(_File, toml_files.read_toml(path), path)
    printed = {}
    for place, numbers in checked.printed.items():
        for key, text in numbers.items():
            if not isinstance(text, str) or not text[:1].isdigit():
                remedy = 'expected a number as text, with its unit: "18.3 N/mm"'
                raise InputError(path, f"printed.{place}.{key}", toml_files.as_written(text), remedy)
            printed[place, key] = Printed(place, key, text)
    return Publication(
        path.stem, checked.title or path.stem, checked.stage, checked.model, checked.experiments, printed
    )
