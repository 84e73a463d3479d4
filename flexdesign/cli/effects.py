"""``flexdesign effects``: the catalogue of effects, or one of them in full."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexdesign.cli.shared import CATALOGUES, AsJson, StageOverrides, app, print_json, progress

if TYPE_CHECKING:
    from flexdesign.diagnosis.experiment_design.effect_strength import Signature

HELP = """Show the catalogue of effects, or one effect with the picture of its signature.

NAME is an effect of the catalogue, of an installed package, or the path of a file with an EFFECT. Without a name, all
effects are listed with their place and the experiment that reveals them.

**Examples**

    flexdesign effects

    flexdesign effects creep

    flexdesign effects my_effect.py --model my_stage.toml --axis y

    flexdesign effects my_static_effect.py --model my_design.toml

**Result:** the physics; every parameter with unit, null, start and plausible range; the experiment that reveals the
effect, confounded effects, the remedy; and the response in the experiments of `flexdesign plan`, simulated with and
without the effect, at a strength that changes the reading by 1 % of the stroke.

Static effects, which act on a part at rest, are shown on a design: the change of its stiffnesses and its amplification,
at the start value of a fit; `--model` names another design.

**Output:** report.html, report.md, result.json, stage_model.toml (the stage with the effect) and the figures, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""
#: The designs on which static effects are shown, those of whole stages on the second.
DESIGN, WHOLE = "bridge_amplifier", "lin2019_xyz_stage"
#: The stage on which effects are shown, its damping as its step response rings: critically damped, as the paper's own
#: poles have it, no resonance would show anything; and its sensor without steps, in which small effects would drown.
STAGE = "lin2019_stage"
SHOWN = ("axis.{axis}.damping_ratio=0.0242", 'axis.{axis}.sensor.resolution="0 um"')
RINGS = ", its damping ratio 0.0242 as its printed gains call for, its sensor without steps"


@app.command(help=HELP, rich_help_panel=CATALOGUES)
def effects(
    name: Annotated[str | None, typer.Argument(help="Effect: a name, or the path of a file.")] = None,
    model: Annotated[
        str, typer.Option(help="Stage model, or design for a static effect, on which the effect is shown.")
    ] = STAGE,
    axis: Annotated[str | None, typer.Option(help="Axis [default: the first].", show_default=False)] = None,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/effects/NAME].", show_default=False)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the catalogue, or write the page of one effect."""
    from flexdesign.effects import statics
    from flexdesign.report import render, terminal
    from flexdesign.report.catalogue import effect_pages
    from flexdesign.report.document import Document

    if name is None:
        if as_json:
            print_json(effect_pages.catalogue_result())
            return
        terminal.brief(Document("Effects", []), effect_pages.catalogue(), [])
        return
    if _is_static(name, model):
        shown_on = WHOLE if name in statics.OF_STAGES else DESIGN
        _static(name, shown_on if model == STAGE else model, overrides or [], out, as_json)
        return
    with progress() as say:
        effect = effect_pages.find(name)
        folder = out or Path("reports") / "effects" / effect.name
        render.prepare(folder)
        signature: Signature | None = None
        on: dict[str, str] = {}
        if effect.acts_in_time:
            say(f"{effect.name}: simulating with and without it")
            signature, on = _signature(name, model, axis, overrides or [])
        document = effect_pages.document(name, signature, on)
        result = effect_pages.result(name, signature) | {"made_by": {**on, **effect_pages.provenance()}}
        others = {"stage_model.toml": effect_pages.model_file(signature)} if signature else {}
        written = render.write(folder, document, result, others)
    if as_json:
        print_json(result)
        return
    brief = Document(effect.name, [effect.physics, *effect_pages.advice(effect)])
    terminal.brief(brief, effect_pages.brief(effect), [path for path in written if path.suffix != ".svg"])


def _is_static(name: str, model: str) -> bool:
    """Tell whether an effect is shown on a part at rest: static, or of both kinds if MODEL is a design."""
    from flexdesign import effects as in_time
    from flexdesign.api import static_tables
    from flexdesign.effects import statics

    if not name.endswith(".py"):
        return name in statics.names() and (name not in in_time.names() or static_tables.is_design(model))
    try:
        effect = in_time.find(name)
    except ValueError:  # said where it is looked up
        return False
    return effect.acts_at_rest and (not effect.acts_in_time or static_tables.is_design(model))


def _static(name: str, design: str, overrides: list[str], out: Path | None, as_json: bool) -> None:
    """Write the page of a static effect, which acts on a part at rest."""
    from flexdesign.design import design as designs
    from flexdesign.report import render, terminal
    from flexdesign.report.catalogue import effect_pages, static_effect_pages
    from flexdesign.report.document import Document

    with progress():
        effect = effect_pages.find_static(name)
        read = designs.read(designs.find(design), overrides)
        folder = out or Path("reports") / "effects" / effect.name
        render.prepare(folder)
        document, result = static_effect_pages.document(name, read), static_effect_pages.result(name, read)
        written = render.write(folder, document, result, {})
    if as_json:
        print_json(result)
        return
    brief = Document(effect.name, [effect.physics, *effect_pages.advice(effect)])
    terminal.brief(brief, document.sections[0].tables[0], [path for path in written if path.suffix != ".svg"])


def _signature(name: str, model: str, axis: str | None, overrides: list[str]) -> tuple[Signature, dict[str, str]]:
    """Return the signature of an effect on an axis of a stage model, and the title of the stage."""
    from flexdesign.diagnosis.experiment_design.effect_strength import on, signature_of
    from flexdesign.diagnosis.experiment_design.experiments import suite_of
    from flexdesign.diagnosis.experiment_design.limits import of_axis
    from flexdesign.dynamics import stage_model
    from flexdesign.dynamics.axis.axis_choice import choose_axis

    stage = stage_model.read(model, overrides)
    chosen = choose_axis(stage, [], axis or next(iter(stage.axes)))
    about = {"title": stage.title or stage.name, "changes": ""}
    if model == STAGE and not overrides:
        stage, about["changes"] = stage_model.read(model, [each.format(axis=chosen) for each in SHOWN]), RINGS
    limits = of_axis(stage, chosen)
    dynamics = limits.dynamics(stage, chosen)
    return signature_of(on(dynamics, name), suite_of(dynamics, limits)), about
