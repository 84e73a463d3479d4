"""Designs from Python: read one, validate it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from flexdesign.api.changing import overrides
from flexdesign.api.result import Result
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.core.model.quantity import by_key
from flexdesign.core.result_cache import Cache, open_cache
from flexdesign.core.toml_files import FORMAT
from flexdesign.core.toml_writing import to_toml as table_to_toml
from flexdesign.core.whole_files import written_whole
from flexdesign.design import design as designs
from flexdesign.design import study as studies
from flexdesign.design.design import Design
from flexdesign.design.study import Study
from flexdesign.dynamics.stage_model import to_toml
from flexdesign.measurements.static_table import to_csv
from flexdesign.workflows import validation
from flexdesign.workflows.sweeps import evaluators
from flexdesign.workflows.validation import Validation, validate_stage
from flexdesign.workflows.validation.validate_stage import StageValidation

Progress = Callable[[str], None]
#: Short names of quantities, besides the keys that a report uses.
SHORT = {
    "K_in": "K_in_output_free",
    "amplification": "lambda_output_free",
    "K_out": "K_out_input_free",
    "K_out_held": "K_out_input_held",
}


def read_design(name: str | Path, changes: Sequence[str] = (), **tables: Any) -> Design:
    """Read a design.

    Parameters
    ----------
    name
        A path, or the bare name of a design in geometry/.
    changes
        ``key=value``, as `--set` takes them.
    tables
        The same as nested tables: ``dimensions={"hinge_thickness": "0.4 mm"}``, ``material="Ti-6Al-4V"``.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    return designs.read(designs.find(name), overrides(changes, tables))


def formulas(design: str | Path | Design, changes: Sequence[str] = (), **tables: Any) -> dict[str, Quantity]:
    """Return what the compliance model says of a design, without finite elements, in milliseconds.

    Parameters
    ----------
    design
        A design, its path or bare name.
    changes, tables
        What differs, as `read_design` takes them: ``dimensions={"hinge_thickness": "0.4 mm"}``.

    Returns
    -------
    dict
        Quantities by their keys, such as ``K_in_output_free``; with an actuator also the stroke.

    Raises
    ------
    InputError
        If the design cannot be read or built, or has no compliance model.
    """
    read = design if isinstance(design, Design) and not changes and not tables else None
    if read is None:
        read = read_design(design.file if isinstance(design, Design) else design, changes, **tables)
    return by_key(evaluators.by_formulas(read, "compliance"))


def draw(file: str | Path, *, material: str, dimensions: Mapping[str, str], **tables: Any) -> Design:
    """Draw a planar mechanism: write it as a design file and read that.

    Parameters
    ----------
    file
        Where the design is written; a file that is there is replaced.
    material
        Its material.
    dimensions
        Its numbers with their units, by name.
    tables
        ``plate``, ``body``, ``flexure``, ``port`` and whatever else a sketch or a design has, as its file has it.
        A flexure's ends are ``{"from": [x, y], "to": [x, y]}``.

    Raises
    ------
    InputError
        If it is no mechanism, or the file cannot be written.
    """
    path = Path(file)
    content = {"format": FORMAT, "part": "sketch", "material": material, "dimensions": dict(dimensions), **tables}
    try:
        with written_whole(path.parent) as scratch:
            (scratch / path.name).write_text(table_to_toml(content), encoding="utf-8")
    except OSError as error:
        raise InputError(path, "", None, f"cannot be written ({error.strerror}); choose another place") from error
    return designs.read(path)


def read_study(design: str | Path | Design | Study, changes: Sequence[str] = (), **tables: Any) -> Study:
    """Return how a design is studied: meshes, modes, output.

    Parameters
    ----------
    design
        A design, or the path or bare name of a design or study.
    changes, tables
        What differs from the defaults, as `read_design` takes them: ``mesh={"levels": 2}``.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    given = overrides(changes, tables)
    if isinstance(design, Design):
        return studies.of_design(design, given)
    return design if isinstance(design, Study) else studies.read(design, given)


def validate(
    design: str | Path | Design | Study,
    changes: Sequence[str] = (),
    *,
    cache: str | Path | None = None,
    progress: Progress = lambda _: None,
    **tables: Any,
) -> Result[Validation] | Result[StageValidation]:
    """Solve a design with finite elements, and compare it with the formulas: Table 1, modes, stress, coupling.

    Parameters
    ----------
    design
        A design, or the path or bare name of a design or study.
    changes, tables
        What differs, as `read_design` takes them: ``mesh={"levels": 2}``.
    cache
        Folder of meshes and solutions; default that of the command line.
    progress
        Receives a text about the progress.

    Returns
    -------
    Result
        ``result["K_in"]`` is a `Quantity`; ``result.stage_model`` what dynamics needs.

    Raises
    ------
    InputError
        If anything cannot be used or built.
    """
    study = read_study(design, changes, **tables)
    store = open_cache(cache)
    return _of_stage(study, store, progress) if study.design.is_stage else _of_part(study, store, progress)


def _of_part(study: Study, store: Cache, progress: Progress) -> Result[Validation]:
    from flexdesign.report.validation import table_1, validation_report

    found = validation.validate(study, store, progress)
    quantities = {q.key: q for q in [*(c.fem for c in found.comparisons), *found.further]}
    return Result(
        found,
        validation_report.document(found, progress),
        table_1.brief(found),
        partial(validation_report.result, found),
        partial(_files, found, []),
        quantities | {short: quantities[key] for short, key in SHORT.items() if key in quantities},
        partial(_rows, found),
        validation_report.closing(found),
        is_table_first=True,
    )


def _of_stage(study: Study, store: Cache, progress: Progress) -> Result[StageValidation]:
    from flexdesign.report.validation import stage_report

    found = validate_stage.validate_stage(study, store, progress)
    return Result(
        found,
        stage_report.document(found, progress),
        stage_report.brief_table_1(found),
        partial(stage_report.result, found),
        partial(_files, found, found.further),
        {q.key: q for q in [*(c.fem for c in found.comparisons), *found.further]},
        partial(_rows, found),
    )


def _rows(found: Validation | StageValidation) -> list[dict[str, Any]]:
    """Return Table 1 in numbers: FEM, its error estimate and every model, SI."""
    return [
        {
            "quantity": c.fem.key,
            "boundary": c.fem.boundary,
            "unit": c.fem.si,
            "FEM": c.fem.value,
            "error": c.fem.half_width,
        }
        | {model: quantity.value for model, quantity in c.analytic.items()}
        for c in found.comparisons
    ]


def _files(found: Validation | StageValidation, further: Sequence[Any], folder: Path) -> dict[str, str | bytes]:
    """Return the stage model, and FEM's quantities as a static table, which `compare` and `diagnose` take."""
    quantities = [*(comparison.fem for comparison in found.comparisons), *further]
    model = {"stage_model.toml": to_toml(found.stage_model, folder)} if found.stage_model else {}
    return {**model, "fem.csv": to_csv(quantities, found.study.design)}
