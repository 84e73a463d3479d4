"""`compare`, `diagnose` and `add_effect` where the model is a design and the measurements are static tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard

from flexdesign.analytic import static_model
from flexdesign.analytic.static_model import StaticModel, StaticTable
from flexdesign.api.result import Result
from flexdesign.core import toml_files, units
from flexdesign.core.errors import InputError
from flexdesign.core.toml_files import is_folder, read_toml
from flexdesign.design import design as designs
from flexdesign.design.design import Design
from flexdesign.diagnosis.comparison import static_table
from flexdesign.diagnosis.comparison.static_table import TableComparison
from flexdesign.diagnosis.static_tables import diagnose as diagnosing
from flexdesign.diagnosis.static_tables.diagnose import TableDiagnosis
from flexdesign.dynamics.stage_model.effect_names import known_effect, own_effects
from flexdesign.effects import statics
from flexdesign.report.diagnosis import table_report

Progress = Callable[[str], None]


def is_design(model: object) -> TypeGuard[str | Path | Design]:
    """Tell whether a model is a design, or names one, and not a stage model."""
    if not isinstance(model, (str, Path)):
        return isinstance(model, Design)
    try:
        return "part" in read_toml(designs.find(model))
    except InputError:  # then it is not a design, or the reader of stage models says what is wrong
        return False


def refuse(options: dict[str, object]) -> None:
    """Refuse options that mean nothing for static tables."""
    for name, given in options.items():
        if given:
            raise InputError("command line", name, str(given), "is for recordings of a stage, not for static tables")


def refuse_bare(bare: bool) -> None:
    """Refuse the option of a design where the model is that of a stage."""
    if bare:
        raise InputError("command line", "--bare", None, "is for designs and static tables, not for a stage model")


def compare(model: str | Path | Design, tables: object, changes: Sequence[str]) -> Result[TableComparison]:
    """Compare a design with static tables; raise InputError if either cannot be used."""
    design, table = _read(model, tables, changes)
    found = static_table.compare(design, table)
    return Result(
        found,
        table_report.comparison_document(found),
        table_report.rows_in_brief(found),
        partial(table_report.comparison_result, found),
    )


def diagnose(
    model: str | Path | Design,
    tables: object,
    changes: Sequence[str],
    *,
    bare: bool = False,
    own: Sequence[str] = (),
    progress: Progress = lambda _: None,
) -> Result[TableDiagnosis]:
    """Diagnose a design from static tables, effects of the user's own tried as well; raise InputError as `compare`."""
    design, table = _read(model, tables, changes, bare=bare)
    found = diagnosing.diagnose(design, table, progress, own_effects(own, statics))
    return _diagnosis_result(found, found.found.model if found.verdict == "effects-found" else design, changes)


def add_effect(
    model: str | Path | Design,
    effect: str,
    tables: object,
    changes: Sequence[str],
    *,
    progress: Progress = lambda _: None,
) -> Result[TableDiagnosis]:
    """Fit one effect to static tables, and put it into a design; raise InputError as `compare`."""
    design, table = _read(model, tables, changes)
    name = known_effect(effect, "EFFECT", statics)
    if name in design.effects:
        raise InputError("command line", "EFFECT", effect, "is in the model already")
    found = diagnosing.add(design, name, table, progress)
    return _diagnosis_result(found, found.found.model, changes)


def _diagnosis_result(found: TableDiagnosis, better: StaticModel, changes: Sequence[str]) -> Result[TableDiagnosis]:
    return Result(
        found,
        table_report.diagnosis_document(found),
        table_report.error_ladder(found),
        partial(table_report.diagnosis_result, found),
        lambda folder: {"design.toml": design_text(better, changes, folder)},
        dict(found.found.model.effects),
    )


def _read(
    model: str | Path | Design, tables: object, changes: Sequence[str], *, bare: bool = False
) -> tuple[StaticModel, StaticTable]:
    design = model if isinstance(model, Design) else designs.read(designs.find(model), changes)
    given = [tables] if isinstance(tables, (str, Path)) else tables
    paths = [Path(each) for each in given if isinstance(each, (str, Path))] if isinstance(given, Iterable) else []
    files = [file for path in paths for file in (sorted(path.glob("*.csv")) if is_folder(path) else [path])]
    if not files:
        raise InputError("command line", "RUNS", ", ".join(map(str, paths)), "holds no CSV file")
    return static_model.of_design(design, bare=bare), static_model.read(files, design)


def design_text(model: StaticModel, changes: Sequence[str], folder: Path) -> str:
    """Return the design file with a model's effects written into it; its part is found from the new folder."""
    content: dict[str, Any] = read_toml(model.design.file, changes)
    there = static_model.nominal_effects(model.design)
    content["effects"] = {
        toml_files.way(Path(name), folder) if name.endswith(".py") else name: {
            p.name: f"{values[p.name] / units.factor(p.unit or '1', p.si):.6g} {p.unit}".rstrip()
            for p in statics.find(name).parameters
        }
        for name, values in model.effects.items()
        if values != there.get(name)
    }
    return designs.to_toml(model.design, content, folder)
