"""``flexdesign validate``: a design by FEM, compared with the analytic models."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import DESIGN, AsJson, CacheFolder, app, progress, report_folder, show

HELP = """Solve a design with FEM and compare the analytic models with the solution.

STUDY is a study or design file, or the bare name of one in studies/ or geometry/. Its part is built, meshed, checked
(thickness of every hinge on the mesh), solved on several meshes and extrapolated. The report shows stiffness,
amplification, stroke, the six motions of table and sensor, modes and stress, each with its boundary condition and the
values of the formulas. For a whole stage, every part is condensed to its ports and the stage is assembled from them;
the report has stiffness, amplification and coupling of each axis, with formulas and published values.

**Examples**

    flexdesign validate bridge_amplifier

    flexdesign validate bridge_amplifier --set dimensions.hinge_thickness="0.4 mm"

    flexdesign validate my_design.toml --set mesh.levels=2 --json > result.json

    flexdesign validate my_design.toml --set mesh.cross_check=true

    flexdesign validate my_design.toml --set output.sensor='["0 mm", "40 mm", "0 mm"]'

    flexdesign validate studies/table1.toml --export stage.step

**Keys of --set:** those of the design (`dimensions.*`, `material`, `actuator.*`, `part`) and of the study
(`mesh.method`, `mesh.levels`, `mesh.accuracy`, `mesh.at_root`, `mesh.growth`, `mesh.largest`, `mesh.refinement`,
`mesh.envelope`, `mesh.cross_check`, `mesh.independent`, `modes.count`, `output.load`, `output.stroke`,
`output.actuator_offset`, `output.sensor`, `output.large_steps`, and for a stage `stage.inputs.AXIS`). A part extruded
from a section is also solved on one mesh by pytetwild, as an independent check; `mesh.independent=false` omits it. With
`mesh.cross_check` the part is solved on every kind of mesh, as a symmetric piece and whole, and the report states
whether the results agree within their estimates; this takes minutes.

**Output:** report.html, report.md, result.json, fem.csv, stage_model.toml and the pictures, in --out. A design changed
with --set has its own folder and title; its fem.csv states the changes for `compare`.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.

Meshes and solutions are cached by content: a second run takes seconds, most of them for drawing, and an interrupted run
resumes.
"""

#: The files that the terminal names.
NAMED = ("report.html", "report.md", "result.json", "fem.csv", "stage_model.toml")


@app.command(help=HELP, rich_help_panel=DESIGN)
def validate(
    study_name: Annotated[
        str, typer.Argument(metavar="STUDY", help="Study or design: a path, or a bare name.")
    ] = "bridge_amplifier",
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help='Change one value, e.g. dimensions.width="15 mm"; may be repeated.'
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/STUDY_CHANGES].", show_default=False)
    ] = None,
    as_json: AsJson = False,
    cache: CacheFolder = None,
    export: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            help="Also write the solid (.step), or the finest mesh with displacements and stress (.vtu, .msh, .inp "
            "...); a bare name goes into the report's folder; may be repeated.",
        ),
    ] = None,
) -> None:
    """Run a validation and write its report."""
    from flexdesign.api import designs
    from flexdesign.design import part
    from flexdesign.report import origin
    from flexdesign.report.validation import export as exporting

    with progress() as say:
        study = designs.read_study(study_name, overrides or [])
        files = dict.fromkeys([study.file, study.design.file, part.file_of(study.design.part_class)])
        where = report_folder(out, origin.name_of(study.file), "validate", list(files), overrides or [])
        exports = exporting.writers(export or [], where.folder, stage=study.design.is_stage)
        found = designs.validate(study, cache=cache, progress=say)
        written = where.write(found, [os.path.relpath(path, where.folder) for path, _ in exports])
        for path, write in exports:
            write(found.found, path)
    named = [path for path in written if path.name in NAMED]
    show(found, [*named, *(path for path, _ in exports)], as_json)
