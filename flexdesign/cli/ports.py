"""``flexdesign ports``: the faces of a STEP file, and a design to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import DESIGN, AsJson, app, progress, report_folder, show, write_file

HELP = """List the faces of a STEP file, and write a design that uses some of them as ports.

STEP is the file of a solid. Where it holds several that touch, as an assembly does, they are bonded; --solid takes some
of them, by name or number. Its plane and cylindrical faces are listed with area, normal, centre and name, and drawn
with their numbers; thin regions of the solid are listed, too. A port is one plane face or several in one plane.

**Examples**

    flexdesign ports bracket.step

    flexdesign ports bracket.step -o bracket.toml

    flexdesign ports assembly.step --solid "Leaf spring" -o leaf.toml

    flexdesign validate bracket.toml

**In a design:** part = "bracket.step", with solids = ["Leaf spring"] where some of several are meant, and a table for
each port: [ports.ground], [ports.input_left], [ports.input_right], [ports.output]. Each names its faces by face =
"name", colour = "#rrggbb", plane = "z = max", or point and normal, which find the nearest face with that normal.
interface = "rigid" lets the faces move as one body; about = ["0 mm", "0 mm", "0 mm"] is the point that motions and
moments are taken about. A design without inputs is a joint: its report has the stiffness of the output in six
directions.

**Output:** report.html, report.md, result.json and the picture, in --out; with -o a new file: the design to start from.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=DESIGN)
def ports(
    step: Annotated[Path, typer.Argument(metavar="STEP", help="The STEP file.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/NAME_ports].", show_default=False)
    ] = None,
    solid: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Take this solid of several, by name or number; may be repeated."),
    ] = None,
    design: Annotated[
        Path | None, typer.Option("-o", "--design", help="Also write the design to start from.", show_default=False)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List faces, and write a design to start from."""
    from flexdesign.api import step_files
    from flexdesign.core.errors import InputError

    write_file(design)
    if design is not None and design.exists():
        raise InputError("command line", "-o", str(design), "exists; choose another file")
    with progress() as say:
        found = step_files.read_ports(step, solids=solid or (), progress=say)
        where = report_folder(out, f"{step.stem}_ports", "ports", [step])
        written = where.write(found)
        if design is not None:
            write_file(design, found.found.design_for(design.parent))
            written.append(design)
    show(found, [path for path in written if path.name in ("report.html", "report.md") or path == design], as_json)
