"""The numbers in README and docs/ are those of the kept example reports."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.diagnosis import initialised_comparison
from flexdesign.dynamics import stage_model
from flexdesign.measurements import recordings
from flexdesign.report import comparison_text as words
from studies.benchmarks import least_squares

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def page(name: str) -> str:
    """Return a page of docs/."""
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def words_of(text: str) -> str:
    """Return a text without line breaks."""
    return " ".join(text.split())


EXAMPLES = ROOT / "reports" / "examples"
EXAMPLE = json.loads((EXAMPLES / "bridge_amplifier" / "result.json").read_text())
DIAGNOSIS = json.loads((EXAMPLES / "hidden_effect_demo" / "result.json").read_text())
DEMO = ROOT / "studies" / "hidden_effect_demo"


def test_table_is_the_example_report() -> None:
    rows = [
        line for line in page("validation").splitlines() if re.match(r"(K_in|K_out|λ) (input|output|actuator) ", line)
    ]
    compared = [q for q in EXAMPLE["quantities"] if q.get("analytic") and q["name"] in ("K_in", "K_out", "lambda")]
    assert len(rows) == len(compared) == 5
    for row, found in zip(rows, compared, strict=True):
        fem = Quantity(found["name"], found["value"], "1", "", half_width=found["half_width"]).formatted()
        assert fem in row
        assert found["boundary"] in row
        for analytic in (found["analytic"][model] for model in ("PRB", "compliance")):
            assert Quantity("", analytic["value"], "1", "").formatted() in row
            assert f"{100 * analytic['error']:+.1f}" in row


@pytest.mark.parametrize(("text", "count"), [(README, 6), (page("validation"), 8)], ids=["README", "validation"])
def test_card_is_the_example_report(text: str, count: int) -> None:
    report = (EXAMPLES / "bridge_amplifier" / "report.md").read_text(encoding="utf-8")
    card = re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", report.partition("## ")[0], re.M)
    rows = {name: f"{name} {value} {boundary}" for name, value, boundary in card}
    shown = [words_of(line) for line in text.splitlines()]
    found = {name: line for line in shown for name in rows if re.match(rf"{name} +-?\d", line)}
    assert len(found) == count
    assert found == {name: rows[name] for name in found}


def test_warnings_are_those_of_the_example_report() -> None:
    for warning in EXAMPLE["warnings"]:
        assert f"Warning: {warning}" in words_of(page("validation"))


def test_stiffening_over_the_stroke_is_that_of_the_example_report() -> None:
    (change,) = re.findall(r"change of the input stiffness (\d+)", " ".join(EXAMPLE["warnings"]))
    assert f"the input of the bridge amplifier gets {change} % stiffer" in words_of(page("validation"))


def test_ladder_is_the_example_diagnosis() -> None:
    text = page("diagnosis")
    floor = DIAGNOSIS["noise_floor"]
    for rung in DIAGNOSIS["ladder"]:
        label, error = rung["label"].replace("_", " "), rung["error"]
        row = next(line for line in text.splitlines() if line.startswith(f"{label} "))
        ratio = units.significant(error["value"] / floor["value"], 3)
        row = " ".join(row.split())
        assert row.startswith(f"{label} {words.error(error['unit'], error['value'])} ") and row.endswith(f" {ratio}")
    source = floor["source"].rpartition(" ")[0]
    assert f"noise floor: {source} {words.error(floor['unit'], floor['value'], 2)} " in words_of(text)


def test_named_effect_is_the_example_diagnosis() -> None:
    assert DIAGNOSIS["verdict"] == "effects-found"
    (effect,) = DIAGNOSIS["effects"]
    name = effect["name"].replace("_", " ")
    whole = words_of(page("diagnosis"))
    assert f"{name.capitalize()}: {effect['parameters'][0]['text']}. It explains" in whole
    assert f"explains {words.percent(effect['share'])} of what" in whole
    assert f"What to do about it: {effect['remedy']}." in whole
    error = DIAGNOSIS["validation_error"]
    floor = DIAGNOSIS["noise_floor"]["value"]
    for text in (whole, words_of(README)):
        assert f"Missing: {name}. With it" in text
        assert f"by {words.error(error['unit'], error['value'])} (" in text
        assert f"rms; the noise is {words.error(error['unit'], floor, 2)}." in text
    # What was hidden, from the file that the diagnosis never reads.
    low, high = effect["parameters"][0]["interval"]
    assert low < tomllib.loads((DEMO / "answer.toml").read_text())["effects"][effect["name"]]["cubic"] < high


def test_the_demo_misses_by_what_is_said() -> None:
    found = initialised_comparison.compare(
        stage_model.read(str(DEMO / "model.toml"), []), recordings.read_runs([DEMO / "runs"])
    )
    ratio = units.significant(found.rms / found.floor, 3)
    assert f"the model misses the recordings by {ratio} times the noise" in words_of(page("diagnosis"))


def test_explanations_are_of_the_example() -> None:
    found = {(q["name"], q["boundary"]): q for q in EXAMPLE["quantities"]}

    def pseudo_rigid(name: str, boundary: str) -> float:
        return float(found[name, boundary]["analytic"]["PRB"]["error"])

    text = words_of(page("explanation/what_formulas_leave_out"))
    assert f"its input stiffness is {100 * pseudo_rigid('K_in', 'output free'):.0f} % too high" in text
    assert f"is {1 + pseudo_rigid('K_out', 'input held'):.1f} times as high as that of finite elements" in text
    stiffer, larger = (found[f"{name}_change", "full drive, output free"]["value"] for name in ("K_in", "lambda"))
    assert f"the input gets {stiffer:.0f} % stiffer" in words_of(page("explanation/large_displacement"))
    both = f"gets {stiffer:.0f} % stiffer and its amplification {larger:.0f} % larger"
    assert both in words_of(page("validation"))


def test_distances_from_fem_are_those_of_the_example() -> None:
    designs = json.loads((EXAMPLES / "theory_against_fem" / "result.json").read_text())["designs"]
    assert len(designs) == 200
    text = words_of(page("evidence"))
    assert "Of two hundred amplifiers" in text
    with_all = "{} % in K_in, {} % in λ and {} % in K_out in the median, and {}, {} and {} % in the worst case"
    bare = "formulas deviate by {}, {} and {} % in the median, and by {}, {} and {} % in the worst case"
    for model, sentence in (("compliance", with_all), ("pseudo_rigid", bare)):
        errors = 100 * np.abs([list(design[model].values()) for design in designs])
        numbers = [*np.median(errors, axis=0), *errors.max(axis=0)]
        assert sentence.format(*(f"{n:.0f}" if n >= 10 else f"{n:.2g}" for n in numbers)) in text


def test_rates_are_those_of_the_kept_trial() -> None:
    result = json.loads((EXAMPLES / "hidden_effect_trial" / "result.json").read_text())
    rates = {rate["what"]: rate for rate in result["rates"]}
    text = page("evidence")
    assert f"is of {len(result['cases'])} recordings of seed {result['seed']}" in words_of(text)
    outside = next(what for what in rates if what.startswith("outside the catalogue: unknown"))
    rows = {
        "one effect | named": "one effect: right verdict",
        "two effects | both named": "two effects: right verdict",
        "nothing | an effect named (false alarm)": "nothing missing: an effect named",
        "an effect too faint to be seen | an effect named (false alarm)": "too faint to be seen: an effect named",
        "an effect outside the catalogue | `unknown`, or a right name with a remainder": outside,
        "| validation error within 1.15 of the noise floor": "error within 1.15 of the floor",
    }
    for words_there, what in rows.items():
        assert f"| {words_there} | {rates[what]['cases']} |" in text
    held = rates["95 % intervals that hold the truth"]
    assert f"95 % intervals that contain the truth: {held['rate']} | {held['cases']} |" in text
    one, two, none = (rates[rows[words_there]]["cases"] for words_there in list(rows)[:3])
    claim = f"named {one} single effects, both effects of {two} pairs, and an effect in {none} recordings"
    readme = words_of((ROOT / "README.md").read_text(encoding="utf-8"))
    assert claim in readme and f"Of {len(result['cases'])} recordings" in readme


def test_rates_of_imperfect_benches_are_those_of_the_kept_trial() -> None:
    result = json.loads((EXAMPLES / "imperfect_benches" / "result.json").read_text(encoding="utf-8"))
    text = page("evidence")
    assert f"{len(result['cases'])} recordings of seed {result['seed']}" in words_of(text)
    rates = {rate["what"]: rate["cases"] for rate in result["rates"]}
    for words_there, what in (
        ("main effect named", "main effect named"),
        ("an effect invented, nothing else missing", "nothing missing: an effect invented"),
        ("another effect invented next to the main one", "one effect: another invented"),
    ):
        assert f"| {words_there} | {rates[what]} |" in text


def test_real_recordings_are_those_of_the_kept_report() -> None:
    folder = EXAMPLES / "real_recordings"
    rows = json.loads((folder / "result.json").read_text(encoding="utf-8"))["rows"]
    report, text = (folder / "report.md").read_text(encoding="utf-8"), page("evidence")
    assert len(rows) > 0
    for row in rows:
        assert f"| {' | '.join(row.values())} |" in report
        shown = ("recording", "verdict", "named", "recalibrated", "with effects")
        assert f"| {' | '.join(row[name] for name in shown)} |" in text


def test_answers_to_varied_recordings_are_those_of_the_kept_report() -> None:
    rows = json.loads((EXAMPLES / "varied_recordings" / "result.json").read_text(encoding="utf-8"))["rows"]
    by_recording: dict[str, list[tuple[str, str]]] = {}
    for row in rows:
        by_recording.setdefault(row["recording"], []).append((row["verdict"], row["named"]))
    assert len(by_recording) == 6
    for recording, (first, *others) in by_recording.items():
        same = sum(answer == first for answer in others)
        assert len(others) == 10
        assert f"| {recording} | {same} of {len(others)} |" in page("evidence")


@pytest.mark.parametrize(
    ("kept", "mesh", "name"),
    [
        ("error_bars", "extruded", "extruded"),
        ("error_bars", "wild", "unstructured"),
        ("error_bars_curved", "curved", "extruded, curved necks"),
    ],
)
def test_coverage_of_error_bars_is_that_of_the_example(kept: str, mesh: str, name: str) -> None:
    found = json.loads((EXAMPLES / kept / "result.json").read_text())["judgements"][mesh]
    numbers = [units.significant(100 * found[f"median_{what}"], 2) for what in ("estimate", "error")]
    row = f"| {name} | {found['contained']} of {found['count']} | {numbers[0]} % | {numbers[1]} % |"
    assert row in page("evidence")


def test_speed_ratios_are_those_of_the_kept_report() -> None:
    rows = json.loads((EXAMPLES / "benchmarks" / "result.json").read_text(encoding="utf-8"))["rows"]
    assert len(rows) > 0
    for row in rows:
        ratio = float(f"{row['other'] / row['own']:.2g}")
        assert f"| {row['task']} | {row['equal']} | {row['peer']} | {ratio:g} |" in page("evidence")


def test_ratios_of_fits_are_those_of_the_kept_report() -> None:
    problems = json.loads((EXAMPLES / "least_squares" / "result.json").read_text(encoding="utf-8"))["problems"]
    for part in least_squares.PARTS:
        for how in least_squares.MANNERS:
            found = {
                each["problem"]: {name: least_squares.SolverOutcome(**each[name]) for name in least_squares.SOLVERS}
                for each in problems
                if each["manner"] == how and least_squares.part_of(each["problem"]) == part
            }
            r = least_squares.ratio(found)
            ends = f"| {r.alike} of {len(found)} | {r.own_lower} | {r.scipy_lower} |"
            assert f"| {part.lower()} | {how} {ends} {r.simulations:.2f} | {r.seconds:.2f} |" in page("evidence")
