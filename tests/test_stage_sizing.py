"""Sizing a stage by formulas and finite elements at once, with a stand-in for the latter."""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from flexdesign import cli
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.design import design as designs
from flexdesign.design.design import Design
from flexdesign.report.render import to_markdown
from flexdesign.report.sweeps import stage_sizing_report
from flexdesign.workflows import stage_sizing
from flexdesign.workflows.stage_sizing import StageSizing
from flexdesign.workflows.sweeps.evaluators import by_formulas

ROOT = Path(__file__).resolve().parent.parent
TARGETS = ROOT / "studies" / "lin2019_stage_targets.toml"
STAGE = ROOT / "geometry" / "lin2019_xyz_stage.toml"
#: By how much the stand-in differs from the compliance model, about as finite elements do.
OFF = {
    "K_out_x_inputs_free": 1.02,
    "K_out_z_inputs_free": 0.98,
    "stroke_x_table_free": 0.99,
    "stroke_z_table_free": 1.01,
}


def stand_in(design: Design) -> Mapping[str, Quantity]:
    """Return the compliance model's quantities times factors that change with the dimensions."""
    drift = (design.dimensions["arm_span"] / 30e-3) ** 0.1
    found = by_key(by_formulas(design, "compliance"))
    return {key: replace(q, value=q.value * OFF.get(key, 1.0) * drift, half_width=0.0) for key, q in found.items()}


@pytest.fixture(scope="module")
def found() -> StageSizing:
    return stage_sizing.size(TARGETS, solver=stand_in)


def test_all_targets_are_met_at_once(found: StageSizing) -> None:
    """By the stand-in as it is, not by the model that is corrected to it."""
    assert [row.target.kind for row in found.rows] == ["formulas"] * 5 + ["arms"] * 2 + ["elements"] * 4
    for row in found.rows:
        assert abs(row.off) <= row.target.tolerance, row
    solved = stand_in(found.design)
    for row in found.rows[7:]:
        assert row.found.value == solved[row.target.quantity.key].value
    assert len(found.ratios) >= 2  # the first ratio is of no solution, and only a second can confirm it


def test_only_free_dimensions_move_and_they_are_whole_micrometres(found: StageSizing) -> None:
    for name, value in found.design.dimensions.items():
        if name in found.free:
            assert value * 1e6 == pytest.approx(round(value * 1e6), abs=1e-6)
        else:
            assert value == found.started.dimensions[name]


def test_the_dimensions_it_writes_are_read_as_a_design(found: StageSizing, tmp_path: Path) -> None:
    content = tomllib.loads(found.to_toml())["dimensions"]
    changes = [f"dimensions.{key}={json.dumps(value)}" for key, value in content.items()]
    again = designs.read(STAGE, changes)
    assert again.dimensions == pytest.approx(found.design.dimensions)


def test_the_report_says_what_the_numbers_prove(found: StageSizing) -> None:
    text = to_markdown(stage_sizing_report.document(found))
    for words in ("eight unknowns", "one realisation", "2000 N/mm", "no stage of this kind has it"):
        assert words in text
    assert text.count("| met |") == 11


@pytest.mark.slow
def test_a_contradiction_is_missed_and_said() -> None:
    """K_in of (17) and K_in by elements cannot both be 2000 and 1800 N/mm: elasticity only softens."""
    override = ['targets.elements.K_in_x_table_free="2.0 N/um"', "iterations=1"]
    found = stage_sizing.size(TARGETS, override, solver=stand_in)
    (row,) = (r for r in found.rows if r.target.kind == "elements" and r.target.quantity.name == "K_in")
    assert not row.met and row.off < -0.05 and not found.met
    assert "missed" in to_markdown(stage_sizing_report.document(found))


def test_the_shipped_stage_has_the_formulas_and_arms_that_are_asked_for() -> None:
    """Finite elements are asked in test_stage_validation; these are exact."""
    shipped = designs.read(STAGE)
    rows = stage_sizing.rows_of(TARGETS, shipped, stand_in(shipped))
    assert [row.target.kind for row in rows[:7]] == ["formulas"] * 5 + ["arms"] * 2
    assert all(row.met for row in rows[:7])


@pytest.mark.parametrize(
    ("override", "place"),
    [
        ('targets.formulas.K_out_q="1 N/mm"', "K_out_q"),
        ('free=["arm_spam"]', "arm_span"),
        ('targets.model="paper"', "paper (21)"),
        ('targets.arms.y_from_x="0 %"', "positive"),
        ('design="bridge_amplifier"', "stage"),
    ],
)
def test_refusals_name_the_place(override: str, place: str) -> None:
    with pytest.raises(InputError, match=place.replace("(", r"\(").replace(")", r"\)")):
        stage_sizing.size(TARGETS, [override], solver=stand_in)


def test_command_tells_stage_targets_from_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], found: StageSizing
) -> None:
    monkeypatch.setattr(stage_sizing, "size", lambda *_: found)
    arguments = ["size", "lin2019_stage_targets", "--out", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]
    monkeypatch.setattr(sys, "argv", ["flexdesign", *arguments])
    monkeypatch.chdir(ROOT)
    try:
        cli.main()
    except SystemExit as stop:
        assert not stop.code
    assert {"dimensions.toml", "report.html", "result.json"} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert "targets" in capsys.readouterr().out
