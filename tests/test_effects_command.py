"""The pages of the catalogue: what is stated is shown, and what is drawn is what the effect does."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign import effects
from flexdesign.diagnosis.experiment_design.effect_strength import VISIBLE_SHARE, Signature, on, signature_of
from flexdesign.diagnosis.experiment_design.experiments import suite_of
from flexdesign.diagnosis.experiment_design.limits import of_axis
from flexdesign.dynamics import stage_model
from flexdesign.report.catalogue import effect_charts, effect_pages
from flexdesign.report.render import to_markdown

Run = Callable[..., Any]

#: An effect of a user's own: the sensor reads a little more the farther the table is.
OWN = '''
"""A sensor that is not straight."""

from flexdesign import Block, Effect, Parameter, Socket


def constants(values, step):
    """Return the curvature."""
    return (values["curvature"],)


def move(path, out, state, constants):
    """Add a parabola."""
    for node in range(3):
        out[node] += constants[0] * path[node] * path[node]


EFFECT = Effect(
    name="bent_sensor",
    physics="The sensor is not straight.",
    where="the sensor",
    reveal="a slow triangle beside a better sensor",
    remedy="calibration",
    reference="none",
    parameters=(Parameter("curvature", "1/m", "1/mm", "curvature", 0.0, 1.0, (-1e3, 1e3)),),
    faces=(Block(Socket.SENSOR, constants=constants, move=move),),
)
'''


@pytest.fixture(scope="module")
def shown() -> Callable[[str], Signature]:
    """Return what shows an effect on the light stage."""
    model = stage_model.read("lin2019_stage", ["axis.x.damping_ratio=0.0242", 'axis.x.sensor.resolution="0 um"'])
    limits = of_axis(model, "x")
    dynamics = limits.dynamics(model, "x")
    menu = suite_of(dynamics, limits)
    return lambda name: signature_of(on(dynamics, name), menu)


# --- the catalogue ------------------------------------------------------------------------------------------------


def test_every_effect_is_listed(command_line: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    ended = command_line("effects")
    assert (ended.code, ended.stderr) == (0, "")
    assert all(name in ended.stdout for name in effects.names())


def test_the_catalogue_as_json_has_every_field(command_line: Run) -> None:
    found = json.loads(command_line("effects", "--json").stdout)["effects"]
    assert set(found) == set(effects.names())
    for name, effect in found.items():
        assert effect["name"] == name
        assert all(effect[key] for key in ("physics", "where", "reveal", "remedy", "reference", "parameters"))


def test_limits_have_an_infinite_null_in_json(command_line: Run) -> None:
    found = json.loads(command_line("effects", "--json").stdout)["effects"]["driver_slew"]
    assert found["parameters"][0]["null"] == "inf"


# --- one effect ---------------------------------------------------------------------------------------------------


def test_a_page_states_everything_and_draws_what_reveals_it(tmp_path: Path, command_line: Run) -> None:
    ended = command_line("effects", "creep", "--json")
    assert ended.code == 0
    folder = tmp_path / "reports" / "effects" / "creep"
    page, effect = (folder / "report.md").read_text(encoding="utf-8"), effects.find("creep")
    for text in (effect.physics, effect.where, effect.reveal, effect.remedy, effect.reference, "per_decade"):
        assert text in page
    assert "hold.svg" in page and (folder / "hold.svg").is_file()
    result = json.loads(ended.stdout)
    assert result["signature"]["experiments"][0]["name"] == "hold"
    with_effect = stage_model.read(str(folder / "stage_model.toml"), [])
    assert "creep" in with_effect.axes["x"].effects


def test_the_strength_is_such_that_the_reading_changes_by_a_hundredth_of_the_stroke(
    shown: Callable[[str], Signature],
) -> None:
    for name in ("creep", "payload_mass", "driver_saturation"):
        found = shown(name)
        # The search ends within 3 % of the strength; a saturation grows faster than in proportion.
        assert max(seen.change for seen in found.seen) / found.stroke == pytest.approx(VISIBLE_SHARE, rel=0.7)


def test_creep_grows_by_its_strength_in_a_decade(shown: Callable[[str], Signature]) -> None:
    """From 1 s to 10 s after the step, by per_decade times the drive; four states make the logarithm to 10 %."""
    found = shown("creep")
    hold = next(seen for seen in found.seen if seen.command.name == "hold")
    step = hold.command.marks[0]
    early, late = (round((step + after) / hold.command.period) for after in (1.0, 10.0))
    difference = hold.affected - hold.without
    assert difference[late] - difference[early] == pytest.approx(found.strength * hold.without[late], rel=0.1)


def test_an_error_of_the_sensor_s_gain_is_taken_up_by_a_new_gain(
    shown: Callable[[str], Signature],
) -> None:
    found = shown("sensor_gain")
    for seen in found.seen:
        if seen.command.push:  # what a static push does is taken as the motion itself
            continue
        assert seen.change == pytest.approx(
            found.strength * float(np.sqrt(np.mean(seen.without**2))), rel=1e-4, abs=1e-12
        )
        assert seen.left < 1e-4 * found.stroke


def test_what_needs_another_column_shows_in_the_experiment_that_records_it(
    shown: Callable[[str], Signature],
) -> None:
    for name, best in (("thermal_expansion", "warming"), ("cross_coupling", "other_axis")):
        found = shown(name)
        assert [seen.command.name for seen in found.visible] == [best]
        page = to_markdown(effect_pages.document(name, found))
        assert f"{best}.svg" in page


def test_a_hum_is_seen_first_where_nothing_else_moves(shown: Callable[[str], Signature]) -> None:
    assert shown("mains_hum").seen[0].command.name == "quiet"


def test_a_second_mode_shows_where_it_is(shown: Callable[[str], Signature]) -> None:
    """The difference of the spectra peaks at its natural frequency, beside the peak at the main one."""
    found = shown("second_mode")
    seen = next(each for each in found.seen if each.command.name == "multisine_large_a")
    pair = effect_charts._spectrum(seen, "µm", 1e6)
    beyond = pair.x > 200.0
    asked = found.effect.values(found.strength)["frequency"]
    assert pair.x[beyond][np.argmax(pair.difference[beyond])] == pytest.approx(asked, abs=1 / seen.command.cycle)


def test_an_effect_of_one_s_own_has_a_page_too(tmp_path: Path, command_line: Run) -> None:
    (tmp_path / "bent_sensor.py").write_text(OWN, encoding="utf-8")
    ended = command_line("effects", "bent_sensor.py", "--json", "--out", "page")
    assert ended.code == 0, ended.stderr
    values = json.loads(ended.stdout)["signature"]["values"]
    assert values["curvature"]["value"] > 0 and values["curvature"]["unit"] == "1/mm"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("crep",), "did you mean creep?"),
        (("missing.py",), "is no Python file"),
        (("creep", "--axis", "q"), "the model has no such axis"),
        (("creep", "--model", "nowhere"), "nowhere"),
    ],
)
def test_what_is_not_there_is_refused(command_line: Run, arguments: tuple[str, ...], words: str) -> None:
    ended = command_line("effects", *arguments)
    assert (ended.code, ended.stdout) == (2, "")
    assert words in ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", effects.names())
def test_every_effect_of_the_catalogue_is_visible(name: str, shown: Callable[[str], Signature]) -> None:
    found = shown(name)
    assert found.visible
    page = effect_pages.document(name, found)
    assert page.figures and all(figure.data.startswith(b"<?xml") for figure in page.figures)
