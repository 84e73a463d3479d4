"""The report of a reproduction: every printed number and ours, with its verdict, and the figures as simulated."""

from __future__ import annotations

from typing import Any

from flexdesign.core import units
from flexdesign.core.serialise import header
from flexdesign.dynamics.stage_model import ResponseUnits
from flexdesign.report import charts
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.simulation import simulation_figures
from flexdesign.workflows.reproduction import VERDICTS, Item, Reproduction

#: Sections by the paper's systems.
SECTIONS = (
    ("Statics and kinematics, eqs (1) to (22)", ("P1", "P2", "P3", "P4", "P5")),
    ("Coupling, eqs (23) to (25), and Table 1", ("P6", "P7")),
    ("Hysteresis, eqs (26) to (29), Figs 7 and 8", ("P8", "P9", "P10")),
    ("Decoupling, Figs 9 to 11", ("P11",)),
    ("Plant and controller, eqs (30) to (34)", ("P12", "P13", "P14", "P15")),
    ("Step response, Fig 13", ("P16",)),
    ("Tracking of one axis, Figs 14 to 17", ("P17", "P18")),
    ("Tracking of lines, Figs 18 and 19", ("P19", "P20")),
)
#: Verdicts behind their counts.
COUNTED = {
    "agrees": "agree",
    "by construction": "agree by construction",
    "contradictory": "are contradictory",
    "not printed": "have no printed number",
    "differs": "differ",
}
#: The unit of the paper's figures.
RESPONSE = ResponseUnits("m", "um")


def document(reproduction: Reproduction) -> Document:
    """Return the report."""
    sections = [Section("The verdicts", [], [verdicts(reproduction)], [_picture(reproduction)])]
    sections += [_section(reproduction, title, systems) for title, systems in SECTIONS]
    sections.append(_how(reproduction))
    return Document(reproduction.paper.title, _summary(reproduction), sections)


def verdicts(reproduction: Reproduction) -> Table:
    """Return how many rows have each verdict, and what it means."""
    rows = [[verdict, str(count), VERDICTS[verdict]] for verdict, count in reproduction.counted().items()]  # type: ignore[index]
    return Table(["verdict", "rows", "meaning"], rows)


def _picture(reproduction: Reproduction) -> Figure:
    """Draw how many rows of each system have each verdict."""
    split = {
        title.partition(",")[0]: {
            verdict: sum(item.verdict == verdict for item in reproduction.items if item.system in systems)
            for verdict in reproduction.counted()
        }
        for title, systems in SECTIONS
    }
    drawn = charts.shares(split, "rows", charts.NARROW)
    return Figure("verdicts.svg", drawn, "Rows of each verdict, by system", alt=charts.spoken(split))


def _summary(reproduction: Reproduction) -> list[str]:
    counts = ", ".join(f"{count} {COUNTED[verdict]}" for verdict, count in reproduction.counted().items() if count)
    design = reproduction.stage.study.design
    return [
        f"{len(reproduction.paper.printed)} printed numbers and the paper's statements in words make "
        f"{len(reproduction.items)} rows: {counts}.",
        f"The paper prints no dimensions. The stage is {design.provenance}.",
        _row_count(reproduction, "contradictory"),
        _row_count(reproduction, "differs"),
    ]


def _row_count(reproduction: Reproduction, verdict: str) -> str:
    named = [f"{item.system} {item.what}" for item in reproduction.items if item.verdict == verdict]
    head = {
        "contradictory": "Printed numbers that contradict each other or mechanics",
        "differs": "Differences without an explanation",
    }
    return f"{head[verdict]}: {'; '.join(named) or 'none'}."


def _section(reproduction: Reproduction, title: str, systems: tuple[str, ...]) -> Section:
    rows = [_row(item) for item in reproduction.items if item.system in systems]
    table = Table(["item", "what", "place", "paper", "ours", "verdict", "why"], rows)
    plan = reproduction.experiments.plan
    experiments = [e for e in plan.experiments if e.name.partition(" ")[0] in systems]
    figures = [f for e in experiments for f in simulation_figures.draw(e, reproduction.experiments.of(e), RESPONSE)]
    return Section(title, [], [table], figures, gallery=True)


def _row(item: Item) -> list[str]:
    return [item.system, item.what, item.place, item.theirs, item.ours, item.verdict, item.why or "–"]


def _how(reproduction: Reproduction) -> Section:
    stage, plan = reproduction.stage, reproduction.experiments.plan
    text = [
        f"The stage: {stage.study.design.title}, by finite elements on {len(stage.levels)} meshes of up to "
        f"{stage.finest.unknowns / 1e6:.2g} million unknowns; flexdesign validate {reproduction.paper.stage} has its "
        f"report. The experiments: {len(plan.experiments)}, in {len(reproduction.experiments.cases)} runs; flexdesign "
        f"simulate {reproduction.paper.model} {reproduction.paper.experiments} has theirs. All of it took "
        f"{units.to_text(reproduction.seconds, 's', 3)}.",
        "A printed number is known to half a unit of its last digit; a measured motion also to the sensor's resolution "
        "and the slope of its nonlinearity; a result of finite elements to its estimated error. “Agrees” means within "
        "the sum of these.",
    ]
    return Section("How", text)


def result(reproduction: Reproduction) -> dict[str, Any]:
    """Return result.json's content."""
    return {
        **header("reproduction"),
        "title": reproduction.paper.title,
        "verdicts": dict(reproduction.counted()),
        "rows": [
            {**{key: getattr(item, key) for key in ("system", "what", "place", "theirs", "ours", "verdict", "why")},
             "uses": [list(key) for key in item.uses]}
            for item in reproduction.items
        ],
        "seconds": reproduction.seconds,
    }  # fmt: skip
