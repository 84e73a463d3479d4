"""The reference of the files that users write, made from the tables that read them."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from flexdesign.analytic import dimension_synthesis
from flexdesign.core import printed_numbers
from flexdesign.core.toml_files import Bounds
from flexdesign.design import design, step_part, study
from flexdesign.design.materials.library import _CrystalTable, _MetalTable
from flexdesign.design.sketch import tables as sketch
from flexdesign.dynamics.experiments import plan, reading
from flexdesign.dynamics.stage_model import fields
from flexdesign.dynamics.stage_model import reading as stage_model
from flexdesign.measurements.recordings import description
from flexdesign.workflows.sweeps import reading as sweeps

#: Each kind of file: its title, its text, and its tables by the name they have in the file.
FILES: tuple[tuple[str, str, dict[str, type[BaseModel]]], ...] = (
    (
        "Design",
        "Dimensions, material and actuator of a part or a stage. Read by `validate`, `size`, `sweep`, `diagnose`.",
        {
            "": design._DesignFile,
            "[actuator]": design.Actuator,
            "[actuator.hysteresis]": design.Hysteresis,
            "[tolerances]": design.Tolerances,
        },
    ),
    (
        "Sketch",
        'The design of a planar mechanism, with `part = "sketch"`.',
        {"": sketch.SketchTables, "[plate]": sketch.PlateTable, "[[repeat]]": sketch.Repeated},
    ),
    ("Ports of a STEP file", 'In a design with `part = "bracket.step"`.', {"[ports.NAME]": step_part.PortTable}),
    (
        "Study",
        "A design, and how closely to look at it. Read by `validate`.",
        {
            "": study._StudyFile,
            "[mesh]": study.MeshSettings,
            "[modes]": study.ModeSettings,
            "[output]": study.OutputSettings,
            "[stage]": study.StageSettings,
        },
    ),
    (
        "Study of experiments",
        "What a stage is asked to follow. Read by `simulate` and `sweep`.",
        {
            "": reading._File,
            "[[experiment]]": plan.Experiment,
            "[controllers.NAME]": plan.ControllerTable,
            "[variants.NAME]": plan.Variant,
        },
    ),
    (
        "Sweep",
        "Many designs or stages. Read by `sweep` and `optimize`.",
        {"": sweeps._File, "[vary] KEY = {…}": sweeps._Range, "[sample]": sweeps._Sample, "[aim]": sweeps._Wanted},
    ),
    (
        "Recordings: measurements.toml",
        "What is known of the recordings in the same folder. Read by `compare`, `identify`, `diagnose`, `add`.",
        {
            "": description.Setup,
            "[[run]]": description.RunTable,
            "[sensors.x]": description.SensorTable,
            "conditions = {…}": description.Conditions,
        },
    ),
    ("Material", "A metal or a crystal of one's own.", {"metal": _MetalTable, "crystal": _CrystalTable}),
    ("Targets of size", "Wanted stiffnesses and amplifications. Read by `size`.", {"": dimension_synthesis._File}),
    ("Printed numbers", "The numbers of a publication. Read by `reproduce`.", {"": printed_numbers._File}),
)
#: Files in CSV.
TABLES = """## Recordings in CSV

One file for each run. The first line names the columns, each with its unit in brackets: `t [s], u [V], x [um]`.

| column | content |
|---|---|
| `t` | time; evenly spaced to a hundredth of a sample |
| `u` | the command; `u_x`, `u_y`, `u_z` if several axes are driven |
| `v` | the voltage at the stack, if it was recorded |
| `x`, `y`, `z` | readings of position: lengths, angles or volts |
| `i`, `f`, `T` | current, force, temperature |
| `f [Hz]`, first | a frequency response: with `magnitude` and `phase`, or `re` and `im`; and `coherence` |

## Static tables in CSV

