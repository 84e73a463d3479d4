"""What README.md claims is what the kept example report holds."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np

from flexdesign import cli
from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.diagnosis import initialised_comparison
from flexdesign.dynamics import stage_model
from flexdesign.measurements import recordings
from flexdesign.report import comparison_words as words

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
WORDS = " ".join(README.split())
EXAMPLES = ROOT / "reports" / "examples"
EXAMPLE = json.loads((EXAMPLES / "bridge_amplifier" / "result.json").read_text())
DIAGNOSIS = json.loads((EXAMPLES / "hidden_effect_demo" / "result.json").read_text())
DEMO = ROOT / "studies" / "hidden_effect_demo"


def test_table_is_the_example_report() -> None:
    rows = [line for line in README.splitlines() if re.match(r"(K_in|K_out|λ) ", line)]
    compared = [q for q in EXAMPLE["quantities"] if q.get("analytic") and q["name"] in ("K_in", "K_out", "lambda")]
    assert len(rows) == len(compared) == 5
    for row, found in zip(rows, compared, strict=True):
        fem = Quantity(found["name"], found["value"], "1", "", half_width=found["half_width"]).shown()
        assert fem in row
        assert found["boundary"] in row
        for analytic in (found["analytic"][model] for model in ("PRB", "compliance")):
            assert Quantity("", analytic["value"], "1", "").shown() in row
            assert f"{100 * analytic['error']:+.1f}" in row


def test_ladder_is_the_example_diagnosis() -> None:
    floor = DIAGNOSIS["noise_floor"]
    for rung in DIAGNOSIS["ladder"]:
        label, error = rung["label"].replace("_", " "), rung["error"]
        row = next(line for line in README.splitlines() if line.startswith(f"{label} "))
        ratio = units.significant(error["value"] / floor["value"], 3)
        row = " ".join(row.split())
        assert row.startswith(f"{label} {words.error(error['unit'], error['value'])} ") and row.endswith(f" {ratio}")
    assert (
        f"noise floor: {floor['source'].rpartition(' ')[0]} {words.error(floor['unit'], floor['value'], 2)} " in WORDS
    )


def test_named_effect_is_the_example_diagnosis() -> None:
    assert DIAGNOSIS["verdict"] == "effects-found"
    (effect,) = DIAGNOSIS["effects"]
    name = effect["name"].replace("_", " ")
    assert f"Missing: {name}. With it" in WORDS
    assert f"{name.capitalize()}: {effect['parameters'][0]['text']}. It explains" in WORDS
    assert f"explains {words.percent(effect['share'])} of what" in WORDS
    assert f"What to do about it: {effect['remedy']}." in WORDS
    error = DIAGNOSIS["validation_error"]
    floor = DIAGNOSIS["noise_floor"]["value"]
    assert f"by {words.error(error['unit'], error['value'])} (" in WORDS
    assert f"rms; the noise is {words.error(error['unit'], floor, 2)}." in WORDS
    # What was hidden, from the file that the diagnosis never reads.
    low, high = effect["parameters"][0]["interval"]
    assert low < tomllib.loads((DEMO / "answer.toml").read_text())["effects"][effect["name"]]["cubic"] < high


def test_the_demo_misses_by_what_is_said() -> None:
    found = initialised_comparison.compare(
        stage_model.read(str(DEMO / "model.toml"), []), recordings.read_runs([DEMO / "runs"])
    )
    assert f"misses them by {units.significant(found.rms / found.floor, 3)} times the noise" in WORDS


def test_verbs_exist() -> None:
    known = {verb.name for verb in cli.app.registered_commands if verb.name}
    known |= {verb.callback.__name__ for verb in cli.app.registered_commands if verb.callback}
    blocks = re.findall(r"```sh\n(.*?)```", README, re.S)
    shown = [verb for block in blocks for verb in re.findall(r"^flexdesign (\w+)", block, re.M)]
    assert len(set(shown)) >= 9
    assert set(shown) <= known


def test_linked_files_exist() -> None:
    links = re.findall(r"\]\((?!http)([^)#]+)\)", README)
    assert len(links) >= 6
    for link in links:
        assert (ROOT / link).exists(), link


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"`?make ([a-z-]+)", README):
        assert re.search(rf"^{target}:", makefile, re.M), target


def test_distances_from_fem_are_those_of_the_example() -> None:
    designs = json.loads((EXAMPLES / "theory_against_fem" / "result.json").read_text())["designs"]
    assert len(designs) == 200
    assert "Of two hundred amplifiers" in WORDS
    with_all = "{} % in K_in, {} % in λ and {} % in K_out in the median, and by {}, {} and {} % in the worst case"
    bare = "plain pseudo-rigid-body formulas are off by {}, {} and {} % and by {}, {} and {} %"
    for model, sentence in (("compliance", with_all), ("pseudo_rigid", bare)):
        errors = 100 * np.abs([list(design[model].values()) for design in designs])
        numbers = [*np.median(errors, axis=0), *errors.max(axis=0)]
        assert sentence.format(*(f"{n:.0f}" if n >= 10 else f"{n:.2g}" for n in numbers)) in WORDS


def test_rates_are_those_of_the_kept_trial() -> None:
    result = json.loads((EXAMPLES / "hidden_effect_trial" / "result.json").read_text())
    rates = {rate["what"]: rate for rate in result["rates"]}
    assert f"tried on {len(result['cases'])} such recordings" in WORDS

    def counted(what: str) -> tuple[str, str]:
        hits, total = rates[what]["cases"].split(" of ")
        return hits, total

    named, singles = counted("one effect: right verdict")
    both, pairs = counted("two effects: right verdict")
    alarms, none = counted("nothing missing: an effect named")
    unknown, outside = counted(next(what for what in rates if what.startswith("outside the catalogue: unknown")))
    assert (alarms, unknown) == ("0", outside)
    assert f"Of {singles} single effects it named {named}, of {pairs} pairs {both};" in WORDS
    assert f"of {none} recordings with nothing missing it named an effect in none" in WORDS
    assert f"all {outside} effects from outside the catalogue" in WORDS
    held = rates["95 % intervals that hold the truth"]
    assert f"hold the truth in {held['rate']} of {held['cases'].split(' of ')[1]} cases" in WORDS
