"""``flexdesign materials``: the material library, or one material in full."""

from __future__ import annotations

from typing import Annotated

import typer

from flexdesign.cli.shared import CATALOGUES, AsJson, app, print_json

HELP = """Show the material library, or one material with the source of every value.

NAME is a material of the library or the path of a file with one (.toml). Without a name, all materials are listed.

**Examples**

    flexdesign materials

    flexdesign materials "Al 7075-T6"

    flexdesign materials my_alloy.toml --json

**In a design:** material = "Al 7075-T6", a file, or a table: [material] with name, youngs_modulus, poissons_ratio,
density, yield_strength and, if known, ultimate_strength, [material.fatigue] and [material.sources]. A table with like =
"Si" takes all other values from the library, for example with orientation = "<100>" alone.

**Output:** no files.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=CATALOGUES)
def materials(
    name: Annotated[str | None, typer.Argument(help="Material: a name, or the path of a file.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the library, or show one material."""
    from flexdesign.report import terminal
    from flexdesign.report.catalogue import material_pages
    from flexdesign.report.document import Document

    if as_json:
        print_json(material_pages.result(name))
    elif name is None:
        terminal.brief(Document("Materials", []), material_pages.catalogue(), [])
    else:
        material = material_pages.find(name)
        terminal.brief(Document(material.name, material_pages.validity(material)), material_pages.numbers(material), [])