`quantity,value,unit,sigma,boundary`, one line for each measured stiffness or amplification, and a column for each
dimension that differs from the design, such as `hinge_thickness [mm]`; for a stage also `axis`. `validate` writes such
a table, `fem.csv`.
"""


def pages() -> Iterator[tuple[str, str]]:
    """Yield the page."""
    lines = ["# File formats", "", INTRODUCTION, ""]
    for title, text, tables in FILES:
        lines += [f"## {title}", "", text, ""]
        for name, table in tables.items():
            lines += [*_table(name, table), ""]
    lines += [*_stage_model(), "", TABLES]
    yield "formats.md", "\n".join(lines)


INTRODUCTION = """Files are TOML, their values have units (`"0.5 mm"`), and unknown keys are refused by name. The tables
of this page are made, at each build, from the classes that read the files. A key without a default is required."""


def _table(name: str, table: type[BaseModel]) -> list[str]:
    lines = [f"### `{name}`" if name else "### At the top", ""]
    first = (inspect.getdoc(table) or "").strip()
    if first and not table.__name__.startswith("_") and "BaseModel" not in first:
        lines += [first.replace("``", "`"), ""]
    rows = [
        f"| `{field.alias or key}` | {_kind(field)} | {_default(field)} |" for key, field in table.model_fields.items()
    ]
    return [*lines, "| key | value | default |", "|---|---|---|", *rows]


def _kind(field: FieldInfo) -> str:
    """Return in words what a value may be."""
    bounds = [each for each in field.metadata if isinstance(each, Bounds)]
    words = [str(each) for each in bounds] or list(dict.fromkeys(_words(field.annotation)))
    return " or ".join(word for word in words if word).replace("|", "\\|") or "see the text"


def _words(kind: Any) -> Iterator[str]:
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        bounds = [each for each in inner[1:] if isinstance(each, Bounds)]
        yield from (map(str, bounds) if bounds else _words(inner[0]))
    elif origin is typing.Literal:
        yield ", ".join(f'`"{each}"`' if isinstance(each, str) else f"`{each}`" for each in inner)
    elif origin is not None and str(origin) in ("typing.Union", "<class 'types.UnionType'>"):
        for each in inner:
            yield from _words(each)
    elif origin in (list, tuple) or (isinstance(origin, type) and issubclass(origin, (list, tuple))):
        of = list(dict.fromkeys(word for each in inner if each is not ... for word in _words(each)))
        yield f"list of {' or '.join(of)}"
    elif origin is dict:
        yield f"table of {' or '.join(_words(inner[1]))}"
    elif kind is type(None) or kind is Any:
        return
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        yield "table"
    else:
        names = {str: "text", float: "number", int: "whole number", bool: "`true` or `false`"}
        yield names.get(kind, getattr(kind, "__name__", str(kind)).lower())


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    given = field.default
    if given is None or given is PydanticUndefined or isinstance(given, (BaseModel, dict)) or given in ("", ()):
        return "–"
    bounds = [each for each in field.metadata if isinstance(each, Bounds)]
    if isinstance(given, bool):
        return f"`{str(given).lower()}`"
    if isinstance(given, float):
        return f"`{given:g}{f' {bounds[0].si}' if bounds and bounds[0].si != '1' else ''}`"
    return f"`{given}`" if not isinstance(given, tuple) else f"`{list(given)}`"


def _stage_model() -> Iterator[str]:
    """Yield the section on stage models, whose keys depend on the response of an axis."""
    yield "## Stage model"
    yield ""
    yield (
        "The signal chain of each axis. Written by `validate`, `identify`, `diagnose` and `add`; read by `simulate`, "
        "`compare`, `diagnose`, `plan`. Bounds are those of an axis that responds in a length."
    )
    yield ""
    yield from _table("", stage_model._StageFile)
    for name, table in (
        ("[axis.x]", fields.axis("m")),
        ("[[axis.x.modes]]", fields.MODE),
        ("[axis.x.driver]", fields.DRIVER),
        ("[axis.x.actuator]", fields.actuator()),
        ("[axis.x.sensor]", fields.sensor("m")),
        ("[controller]", fields.CONTROLLER),
    ):
        yield ""
        yield f"### `{name}`"
        yield ""
        yield "| key | value |"
        yield "|---|---|"
        for key, field in table.items():
            yield f"| `{key}` | {str(field) if isinstance(field, Bounds) else 'text'} |"
    yield ""
    yield "`[axis.x.effects.NAME]` holds the parameters of an effect; [effects](effects/index.md) lists them."
