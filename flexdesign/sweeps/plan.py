"""A file that says what shall vary, how it is answered for, and what is wanted of it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from flexdesign import design as designs
from flexdesign import files, units
from flexdesign.design import Design
from flexdesign.errors import InputError, suggest
from flexdesign.files import Table, whole
from flexdesign.study import DESIGN_KEYS, MeshSettings
from flexdesign.sweeps import sensitivity
from flexdesign.sweeps.choosing import Aim, Limit
from flexdesign.sweeps.sampling import Case, Factor, Method, cases

#: Who answers: the paper's formulas, the compliance model, finite elements in the plane or in space.
Evaluator = Literal["pseudo-rigid", "analytic", "planar", "fem"]
#: No sweep has more cases than these.
MOST = 1_000_000
_RANGE = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)")


class _Range(Table):
    low: str | float = Field(alias="from")
    high: str | float = Field(alias="to")
    count: whole(2, 100_000) = 5  # type: ignore[valid-type]
    spacing: Literal["linear", "log"] = "linear"


class _Sample(Table):
    method: Method = "grid"
    count: whole(1, MOST) = 64  # type: ignore[valid-type]
    seed: whole(0, 2**31) = 0  # type: ignore[valid-type]


class _Wanted(Table):
    maximise: list[str] = Field(default_factory=list)
    minimise: list[str] = Field(default_factory=list)

    @model_validator(mode="before")
    @classmethod
    def _one_or_more(cls, given: Any) -> Any:
        """Take one quantity for a list of one."""
        return {k: [v] if isinstance(v, str) else v for k, v in given.items()} if isinstance(given, dict) else given


class _File(Table):
    format: int
    design: str
    vary: dict[str, Any] = Field(min_length=1)
    title: str = ""
    evaluator: Evaluator = "analytic"
    sample: _Sample = _Sample()
    limits: dict[str, str] = Field(default_factory=dict)
    aim: _Wanted = _Wanted()
    show: list[str] = Field(default_factory=list)
    mesh: MeshSettings = MeshSettings()


@dataclass(frozen=True)
class SweepPlan:
    """What a sweep does.

    Parameters
    ----------
    file, name, title
        Where it was read, the name of that file, and what people call it.
    design, overrides
        The design that is varied, and what the command line changed of it.
    factors, method, count, seed
        What varies, and how it is sampled.
    evaluator, mesh
        Who answers for a case; and how, if finite elements do.
    limits, aims
        What a design has to keep, and what is to be large or small.
    show
        Quantities of which the report has curves; by default those of limits and aims, or a few that everybody asks.
    """

    file: Path
    name: str
    title: str
    design: Design
    overrides: tuple[str, ...]
    factors: tuple[Factor, ...]
    method: Method
    count: int
    seed: int
    evaluator: Evaluator
    mesh: MeshSettings
    limits: tuple[Limit, ...]
    aims: tuple[Aim, ...]
    show: tuple[str, ...]

    def cases(self) -> list[Case]:
        """Return all cases, in the order of the sample."""
        return list(cases(self.factors, self.method, self.count, self.seed))


def is_sweep(path: Path) -> bool:
    """Tell whether a study file is a sweep."""
    return "vary" in files.read_toml(path)


def read(name: str | Path, overrides: Sequence[str] = ()) -> SweepPlan:
    """Read a sweep.

    Parameters
    ----------
    name
        Path of the file, or the bare name of one in ``studies/``.
    overrides
        ``table.key=value``, of the design or of the sweep.

    Raises
    ------
    InputError
        If anything in it or in the overrides cannot be used.
    """
    path = designs.find(name)
    of_design = [o for o in overrides if o.partition("=")[0].strip().partition(".")[0] in DESIGN_KEYS]
    of_sweep = [override for override in overrides if override not in of_design]
    with files.attributed(of_sweep):
        content = files.read_toml(path)
        if "vary" not in content:
            remedy = 'is missing; write what shall vary, such as vary."dimensions.width" = ["5 mm", "10 mm"]'
            raise InputError(path, "vary", None, remedy)
        checked = files.check(_File, files.overlay(content, of_sweep), path)
        beside = path.parent / checked.design
        design = designs.read(beside if beside.is_file() else designs.find(checked.design), of_design)
        if design.is_stage:
            remedy = "is a whole stage; a sweep is of a single part: name the design of its amplifier or guide"
            raise InputError(path, "design", checked.design, remedy)
        factors = tuple(_factor(key, given, design, path) for key, given in checked.vary.items())
        sample = checked.sample
        if sample.method == "sensitivity":
            sensitivity.refuse_absence(path)
        cases_ = math.prod(len(factor.values) for factor in factors) if sample.method == "grid" else sample.count
        if cases_ > MOST:
            raise InputError(path, "vary", f"{cases_} cases", f"are more than {MOST}; take fewer values, or a sample")
        limits = tuple(Limit.read(key, text, path) for key, text in checked.limits.items())
        aims = tuple(
            Aim(quantity, largest)
            for quantities, largest in ((checked.aim.maximise, True), (checked.aim.minimise, False))
            for quantity in quantities
        )
    return SweepPlan(
        file=path,
        name=path.stem,
        title=checked.title or f"{design.title}: a sweep",
        design=design,
        overrides=tuple(of_design),
        factors=factors,
        method=sample.method,
        count=cases_,
        seed=sample.seed,
        evaluator=checked.evaluator,
        mesh=checked.mesh,
        limits=limits,
        aims=aims,
        show=tuple(checked.show),
    )


def _factor(key: str, given: object, design: Design, path: Path) -> Factor:
    """Return a factor as the file has it: a list of values, or a range."""
    place = f'vary."{key}"'
    first, _, name = key.partition(".")
    if first not in (*DESIGN_KEYS, "effects"):
        known = [f"dimensions.{p.name}" for p in design.part_class.dimensions]
        bare = next((each for each in known if each.endswith(f".{key}")), "")
        remedy = f"write {bare}" if bare else f"is nothing of a design{suggest(key, [*known, 'material'])}"
        raise InputError(path, place, None, remedy)
    parameter = next((p for p in design.part_class.dimensions if first == "dimensions" and p.name == name), None)
    if first == "dimensions" and parameter is None:
        known = [p.name for p in design.part_class.dimensions]
        raise InputError(path, place, None, f"is no dimension of this part{suggest(name, known)}")
    si, unit = (parameter.si, parameter.unit or "1") if parameter else ("", "")
    try:
        if isinstance(given, list):
            return _listed(key, given, si, unit)
        return _ranged(key, files.check(_Range, given if isinstance(given, dict) else {}, path), si, unit)
    except ValueError as error:
        raise InputError(path, place, None, str(error)) from None
    except InputError as error:
        remedy = f'{error.remedy}; a range is {{ from = "1 mm", to = "2 mm", count = 5 }}, a choice a list'
        raise InputError(path, f"{place}.{error.field}", error.value, remedy) from None


def _listed(key: str, given: Sequence[object], si: str, unit: str) -> Factor:
    if not given:
        raise ValueError("has no values; write some, or leave it out")
    if si:
        return Factor(key, tuple(units.from_text(value, si) for value in given), si=si, unit=unit)
    return Factor(key, tuple(str(value) for value in given))


def _ranged(key: str, given: _Range, si: str, unit: str) -> Factor:
    if not si:  # some other number of a design: its unit is that of the range
        found = [_RANGE.fullmatch(str(end)) for end in (given.low, given.high)]
        if not all(found):
            raise ValueError("has no numbers as its ends")
        unit = found[0][2].strip() or "1"  # type: ignore[index]
        si = unit
    low, high = (units.from_text(end, si) for end in (given.low, given.high))
    if given.spacing == "log" and not low * high > 0:
        raise ValueError("steps of equal ratio need two ends of one sign, and not zero")
    if low == high:
        raise ValueError("begins where it ends")
    space = np.geomspace if given.spacing == "log" else np.linspace
    values = tuple(float(value) for value in space(low, high, given.count))
    return Factor(key, values, (low, high), given.spacing == "log", si, unit)


def settings_of(case: Case, factors: Mapping[str, Factor]) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return a case as overrides of the design, and as dimensions [SI] that need no reading."""
    overrides, dimensions = [], {}
    for key, value in case.values.items():
        if key.startswith("dimensions.") and isinstance(value, float):
            dimensions[key.removeprefix("dimensions.")] = value
        else:
            text = f"{value:.12g} {factors[key].unit}".removesuffix(" 1") if isinstance(value, float) else value
            overrides.append(f"{key}={text}")
    return tuple(overrides), dimensions
