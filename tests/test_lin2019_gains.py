"""The study of the printed gains: its command, its numbers against those worked out before, its inputs' source."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from flexdesign.dynamics.control import Plant, rule, ultimate
from flexdesign.report.diagnosis import frequency_charts as charts
from studies.lin2019_gains.findings import fit_plant, rounding
from studies.lin2019_gains.printed import AXES, PRINTED

ROOT = Path(__file__).resolve().parent.parent
PERIOD = 1e-3
XY, Z = AXES


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run the command once, on one thread: its matrices are too small to share."""
    out = tmp_path_factory.mktemp("gains")
    one = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    command = [sys.executable, "-W", "error", "-m", "studies.lin2019_gains", "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | one, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def axes(folder: Path) -> dict[str, Any]:
    content = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    found: dict[str, Any] = content["axes"]
    return found


def candidate(axis: dict[str, Any], label: str) -> dict[str, Any]:
    (found,) = [c for c in axis["candidates"] if c["label"] == label]
    return dict(found)


# --- Inputs


def test_every_input_has_a_place() -> None:
    assert all(sourced.place and sourced.meaning for sourced in PRINTED.values())
    assert XY.half_digit("kp") == pytest.approx(5e-6) and XY.half_digit("td") == pytest.approx(5e-7)


# --- What was worked out before and apart from this study


@pytest.mark.parametrize(
    ("name", "label", "frequency", "damping"),
    [
        ("X/Y", "no delay", (118.3, 0.05), (0.0242, 5e-5)),
        ("X/Y", "1 sample of delay", (122.3, 0.05), (0.060, 5e-4)),
        ("X/Y", "2 samples of delay", (128.8, 0.05), (0.063, 5e-4)),
        ("Z", "no delay", (133.0, 0.5), (0.099, 5e-4)),
        ("Z", "printed frequency", (177.57, 5e-3), (0.255, 1e-3)),
    ],
)
def test_candidates(
    axes: dict[str, Any], name: str, label: str, frequency: tuple[float, float], damping: tuple[float, float]
) -> None:
    """To half of the last digit of the values known."""
    found = candidate(axes[name], label)
    assert found["natural_frequency"]["value"] == pytest.approx(frequency[0], abs=frequency[1])
    assert found["damping_ratio"]["value"] == pytest.approx(damping[0], abs=damping[1])


def test_the_printed_model(axes: dict[str, Any]) -> None:
    assert axes["X/Y"]["damping_ratio"] == pytest.approx(1, abs=5e-4)
    assert [axes[n]["mass"]["value"] for n in axes] == pytest.approx([34.2e-3, 20.6e-3], abs=5e-5)
    closing = [axes[n]["amplification"]["eq (30) with (31)"] for n in axes]
    assert closing == pytest.approx([4.046, 3.991], abs=5e-4)
    assert sorted(axes["X/Y"]["amplification"].values()) == pytest.approx([4.05, 5.95, 6.08, 6.57], abs=5e-3)
    assert axes["X/Y"]["ziegler_nichols_on_eq_31"]["kp"] == pytest.approx(0.741, abs=5e-4)


def test_mass_and_delay_are_confusable(axes: dict[str, Any]) -> None:
    heavy, late = candidate(axes["Z"], "no delay"), candidate(axes["Z"], "printed frequency")
    assert heavy["mass"]["value"] / axes["Z"]["mass"]["value"] == pytest.approx(1.78, abs=5e-3)
    assert late["delay"]["value"] == pytest.approx(1.46e-3, abs=5e-6)
    assert not any(c["label"] == "printed frequency" for c in axes["X/Y"]["candidates"])


def test_the_settling_times(axes: dict[str, Any]) -> None:
    """Known from another record; a settling time jumps by half an oscillation, 4.2 ms."""
    known = {"X/Y": (0.213, 0.217), "Z": (0.047, 0.069)}
    for name, times in known.items():
        settling = candidate(axes[name], "no delay")["settling"]
        for key, time in zip(("open_loop", "printed_gains"), times, strict=True):
            assert settling[key]["value"] == pytest.approx(time, abs=4.3e-3)
        assert settling["our_gains"]["value"] < settling["open_loop"]["value"] / 2
        assert settling["printed_gains"]["value"] > settling["open_loop"]["value"] / 2


def test_overshoot_is_the_closed_form(axes: dict[str, Any]) -> None:
    """exp(-pi zeta / sqrt(1 - zeta^2)); the response has a point every 0.1 ms, at most 0.04 rad from the crest."""
    found = candidate(axes["X/Y"], "no delay")
    zeta = found["damping_ratio"]["value"]
    exact = math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    assert found["overshoot"]["open_loop"] == pytest.approx(exact, abs=0.04**2)


# --- Bounds, family, rounding


def test_the_family_keeps_to_its_bounds_and_its_gains(axes: dict[str, Any]) -> None:
    for axis in AXES:
        found = axes[axis.name]
        assert len(found["family"]) > 20
        for member in found["family"]:
            assert member["natural_frequency"]["value"] > found["lowest_natural_frequency"]["value"]
            assert 0 < member["damping_ratio"] < found["largest_damping_ratio"]
        member = found["family"][7]
        plant = Plant(
            axis["gain"], member["natural_frequency"]["value"], member["damping_ratio"], member["delay"]["value"]
        )
        again = rule(ultimate(plant.discretise(PERIOD)))
        assert (again.kp, again.ti) == pytest.approx((axis["kp"], axis["ti"]), rel=1e-6)


def test_printed_gains_lose_stability_within_the_family(axes: dict[str, Any]) -> None:
    assert 2e-3 < axes["X/Y"]["longest_stable_delay"]["value"] < 3e-3
    assert 1.46e-3 < axes["Z"]["longest_stable_delay"]["value"] < 2e-3
    assert not candidate(axes["Z"], "2 samples of delay")["printed_gains_stable"]


def test_rounding_follows_the_sensitivities_of_a_light_resonance() -> None:
    """(fu/f0)^2 = 1 + KuK: f0 moves by dTi/Ti and by KuK / 2(1 + KuK) of dKp/Kp; zeta like Kp at least."""
    plant = fit_plant(XY, XY.target, 0.0, Plant(XY["gain"], 118.3, 0.0242))
    assert plant is not None
    frequency, damping = rounding(XY, plant)
    gain, time = XY.half_digit("kp") / XY["kp"], XY.half_digit("ti") / XY["ti"]
    share = XY.loop_gain / (2 * (1 + XY.loop_gain))
    # The hold's half sample is left out: 22 deg at the oscillation, 8 % of the second and smaller part.
    assert frequency / plant.natural_frequency == pytest.approx(time + share * gain, rel=0.02)
    assert gain < damping / plant.damping_ratio < 2 * gain


def test_experiment_agrees_with_analysis(axes: dict[str, Any]) -> None:
    """Bracket 1e-4, growth below 1e-5 per oscillation counts as none: 3e-4, as in the experiment's own tests."""
    for name, axis in zip(axes, AXES, strict=True):
        printed, tuned = axes[name]["experiments"]
        for one in (printed, tuned):
            assert one["ultimate_gain"]["experiment"] == pytest.approx(one["ultimate_gain"]["analytic"], rel=3e-4)
        assert 0.6 * tuned["ultimate_gain"]["experiment"] == pytest.approx(axis["kp"], rel=3e-4)


# --- The report


def test_the_report_is_whole(folder: Path) -> None:
    text = (folder / "report.md").read_text(encoding="utf-8")
    for picture in re.findall(r"\]\(([^)]+\.svg)\)", text):
        ET.parse(folder / picture)
    assert len(list(folder.glob("*.svg"))) == 5
    assert not re.search(r"\b(nan|inf|None)\b", text)
    for fact in ("Kp = 0.7413", "Certain:", "Confusable:", "What would distinguish them:"):
        assert fact in text
    assert "<svg" not in text and "data:image/svg+xml" in (folder / "report.html").read_text(encoding="utf-8")


def test_the_kept_example_is_of_this_study(axes: dict[str, Any]) -> None:
    kept = json.loads((ROOT / "reports/examples/lin2019_gains/result.json").read_text(encoding="utf-8"))["axes"]
    for name, found in axes.items():
        for one, other in zip(found["candidates"], kept[name]["candidates"], strict=True):
            # Tuned gains may follow the last bits of a machine's library; what is fitted may not.
            assert one["natural_frequency"]["value"] == pytest.approx(other["natural_frequency"]["value"], rel=1e-6)
            assert one["settling"]["open_loop"]["value"] == pytest.approx(other["settling"]["open_loop"]["value"])


def test_charts_name_their_curves_and_marks() -> None:
    drawn = charts.bode(
        ["one", "other"],
        [1.0, 2.0, 3.0],
        [[1, 2, 1], [1, 1, 1]],
        [[0, -90, -180], [0, -20, -40]],
        [charts.Mark("here", 2)],
    ).decode()
    ET.fromstring(drawn)
    assert all(f"<!-- {word} -->" in drawn for word in ("one", "other", "here", "phase [deg]", "frequency [Hz]"))
    step = charts.steps([charts.Curve("alone", [0, 1, 2], [0, 1.5, 1])], 0.02).decode()
    assert (
        "<!-- time [ms] -->" in step
        and step == charts.steps([charts.Curve("alone", [0, 1, 2], [0, 1.5, 1])], 0.02).decode()
    )


def test_an_unwritable_folder_is_refused_before_the_work(tmp_path: Path) -> None:
    from studies.lin2019_gains.__main__ import main

    place = tmp_path / "file"
    place.write_text("", encoding="utf-8")
    assert main(["--out", str(place)]) == 2
