"""Reading a sweep, each refusal with its place."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from flexdesign.core import toml_files, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Parameter
from flexdesign.core.toml_files import Table, is_file, whole
from flexdesign.design import design as designs
from flexdesign.design.design import Design
from flexdesign.design.study import DESIGN_KEYS, MeshSettings
from flexdesign.dynamics import experiments, stage_model
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.workflows.sweeps import sensitivity, simulating
from flexdesign.workflows.sweeps.pareto import Aim, Limit
from flexdesign.workflows.sweeps.plan import Evaluator, SweepPlan, settings_of
from flexdesign.workflows.sweeps.sampling import Case, Factor, Method
from flexdesign.workflows.sweeps.simulating import STAGE_KEYS, STUDY_KEYS, Bench
from flexdesign.workflows.validation import stage_model_from_part

#: The one that simulates.
SIMULATION: Evaluator = "simulation"
#: No sweep has more cases than these.
MOST = 1_000_000
#: Tables and keys of a design, a stage model and a study of experiments: what may vary, and what --set may change.
SUBJECT_KEYS = (*DESIGN_KEYS, "effects", *STAGE_KEYS, *STUDY_KEYS)
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
    design: str = ""
    stage_model: str = ""
    experiments: str = ""
    vary: dict[str, Any] = Field(min_length=1)
    title: str = ""
    evaluator: Evaluator = "analytic"
    sample: _Sample = _Sample()
    limits: dict[str, str] = Field(default_factory=dict)
    aim: _Wanted = _Wanted()
    show: list[str] = Field(default_factory=list)
    mesh: MeshSettings = MeshSettings()


def is_sweep(path: Path) -> bool:
    """Tell whether a study file is a sweep."""
    return "vary" in toml_files.read_toml(path)


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
    of_sweep = [o for o in overrides if toml_files.overridden(o).partition(".")[0] not in SUBJECT_KEYS]
    of_subject = tuple(override for override in overrides if override not in of_sweep)
    with toml_files.attribute_overrides(of_sweep):
        content = toml_files.read_toml(path)
        if "vary" not in content:
            remedy = 'is missing; write what shall vary, such as vary."dimensions.width" = ["5 mm", "10 mm"]'
            raise InputError(path, "vary", None, remedy)
        checked = toml_files.check(_File, toml_files.overlay(content, of_sweep), path)
        bench = _bench(checked, path)
        file = _lying(checked.design, path, designs.find) if bench is None or bench.model is None else bench.model
        subject = _subject(file, of_subject, checked.evaluator, bench, path)
        known = _tables(checked.evaluator, bench)
        factors = tuple(_factor(key, given, subject, known, path) for key, given in checked.vary.items())
        _try(factors, file, of_subject, checked.evaluator, bench, path)
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
        title=checked.title,
        subject=subject,
        subject_file=file,
        overrides=of_subject,
        factors=factors,
        method=sample.method,
        count=cases_,
        seed=sample.seed,
        evaluator=checked.evaluator,
        mesh=checked.mesh,
        bench=bench,
        limits=limits,
        aims=aims,
        show=tuple(checked.show),
    )


def _bench(checked: _File, path: Path) -> Bench | None:
    """Return what is simulated; None if nothing is. Refuse what does not go together."""
    if bool(checked.design) == bool(checked.stage_model):
        why = "conflicts with a design; name one of them" if checked.design else None
        missing = "is missing; name the design that varies, or a stage_model to simulate"
        raise InputError(path, "stage_model" if why else "design", checked.stage_model or None, why or missing)
    if checked.evaluator != SIMULATION:
        for place, given in (("stage_model", checked.stage_model), ("experiments", checked.experiments)):
            if given:
                raise InputError(path, place, given, f'is for simulations; write evaluator = "{SIMULATION}"')
        return None
    model = _lying(checked.stage_model, path, stage_model.find) if checked.stage_model else None
    return Bench(model, _lying(checked.experiments, path, experiments.find) if checked.experiments else None)


def _lying(name: str, path: Path, find: Callable[[str], Path]) -> Path:
    """Return a file next to a sweep, or else is found by its name."""
    sibling = path.parent / name
    return sibling if is_file(sibling) else find(name)


def _subject(
    file: Path, overrides: Sequence[str], evaluator: Evaluator, bench: Bench | None, path: Path
) -> Design | StageModel:
    """Return the design or the stage model that varies."""
    known = _tables(evaluator, bench)
    for override in overrides:
        if (first := toml_files.overridden(override).partition(".")[0]) not in known:
            raise InputError("command line", "--set", override, f"{first} is nothing that this sweep has")
    if bench is not None and bench.model is not None:
        stage = stage_model.read(file, simulating.of_stage(overrides))
        bench.plan(stage, overrides)  # refuses what belongs to no such experiments
        return stage
    design = designs.read(file, simulating.of_design(overrides))
    if bench is not None and bench.study is not None:
        axes = list(design.stage().assembly().axes) if design.is_stage else [stage_model_from_part.AXIS]
        experiments.read(bench.study, axes, simulating.of_study(overrides))
    if design.is_stage and evaluator == "planar":
        remedy = 'is a whole stage, which is not of one section; write "fem", "analytic" or "pseudo-rigid"'
        raise InputError(path, "evaluator", evaluator, remedy)
    return design


def _tables(evaluator: Evaluator, bench: Bench | None) -> tuple[str, ...]:
    """Return the tables and keys that may vary."""
    if evaluator == "analytic":  # which alone knows the effects of a design
        return (*DESIGN_KEYS, "effects")
    if bench is None:
        return DESIGN_KEYS
    return (*STAGE_KEYS, *STUDY_KEYS, *(() if bench.model else DESIGN_KEYS))


def _factor(key: str, given: object, subject: Design | StageModel, known: Sequence[str], path: Path) -> Factor:
    """Return a factor as the file has it: a list of values, or a range; `known` are the tables that may vary."""
    place = f'vary."{key}"'
    if key.partition(".")[0] not in known:
        dimensions = [p.name for p in subject.part_class.dimensions] if isinstance(subject, Design) else []
        remedy = suggest(key, [*(f"dimensions.{each}" for each in dimensions), *known])
        remedy = f"write dimensions.{key}" if key in dimensions else f"is nothing of what varies{remedy}"
        if key.startswith("effects."):
            remedy = 'effects of a design are known to the compliance model: write evaluator = "analytic"'
        raise InputError(path, place, None, remedy)
    parameter = _dimension(key, subject, path, place) if isinstance(subject, Design) else None
    si, unit = (parameter.si, parameter.unit or "1") if parameter else ("", "")
    try:
        if isinstance(given, list):
            return _list_of_values(key, given, si, unit)
        return _range_of_values(key, toml_files.check(_Range, given if isinstance(given, dict) else {}, path), si, unit)
    except ValueError as error:
        raise InputError(path, place, None, str(error)) from None
    except InputError as error:
        remedy = f'{error.remedy}; a range is {{ from = "1 mm", to = "2 mm", count = 5 }}, a choice a list'
        raise InputError(path, f"{place}.{error.field}", error.value, remedy) from None


def _try(
    factors: Sequence[Factor],
    file: Path,
    overrides: Sequence[str],
    evaluator: Evaluator,
    bench: Bench | None,
    path: Path,
) -> None:
    """Refuse what a design, a stage model or its experiments do not have, before anything is run."""
    given, _ = settings_of(Case({f.key: f.values[0] for f in factors}), {f.key: f for f in factors})
    if not given:  # dimensions alone, which are known
        return
    try:
        _subject(file, (*overrides, *given), evaluator, bench, path)
    except InputError as error:
        if error.file == str(path):
            raise
        value = "" if error.value is None else f' = "{error.value}"'
        raise InputError(path, f'vary."{error.field}"{value}', None, error.remedy) from error


def _dimension(key: str, design: Design, path: Path, place: str) -> Parameter | None:
    """Return the dimension that a key means; None where it is something else that a design has."""
    first, _, name = key.partition(".")
    if first != "dimensions":
        return None
    known = {p.name: p for p in design.part_class.dimensions}
    if name not in known:
        raise InputError(path, place, None, f"is no dimension of this part{suggest(name, list(known))}")
    return known[name]


def _list_of_values(key: str, given: Sequence[object], si: str, unit: str) -> Factor:
    if not given:
        raise ValueError("has no values; write some, or leave it out")
    if si:
        return Factor(key, tuple(units.from_text(value, si) for value in given), si=si, unit=unit)
    return Factor(key, tuple(str(value) for value in given))


def _range_of_values(key: str, given: _Range, si: str, unit: str) -> Factor:
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
