"""What `compare`, `diagnose` and `add` do where the model is a design and the measurements are static tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexdesign.cli.shared import Place, place, print_json, progress
from flexdesign.errors import InputError

if TYPE_CHECKING:
    from flexdesign.diagnosis.tables import TableDiagnosis
    from flexdesign.report.document import Document, Table
    from flexdesign.static_tables import StaticModel, StaticTable


def is_design(model: str) -> bool:
    """Tell whether MODEL names a design, which says what its part is, and not a stage model."""
    from flexdesign import design
    from flexdesign.files import read_toml

    try:
        return "part" in read_toml(design.find(model))
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


def compare(model: str, paths: Sequence[Path], overrides: Sequence[str], out: Path | None, as_json: bool) -> None:
    """Compare a design with static tables and write the report."""
    from flexdesign.comparison import tables
    from flexdesign.report import table_report

    with progress() as say:
        stands, table = _read(model, paths, overrides)
        where = _place(stands, "compare", paths, overrides, [], out, "_compared")
        found = tables.compare(stands, table)
        say("writing")
        document, result = table_report.comparison_document(found), table_report.comparison_result(found)
        written = where.write(document, result, {})
    _print(document, result, table_report.rows_in_brief(found), written, as_json)


def diagnose(
    model: str,
    paths: Sequence[Path],
    overrides: Sequence[str],
    design_file: Path | None,
    out: Path | None,
    as_json: bool,
    *,
    bare: bool = False,
    own: Sequence[str] = (),
) -> None:
    """Diagnose a design from static tables, effects of the user's own tried as well, and write the report."""
    from flexdesign.diagnosis import tables
    from flexdesign.report import table_report

    with progress() as say:
        stands, table = _read(model, paths, overrides, bare=bare)
        more = _own_effects(own)
        options = [*(["bare"] if bare else []), *(f"effect={each}" for each in own)]
        where = _place(stands, "diagnose", paths, overrides, options, out, "_diagnosed")
        _refuse_folder(design_file)
        found = tables.diagnose(stands, table, say, more)
        say("writing")
        better = found.found.model if found.verdict == "effects-found" else stands
        document, result, written = _report(found, better, overrides, where, design_file)
    _print(document, result, table_report.ladder(found), written, as_json)


def add(
    model: str,
    effect: str,
    paths: Sequence[Path],
    overrides: Sequence[str],
    design_file: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Fit one effect to static tables, and write it into a design."""
    from flexdesign.diagnosis import tables
    from flexdesign.report import table_report

    with progress() as say:
        stands, table = _read(model, paths, overrides)
        name = _known_effect(effect, "EFFECT")
        if name in stands.effects:
            raise InputError("command line", "EFFECT", effect, "is in the model already")
        where = _place(stands, f"add {effect}", paths, overrides, [], out, f"_with_{Path(effect).stem}")
        _refuse_folder(design_file)
        found = tables.add(stands, name, table, say)
        say("writing")
        document, result, written = _report(found, found.found.model, overrides, where, design_file)
    _print(document, result, table_report.ladder(found), written, as_json)


def _place(
    model: StaticModel,
    verb: str,
    paths: Sequence[Path],
    overrides: Sequence[str],
    options: Sequence[str],
    out: Path | None,
    ending: str,
) -> Place:
    """Return where the report of a design beside tables goes."""
    from flexdesign.report import origin

    file = model.design.file
    return place(out, origin.name_of(file), verb, [file, *paths], overrides, options, ending)


def _report(
    found: TableDiagnosis, better: StaticModel, overrides: Sequence[str], where: Place, design_file: Path | None
) -> tuple[Document, dict[str, Any], list[Path]]:
    """Write the report of a diagnosis, and the better design beside it or where it is wanted."""
    from flexdesign.report import table_report

    document, result = table_report.diagnosis_document(found), table_report.diagnosis_result(found)
    text = design_text(better, overrides, design_file.parent if design_file else where.folder)
    written = where.write(document, result, {} if design_file else {"design.toml": text})
    return document, result, [*written, *([_write(design_file, text)] if design_file else [])]


def _print(document: Document, result: dict[str, Any], table: Table, written: Sequence[Path], as_json: bool) -> None:
    """Print the numbers alone, or the summary with one table and where the report is."""
    from flexdesign.report import terminal

    if as_json:
        print_json(result)
        return
    terminal.brief(document, table, [path for path in written if path.suffix != ".svg"])


def _read(
    model: str, paths: Sequence[Path], overrides: Sequence[str], *, bare: bool = False
) -> tuple[StaticModel, StaticTable]:
    from flexdesign import design, static_tables
    from flexdesign.files import is_folder

    read = design.read(design.find(model), overrides)
    files = [file for path in paths for file in (sorted(path.glob("*.csv")) if is_folder(path) else [path])]
    if not files:
        raise InputError("command line", "RUNS", ", ".join(map(str, paths)), "holds no CSV file")
    return static_tables.of_design(read, bare=bare), static_tables.read(files, read)


def _known_effect(name: str, field: str) -> str:
    """Return the name under which a static effect is found from everywhere, a path as an absolute one.

    Parameters
    ----------
    name
        Of the catalogue, or a path.
    field
        Where it was given, for the message.

    Raises
    ------
    InputError
        If there is none, or it has nothing that a fit could move.
    """
    from flexdesign.effects import statics

    try:
        whole = statics.beside(name, Path())
        effect = statics.find(whole)
    except ValueError as error:
        raise InputError("command line", field, name, str(error)) from None
    if not any(p.null is not None for p in effect.parameters):
        raise InputError("command line", field, name, "none of its parameters states a null, at which it is not there")
    return whole


def _own_effects(names: Sequence[str]) -> list[str]:
    """Return static effects beside those of the catalogue, as `diagnose` takes them; raise as `_known_effect` does."""
    from flexdesign.effects import statics

    whole = [_known_effect(name, "--effect") for name in names]
    return [name for name in dict.fromkeys(whole) if name not in statics.names()]


def design_text(model: StaticModel, overrides: Sequence[str], folder: Path) -> str:
    """Return the design file with a model's effects written into it; its part is found from the new folder."""
    from flexdesign import design, files, static_tables, units
    from flexdesign.effects import statics
    from flexdesign.files import read_toml

    content = read_toml(model.design.file, overrides)
    there = static_tables.drawn(model.design)
    content["effects"] = {
        files.way(Path(name), folder) if name.endswith(".py") else name: {
            p.name: f"{values[p.name] / units.factor(p.unit or '1', p.si):.6g} {p.unit}".rstrip()
            for p in statics.find(name).parameters
        }
        for name, values in model.effects.items()
        if values != there.get(name)
    }
    return design.to_toml(model.design, content, folder)


def _refuse_folder(path: Path | None) -> None:
    """Refuse a folder where the design's file is meant, before long work begins."""
    if path is not None and path.is_dir():
        raise InputError("command line", "-o", str(path), "cannot be written (it is a folder); choose another file")


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError("command line", "-o", str(path), f"cannot be written ({error.strerror})") from error
    return path
