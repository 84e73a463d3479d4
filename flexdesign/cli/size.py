"""``flexdesign size``: dimensions of amplifiers and guides from target values of a stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexdesign.cli.shared import DESIGN, AsJson, CacheFolder, app, progress, report_folder, show

if TYPE_CHECKING:
    from flexdesign.analytic.dimension_synthesis import Sizing
    from flexdesign.core.model import Quantity
    from flexdesign.report.document import Document, Table
    from flexdesign.workflows.stage_sizing import StageSizing

HELP = """Find the dimensions of amplifiers and guides from target values of a stage.

TARGETS is a file with stiffness, input stiffness, amplification or gain of the axes X/Y and Z and the coupling of a
motion along X, or the bare name of one in studies/. The formulas of Lin et al. (2019) are solved for hinges, arms,
input rods and the chains that guide the table; width, hinge thickness and rod thickness are given. A file that names a
stage and its free dimensions may have targets for formulas and for finite elements: least squares on the formulas and
the compliance model, corrected by a few FEM solutions of the whole stage.

**Examples**

    flexdesign size lin2019_targets

    flexdesign size lin2019_targets --set targets.xy.amplification=6.08 --out reports/longer_chains

    flexdesign size lin2019_targets --set choices.hinge_thickness="0.4 mm" --json

    flexdesign size lin2019_stage_targets --out reports/lin2019_stage_targets

**Keys of --set:** `targets.*` (amplification or gain: the given one replaces the other), `topology.*` (number of
amplifiers and guide hinges), `choices.*`, `material`, `rounded`. With `rounded` the targets are rounded printed values,
and ± is the largest change of a dimension within half a unit of their last digits. For a whole stage:
`targets.formulas.*`, `targets.arms.*`, `targets.elements.*`, `start.*`, `free`, `prior`, `iterations`, `mesh.*`.

**Output:** dimensions.toml, report.html, report.md and result.json, in --out; without --out no files.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=DESIGN)
def size(
    targets: Annotated[str, typer.Argument(help="Targets: a path, or a bare name.")],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change one value, e.g. targets.xy.amplification=6."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the dimensions [default: none].", show_default=False)
    ] = None,
    as_json: AsJson = False,
    cache: CacheFolder = None,
) -> None:
    """Size a stage, and write its dimensions."""
    from flexdesign.analytic import dimension_synthesis
    from flexdesign.api.result import Result
    from flexdesign.core.result_cache import open_cache
    from flexdesign.report.sweeps import stage_sizing_report
    from flexdesign.workflows import stage_sizing, stage_targets

    found: Sizing | StageSizing
    if stage_targets.is_stage_targets(targets):
        with progress() as say:
            found = stage_sizing.size(targets, overrides or [], open_cache(cache), say)
        document, table = stage_sizing_report.document(found), stage_sizing_report.targets(found)
    else:
        found = dimension_synthesis.size(targets, overrides or [])
        document, table = _document(found), _dimensions(found)
    answer = Result(found, document, table, found.result, lambda _: {"dimensions.toml": found.to_toml()})
    written = list[Path]()
    if out:
        written = report_folder(out, out.name, "size", [dimension_synthesis.find(targets)], overrides or []).write(
            answer
        )
    show(answer, written, as_json)


def _document(found: Sizing) -> Document:
    from flexdesign.report.document import Document, Section, Table

    given = Table(["target or choice", "value", "source"], found.given)
    returned = Table(
        ["", "of", "target", "returned", "equation"],
        [
            [asked.name, asked.boundary, asked.formatted(), back.formatted(), _place(back)]
            for asked, back in found.recomputed_targets()
        ],
    )
    builds = Table(
        ["X/Y", "amplifiers M_b", "amplifiers K_b", "guide hinges K_r", "stiffness"],
        [
            [name, str(t.moving_amplifiers), str(t.bending_amplifiers), str(t.guide_hinges), stiffness.formatted()]
            for name, t, stiffness in found.topologies()
        ],
    )
    sections = [
        Section("Dimensions", [], [_dimensions(found)]),
        Section("What the formulas return for them", [_circular()], [returned]),
        Section("The same elements in other topologies", [], [builds]),
        Section("What was given", [], [given]),
    ]
    return Document(found.title, _summary(found), sections)


def _circular() -> str:
    return (
        "The formulas return the targets with these dimensions by construction: that is circular, and says only that "
        "the equations were solved."
    )


def _summary(found: Sizing) -> list[str]:
    """Return the summary: the dimensions, and contradictions between the targets; every value is of this run."""
    text = [f"The dimensions are reconstructed: they follow from the targets, and are one realisation. {_circular()}"]
    x, _ = found.found.axes_under_load()
    if x.load:
        text.append(
            f"K_in and lambda of X/Y hold for an output that pushes against {x.load / 1e3:.4g} N/mm. With its output "
            f"free the amplifier has K_in = {x.bridge.input_stiffness() / 1e6:.4g} N/um and "
            f"lambda = {x.bridge.amplification():.4g}."
        )
    text.append(
        f"Eq. (30) makes the gain of X/Y, k_in / (4 lambda k), {x.gain:.4g}, while lambda is {x.amplification:.4g}. If "
        f"the gain were the amplification, L_1 and L_2 would be {x.gain / x.amplification:.3g} times as long."
    )
    own = found.found.targets.topology_xy
    if not own.consistent:
        (_, _, counted), (_, _, whole), *_ = found.topologies()  # the targets' own, and with all of them bending
        text.append(
            f"In X/Y the targets count the mass of {own.moving_amplifiers} amplifiers and the stiffness of "
            f"{own.bending_amplifiers}. If all that move bend, too, the same elements make {whole.formatted()}, "
            f"{whole.value / counted.value:.2g} times {counted.formatted()}."
        )
    return text


def _dimensions(found: Sizing) -> Table:
    from flexdesign.report.document import Table

    rounded = found.quantities[0].half_width is not None
    rows = []
    for quantity in found.quantities:
        sigma = quantity.half_width or 0.0
        half = [replace(quantity, value=sigma, half_width=None).formatted(2)] if rounded else []
        rows.append(
            [quantity.name, quantity.boundary, replace(quantity, half_width=None).formatted(), *half, _place(quantity)]
        )
    caption = "± by rounding: half a unit of every target's last digit, all of them together, at worst"
    heads = ["", "of", "value", *(["± by rounding"] if rounded else []), "from"]
    return Table(heads, rows, caption if rounded else "")


def _place(quantity: Quantity) -> str:
    """Return the source of a quantity without the name of the paper, which is in the title of the report."""
    from flexdesign.analytic.prb import SOURCE

    return quantity.source.removeprefix(f"{SOURCE}, ")
