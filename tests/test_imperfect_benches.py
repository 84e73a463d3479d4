"""The trial on imperfect benches: structural errors against closed forms, its drawing, its rule, its report."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.typing import NDArray

from studies.hidden_effect_trial import (
    bench,
    cases,
    confusion,
    curves,
    faults,
    folder,
    imperfect,
    imperfect_report,
    recordings,
    scoring,
    trial,
)
from studies.hidden_effect_trial.detection import State
from studies.hidden_effect_trial.effects import CATALOGUE, Stage
from studies.hidden_effect_trial.faults import KINDS, Fault
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.recordings import PERIOD, Recording
from studies.hidden_effect_trial.scoring import Diagnosed
from studies.hidden_effect_trial.trial import Outcome

Array = NDArray[np.float64]
LINEAR = Stage(gain=2e-6, omega=2 * math.pi * 118.0, zeta=0.03, a=0.0, b=0.0165, c=0.004, volts=100.0)
#: A seed that is no training seed, and a case for each structural error, where it is larger than the noise.
SEED = 7
LARGE = (70005, 70001, 70002, 70003, 70019)


def driven(u: Array, held: bool = False) -> Recording:
    """Return a run from rest at zero volts, with nothing unknown about it."""
    after = u[-1] if held else 2 * u[-1] - u[-2]
    return Recording("1-run", "identify", held, np.append(u, after), u[:1], 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 7)


@cache
def case_of(number: int) -> cases.Case:
    return imperfect.make(number, SEED)


# --- structural errors ------------------------------------------------------------------------------------------------


def test_curves_hold_no_polynomial_that_the_catalogue_bends_by() -> None:
    """By Gauss quadrature, exact here. Electrostriction, stiffening and amplification bend by squares and cubes."""
    x, w = legendre.leggauss(20)
    sensor = curves.curve(x, (0.0, 0.0, 0.0, 0.0, 0.3, -0.5, 0.7, 0.4))
    gain = np.array([curves.integral(each, 0.3, -0.5, 0.8) for each in x])
    for degree in range(4):
        assert abs(w @ (sensor * x**degree)) < 1e-14 and abs(w @ (gain * x**degree)) < 1e-14
    assert np.sqrt(w @ sensor**2) > 0.3


def test_curves_hold_no_cubic_where_positions_crowd() -> None:
    places = np.random.default_rng(1).beta(2.0, 5.0, 3000) * 2.0 - 1.0
    weights = curves.without_low_degrees(np.array([0.3, -0.5, 0.7, 0.4]), places)
    seen = curves.curve(places, weights)
    assert weights[4:] == (0.3, -0.5, 0.7, 0.4) and np.abs(seen).max() > 0.1
    assert all(abs(np.mean(seen * places**degree)) < 1e-12 for degree in range(4))


def test_an_uneven_gain_is_the_integral_of_its_polynomials() -> None:
    weights = (0.3, -0.5, 0.8)
    wanted = legendre.Legendre([0.0] * 5 + list(weights)).integ(lbnd=-1)
    for x in (-1.0, -0.6, 0.1, 0.9, 1.0):
        assert curves.integral(x, *weights) == pytest.approx(wanted(x), abs=1e-15)
    assert curves.integral(1.7, *weights) == curves.integral(-2.0, *weights) == pytest.approx(0.0, abs=1e-15)
    slow = 50.0 - 50.0 * np.cos(2 * math.pi * np.arange(4000) / 4000)
    fault = Fault("uneven_gain", 0.01, weights)
    plain, uneven = (bench.readings(LINEAR, {}, [driven(slow)], 20, each)[0] for each in (bench.SOUND, fault))
    moved = 0.5 * LINEAR.stroke * 0.01 * np.array([wanted(each) for each in slow / 50.0 - 1.0])
    # A cycle takes four seconds: the mode is late by 2 zeta / omega, 0.08 ms, and the eighth degree is 8 Hz at most.
    assert np.abs(uneven - plain - moved).max() < 0.01 * np.abs(moved).max()


def test_a_curved_sensor_shows_its_curve() -> None:
    fault = Fault("curved_sensor", 0.02, (0.0, 0.0, 0.0, 0.0, 1.0), span=(0.0, 100e-6))
    x = np.array([0.0, 50e-6, 100e-6])
    # P4 is 1 at both ends, 3/8 in the middle; over half the range, 50 um.
    assert fault.sensor(x) - x == pytest.approx([1e-6, 0.375e-6, 1e-6])


def test_a_clock_that_jitters_has_its_size_and_its_memory() -> None:
    fault = Fault("clock_jitter", 1e-5, memory=0.01, seed=3)
    late = fault.timing_error(driven(np.zeros(200_000)))
    assert late.std() == pytest.approx(1e-5, rel=0.03)  # twenty samples count as one: 1 / sqrt(2 * 10^4) is 0.7 %
    assert np.corrcoef(late[1:], late[:-1])[0, 1] == pytest.approx(math.exp(-0.1), abs=0.005)
    ramp = np.linspace(0.0, 100.0, 2000)
    plain, flawed = (bench.readings(LINEAR, {}, [driven(ramp)], 20, each)[0] for each in (bench.SOUND, fault))
    speed = LINEAR.gain * 100.0 / (1999 * PERIOD)
    late = fault.timing_error(driven(ramp))
    assert np.abs(flawed - plain - speed * late)[1000:].max() < 1e-3 * speed * 1e-5


def test_coarse_steps_keep_straight_commands_and_blur_jumps() -> None:
    ramp, jump = np.linspace(0.0, 50.0, 1000), np.where(np.arange(1000) < 400, 0.0, 50.0)
    coarse = Fault("coarse_steps", 0.37e-3)
    for u, is_same in ((ramp, True), (jump, False)):
        run = driven(u, held=True) if not is_same else driven(u)
        plain, flawed = (bench.readings(LINEAR, {}, [run], 200, each)[0] for each in (bench.SOUND, coarse))
        off = np.abs(flawed - plain).max() / LINEAR.stroke
        assert off < 1e-6 if is_same else 1e-3 < off < 0.37e-3 * LINEAR.omega  # late by less than a step
    fine = bench.readings(LINEAR, {}, [driven(jump)], 50, Fault("coarse_steps", PERIOD))[0]
    assert fine == pytest.approx(bench.readings(LINEAR, {}, [driven(jump)], 50)[0], abs=1e-9 * LINEAR.stroke)


def test_a_dead_band_keeps_the_last_reading() -> None:
    up = np.linspace(0.0, 5.0, 5001)
    fault = Fault("rounded_readings", 1.0 / LINEAR.stroke, dead=0.25)  # steps of one metre, to count in
    seen = fault.recorder(np.concatenate((up, up[::-1])), LINEAR)
    assert seen == pytest.approx(np.round(seen), abs=1e-9)
    seen = np.round(seen)
    assert up[np.argmax(seen[:5001] == 1.0)] == pytest.approx(0.751, abs=2e-3)  # half a step and a quarter
    assert up[::-1][np.argmax(seen[5001:] == 4.0)] == pytest.approx(4.249, abs=2e-3)


def test_smoothing_both_ways_delays_nothing() -> None:
    t = np.arange(4000) * PERIOD
    sine = np.sin(2 * math.pi * 50.0 * t)
    seen = Fault("rounded_readings", 0.0, cutoff=100.0).recorder(sine, LINEAR)
    inside = slice(100, -100)
    assert seen[inside] == pytest.approx(math.exp(-0.125) * sine[inside], abs=1e-3)


def test_smooth_friction_holds_back_by_its_hyperbolic_tangent() -> None:
    level, speed, volts = 1e-6, 60e-6, 100.0
    up = np.linspace(0.0, volts, 4000)
    x = bench.readings(
        LINEAR, {"smooth_friction": {"level": level, "speed": speed}}, [driven(np.concatenate((up, up[::-1])))], 20
    )[0]
    velocity = LINEAR.gain * volts / (3999 * PERIOD)
    lag = 2 * LINEAR.zeta / LINEAR.omega * velocity
    assert x[5999] - x[2000] == pytest.approx(2 * (level * math.tanh(velocity / speed) + lag), rel=2e-3)


def test_smooth_friction_does_not_depend_on_the_step() -> None:
    runs = tuple(run for run in recordings.draw(np.random.default_rng(4), LINEAR, False) if run.name[0] in "29")
    hidden = {"smooth_friction": {"level": 0.005 * LINEAR.stroke, "speed": 20e-6}}
    shown = [np.concatenate(bench.readings(LINEAR, hidden, runs, n)) for n in (bench.FINE, 4 * bench.FINE)]
    assert np.abs(shown[0] - shown[1]).max() < 1e-5 * LINEAR.stroke  # a tenth of the least noise of any case


# --- drawing ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", LARGE, ids=KINDS)
def test_a_structural_error_has_the_stated_size_and_is_no_effect(number: int) -> None:
    case = case_of(number)
    assert case.fault == imperfect.fault_in(number) and case.kind == "none"
    assert 1e-4 <= case.structural / case.stage.stroke <= 3e-3 and case.structural > case.noise
    clean = bench.readings(case.stage, case.effects, case.runs)
    left = [y - x for y, x in zip(case.readings, clean, strict=True)]
    whole = np.concatenate([each - each.mean() for each in left])
    # Noise and structural error do not know of each other; of 22 500 samples those of noise count as a tenth at least.
    assert np.sqrt(np.mean(whole**2)) == pytest.approx(math.hypot(case.structural, case.noise), rel=0.05)
    assert case.floor == pytest.approx(float(np.sqrt(np.mean(left[-1] ** 2))))
    # No effect of the catalogue, fitted beside the base, explains a fifth of its squares, nor of noise.
    strange = np.concatenate(left[:-1])
    name, share = confusion.nearest(State(case.stage, case.effects, case.runs[:-1]), strange, case.nominal)
    assert share > imperfect.STRANGE, name


def test_a_curve_of_low_degree_would_be_an_effect() -> None:
    """The guard against descriptions can fail: a square of the position is an amplification that grows with it."""
    stage = replace(LINEAR, a=0.46e-6)
    runs = recordings.draw(np.random.default_rng(3), stage, False)
    bent = Fault("curved_sensor", 0.01, (0.0, 0.0, 1.0), span=(-0.1 * stage.stroke, 1.1 * stage.stroke))
    plain, flawed = (np.concatenate(bench.readings(stage, {}, runs, 20, each)) for each in (bench.SOUND, bent))
    name, share = confusion.nearest(State(stage, {}, runs), flawed - plain, stage)
    assert name in ("stroke_dependent_amplification", "electrostriction", "quadratic_stiffness") and share < 0.5


def test_a_case_is_always_the_same_and_of_another_seed_another() -> None:
    once, again, other = case_of(70001), imperfect.make(70001, SEED), imperfect.make(70001, SEED + 1)
    assert all(np.array_equal(x, y) for x, y in zip(once.readings, again.readings, strict=True))
    assert once.stage != other.stage and once.fault == other.fault


@pytest.mark.parametrize("number", [60003, pytest.param(62402, marks=pytest.mark.slow)])
def test_the_hidden_effect_is_the_main_one(number: int) -> None:
    case = case_of(number)
    (name,) = case.effects
    assert name == imperfect.hidden_in(number)
    assert case.ratio[name] * case.noise >= 4.0 * case.structural
    assert [run.role for run in case.runs].count("test") == 1


def test_every_effect_meets_every_structural_error() -> None:
    told = trial.settings()
    numbers = told.imperfect_numbers()
    assert len(set(numbers)) == len(numbers) == 5 * (len(CATALOGUE) + 1) + 50
    met = [(imperfect.hidden_in(n), imperfect.fault_in(n)) for n in numbers]
    assert all((effect.name, kind) in met for effect in imperfect.HIDDEN for kind in KINDS)
    assert met.count(("", KINDS[0])) == 10
    part = told.sample(2).imperfect_numbers()
    kinds = [imperfect.fault_in(n) for n in part]
    assert len(part) == 2 * (len(CATALOGUE) + 1) + 20 and min(map(kinds.count, KINDS)) >= 12
    assert {imperfect.fault_in(n) for n in told.imperfect_numbers("clock_jitter")} == {"clock_jitter"}
    assert {imperfect.hidden_in(n) for n in told.imperfect_numbers("creep")} == {"creep"}
    for impossible in (59999, 62500, 80000):
        with pytest.raises(ValueError, match=f"no case {impossible}"):
            imperfect.hidden_in(impossible)
    with pytest.raises(ValueError, match="no structural error gravity"):
        told.imperfect_numbers("gravity")


def test_its_answer_says_what_the_bench_does(tmp_path: Path) -> None:
    case = case_of(70002)
    folder.write(case, tmp_path / "case", tmp_path / "answer.toml")
    answer = folder.read_answer(tmp_path / "answer.toml")
    assert (answer.fault, answer.seed) == ("curved_sensor", SEED)
    assert answer.structural == pytest.approx(case.structural, rel=1e-5)
    assert "curved" not in (tmp_path / "case" / "runs" / "measurements.toml").read_text(encoding="utf-8")


# --- the rule ---------------------------------------------------------------------------------------------------------


def answer_of(*names: str, fault: str = "clock_jitter", groups: dict[str, tuple[str, ...]] | None = None) -> Answer:
    kind = "single" if names else "none"
    ratio = dict.fromkeys(names, 5.0)
    return Answer("case", kind, {n: {} for n in names}, groups or {}, ratio, 1e-8, 1e-4, None, SEED, fault, 1e-7)


def said(verdict: str, *names: str, groups: tuple[tuple[str, ...], ...] = ()) -> Diagnosed:
    return Diagnosed(verdict, names, groups, 1e-8, 1e-8, {}, 1.0)


def test_the_main_effect_counts_with_and_without_a_remainder() -> None:
    answer = answer_of("creep")
    found = said("effects-found", "creep")
    for each in (found, replace(found, remainder=1e-7)):
        assert scoring.names_main(answer, each) and not scoring.false_effects(answer, each)
        assert scoring.is_right(answer, each)
    assert not scoring.names_main(answer, said("unknown")) and not scoring.false_effects(answer, said("unknown"))


def test_whatever_else_is_named_is_invented() -> None:
    both = said("effects-found", "creep", "mains_hum")
    assert scoring.names_main(answer_of("creep"), both) and not scoring.is_right(answer_of("creep"), both)
    assert scoring.false_effects(answer_of("creep"), both) == ("mains_hum",)
    assert scoring.false_effects(answer_of(), both) == ("creep", "mains_hum")
    assert scoring.is_right(answer_of(), said("unknown")) and scoring.is_right(answer_of(), said("nothing-missing"))
    group = ("mains_hum", "base_motion")
    found = said("effects-found", "mains_hum", groups=(group,))
    assert scoring.false_effects(answer_of("creep"), found) == ("mains_hum or base_motion",)
    alike = answer_of("base_motion", groups={"base_motion": ("mains_hum",)})
    assert scoring.names_main(alike, found) and not scoring.false_effects(alike, found)


def test_friction_by_another_law_is_coulomb_friction() -> None:
    answer = answer_of("smooth_friction")
    assert scoring.is_right(answer, said("effects-found", "coulomb_friction"))
    assert scoring.false_effects(answer, said("effects-found", "preload_loss")) == ("preload_loss",)


def test_rounding_that_is_there_is_no_invention() -> None:
    found = said("effects-found", "creep", "quantisation")
    assert scoring.is_right(answer_of("creep", fault="rounded_readings"), found)
    assert not scoring.is_right(answer_of("creep"), found)
    assert set(faults.TRUE) <= set(KINDS)


def test_the_report_has_both_rates_and_what_was_invented(tmp_path: Path) -> None:
    told = [
        (60000, answer_of("creep"), said("effects-found", "creep", "mains_hum")),
        (60001, answer_of("creep", fault="uneven_gain"), said("unknown")),
        (70000, answer_of(), said("nothing-missing")),
    ]
    outcomes = [Outcome(number, answer, found, "", "abc") for number, answer, found in told]
    lines = imperfect_report.write(outcomes, tmp_path, SEED)
    assert any(line.startswith("main effect named: 1 of 2") for line in lines)
    assert any(line.startswith("an effect invented: 1 of 3") for line in lines)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "Seed 7." in text and "| 60000 | mains_hum |" in text and "| 60001 | creep |" in text
    for outcome in outcomes:
        trial.append_outcome(outcome, tmp_path)
    assert list(trial.read_outcomes(tmp_path, SEED).values()) == outcomes
