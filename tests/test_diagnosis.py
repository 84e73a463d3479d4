"""Diagnosis: its verdicts on stands made by hand, what numbers that moved too far stand for, and whole diagnoses.

The recordings are a few seconds long, made by the engine itself: what is tried here is the judgement, not the physics.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter, lsim

from flexdesign import effects
from flexdesign.diagnosis import Diagnosis, adding, course, diagnose
from flexdesign.diagnosis.candidates import candidates
from flexdesign.diagnosis.course import Course, Setting, case_of
from flexdesign.diagnosis.features import Features
from flexdesign.diagnosis.judgement import ADEQUATE, ERRORS, EXPLAINED, conclude, remainder
from flexdesign.diagnosis.periodic import frequencies
from flexdesign.diagnosis.rounding import rounded
from flexdesign.dynamics.axis_model import AxisDynamics
from flexdesign.dynamics.axis_run import of_axis
from flexdesign.errors import InputError
from flexdesign.evidence.coloured import Coloured, Process
from flexdesign.evidence.marquardt import Solution
from flexdesign.evidence.model_comparison import Step, Trial
from flexdesign.evidence.rival import Rival
from flexdesign.evidence.screening import Candidate
from flexdesign.evidence.stand import Stand
from flexdesign.evidence.suite import Problem
from flexdesign.noise_floor import NoiseFloor
from flexdesign.runs import Run
from flexdesign.stage_model import AxisModel, StageModel

Array = NDArray[np.float64]
Numbers = Mapping[str, float]
NONE: Numbers = {}
PERIOD, NOISE = 1e-3, 1e-8
AXIS = AxisModel(118.3, 0.03, 1.98e-6, uncertainty={"natural_frequency": 0.02, "gain": 0.1, "damping_ratio": 1.0})
#: With mass and stiffness, so that a run may carry a known mass.
WEIGHED = replace(AXIS, mass=0.0342, stiffness=0.0342 * (2 * math.pi * 118.3) ** 2)


def run_of(name: str, command: Array, response: Array, role: Literal["identify", "validate"], **more: Any) -> Run:
    columns = {"u": command, "x": response}
    return Run(name, PERIOD * np.arange(float(len(command))), columns, {"u": "V", "x": "m"}, "hold", role, **more)


# --- stands made by hand --------------------------------------------------------------------------------------------


def setting(axis: AxisModel = AXIS, dof: float = math.inf, n: int = 2000, **more: Any) -> Setting:
    """Two runs for the fit and one kept apart, of random numbers; only their lengths count."""
    rng = np.random.default_rng(0)
    roles: dict[str, Literal["identify", "validate"]] = {"one": "identify", "two": "identify", "kept": "validate"}
    runs = [run_of(name, rng.uniform(0, 100, n), rng.normal(0, 1e-4, n), role, **more) for name, role in roles.items()]
    process = Process(np.zeros(0), NOISE)
    noise = NoiseFloor(Coloured(process), dict.fromkeys(roles, NOISE), "stated", dof > 0, (), dof)
    known = {name: (axis.numbers[name], axis.numbers[name] * share) for name, share in axis.uncertainty.items()}
    return Setting("x", axis, tuple(of_axis(run, "x", axis) for run in runs), noise, 0.3 * NOISE, known)


@pytest.mark.parametrize("step", [None, 4e-7])
def test_a_line_hidden_in_quiet_records_is_seen_in_what_is_left_of_others(step: float | None) -> None:
    """A sinusoid of 1.2 times the noise at 15.5 Hz, to a tenth of the resolution; else quiet records would show it."""
    rng, t = np.random.default_rng(0), PERIOD * np.arange(2000.0)
    about = replace(setting(), noise=replace(setting().noise, known=step is not None, lines=()))
    vars(about)["coarse_step"] = step
    left = {run.name: NOISE * (1.2 * np.sin(2 * np.pi * 15.5 * t) + rng.standard_normal(len(t))) for run in about.runs}
    left[about.runs[0].name][700:710] = np.nan
    stand: Any = SimpleNamespace(remainders=left)
    (found,) = frequencies(about, stand)
    assert found == pytest.approx(15.5, abs=0.05)
    vars(about)["coarse_step"] = None
    assert frequencies(replace(about, noise=replace(about.noise, known=True)), stand) == ()


def stand(
    about: Setting, seen: float = 1.0, kept: float = 1.0, added: Sequence[Candidate] = (), moved: Numbers = NONE
) -> Stand:
    """A stand that leaves so many times the noise, in squares, with some numbers moved to other values."""
    model, case = case_of(StageModel({"x": about.axis}), about, map, lambda _: None)
    begun: Any = model
    for effect in added:
        begun = effect.add(begun)
    begun = begun.replace(moved)
    free = [*case.free, *(name for effect in added for name in effect.free)]
    where = case.coordinates(begun, free, case.identify)
    problem = Problem(case.identify, begun, where)
    half = math.sqrt(seen * case.identify.samples / 2)
    parts = tuple(half * np.eye(1, record.rows)[0] for record in case.identify.records)
    normal = np.diag(1 / (1e-3 * where.sizes(where.start)) ** 2)
    cost = sum(float(part @ part) for part in parts)
    solution = Solution(problem, where.start, cost, parts, (), normal, True)
    held = kept * sum(record.present.sum() for record in case.validate.records)
    rms = {"identify": NOISE * math.sqrt(seen), "validate": NOISE * math.sqrt(kept)}
    left = {run.name: np.full(len(run.time), rms[run.role]) for run in about.runs}
    return Stand(tuple(added), solution, begun, float(held), left)


def creep(about: Setting) -> Candidate:
    model, _ = case_of(StageModel({"x": about.axis}), about, map, lambda _: None)
    return next(c for c in candidates(model) if c.name == "creep")


def rival(held_gain: float = 0.0, moved: float = 0.0, **terms: float) -> Rival:
    gain = float(sum(terms.values()))
    return Rival(terms, gain, held_gain, moved, {name: amount / gain for name, amount in terms.items()})


def judged(
    about: Setting,
    first: Stand,
    final: Stand,
    before: Rival | None = None,
    left: Rival | None = None,
    alike: Sequence[Trial] = (),
) -> Diagnosis:
    stands = (final,) if final.effects else ()
    chosen = [trial_of(first, final)] if stands else []
    steps = [Step(trial, (trial, *alike), tuple(alike)) for trial in chosen]
    course = Course(first, first, stands, (*steps, Step(None, ())), final, 1)
    return conclude(StageModel({"x": about.axis}), about, course, before or rival(), left or rival())


def trial_of(before: Stand, after: Stand, names: tuple[str, ...] = ()) -> Trial:
    gain, held = before.cost - after.cost, before.held_cost - after.held_cost
    return Trial(names or after.names, after, gain, held, 1e-6, NOISE, 20.0, "")


def verdict_of(
    first: float, final: float, named: bool, before: Rival | None = None, left: Rival | None = None
) -> tuple[str, tuple[str, ...], tuple[str, ...], bool]:
    """Verdict, effects, near ones, and whether something stays, where runs kept apart are as those that were fitted."""
    about = setting()
    calibrated = stand(about, first, first)
    last = stand(about, final, final, [creep(about)]) if named else calibrated
    found = judged(about, calibrated, last, before, left)
    return found.verdict, tuple(e.name for e in found.effects), found.near, bool(found.remainder)


#: Mean squares, in those of the noise; and smooth functions that explain what is there, or hardly move anything.
LITTLE, MUCH = 1.05, 1000.0
SMOOTH, FAINT = rival(500.0, NOISE, position=400.0), rival(500.0, 0.2 * NOISE, position=400.0)
FALL = (MUCH - 1) * 2000


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ((LITTLE, LITTLE, False), ("nothing-missing", (), (), False)),
        ((MUCH, MUCH, False), ("unknown", (), (), True)),
        ((MUCH, LITTLE, True), ("effects-found", ("creep",), (), False)),
        # Something stays: a small share of what was unexplained, or a larger one.
        ((MUCH, 1 + 0.9 * EXPLAINED * (MUCH - 1), True), ("effects-found", ("creep",), (), True)),
        ((MUCH, 1 + 1.1 * EXPLAINED * (MUCH - 1), True), ("unknown", (), ("creep",), True)),
        # Smooth functions explain more of the runs kept apart than the effect, or less.
        ((MUCH, 2.0, True, rival(1.1 * FALL, 1e-6, position=1.0)), ("unknown", (), ("creep",), True)),
        ((MUCH, 2.0, True, rival(0.9 * FALL, 1e-6, position=1.0)), ("effects-found", ("creep",), (), True)),
        # Nothing stands out of the noise, but smooth functions explain something; too little of it to matter.
        ((LITTLE, LITTLE, False, None, SMOOTH), ("unknown", (), (), True)),
        ((LITTLE, LITTLE, False, None, FAINT), ("nothing-missing", (), (), False)),
        ((LITTLE, LITTLE, False, None, replace(SMOOTH, held_gain=-1.0)), ("nothing-missing", (), (), False)),
    ],
)
def test_verdicts(case: tuple[Any, ...], expected: tuple[Any, ...]) -> None:
    assert verdict_of(*case) == expected


def test_what_stays_counts_wherever_it_stays() -> None:
    """On the runs kept apart, or on those that were fitted; both must be noise."""
    about = setting()
    for seen, kept, verdict in ((1.0, 1.0, "nothing-missing"), (1.0, 1.5, "unknown"), (1.5, 1.0, "unknown")):
        one = stand(about, seen, kept)
        assert judged(about, one, one).verdict == verdict


@pytest.mark.parametrize("dof", [50.0, math.inf])
def test_the_less_is_known_of_the_noise_the_more_counts_as_noise(dof: float) -> None:
    """A level known from k samples is off by the root of 1 / 2k, its square by twice that; so is chance, from n."""
    about = setting(dof=dof)
    for n, seen, kept in ((4000, 1.0, 0.0), (2000, 0.0, 1.0)):
        allowed = ADEQUATE + ERRORS * math.sqrt(2 / n + 2 / dof)
        for share, is_noise in ((0.99, True), (1.01, False)):
            more = share * allowed
            left = remainder(about, stand(about, 1 + more * seen, 1 + more * kept))
            assert left.is_noise is is_noise
            assert (left.allowed, left.excess) == pytest.approx((allowed, more))
            assert left.raw == pytest.approx(NOISE * math.sqrt(more * kept))


def test_words_say_what_stays_and_what_it_looks_like() -> None:
    about = setting()
    one = stand(about, 9.0, 9.0)
    left = rival(10.0, 1e-6, **{"a": 1.0, "b": 5.0, "c": 2.0, "d": 0.5})
    assert judged(about, one, one, left=left).remainder.startswith("3 times the noise stays")
    assert judged(about, one, one, left=left).remainder.endswith("explain most: b, c, a")
    assert "no smooth function" in judged(about, one, one).remainder


def test_a_ladder_and_shares_are_those_of_the_stands() -> None:
    about = setting()
    found = judged(about, stand(about, 101.0, 101.0), stand(about, 2.0, 2.0, [creep(about)]))
    assert [rung.label for rung in found.ladder] == ["as designed", "recalibrated", "+ creep"]
    assert [(rung.error / NOISE) ** 2 for rung in found.ladder] == pytest.approx([101, 101, 2])
    assert found.effects[0].share == pytest.approx((101 - 2) / 100)
    assert found.noise_floor == pytest.approx(NOISE)
    assert found.validation_error == pytest.approx(NOISE * math.sqrt(2))
    for value in (*found.effects[0].values, *found.calibration):
        assert value.interval[0] < value.value < value.interval[1]
    # Half of an interval is 1.96 standard deviations, wider where more than noise stays.
    gain = next(value for value in found.calibration if value.parameter.name == "gain")
    assert gain.interval[1] - gain.value == pytest.approx(1.96 * math.sqrt(2) * 1e-3 * about.axis.gain, rel=0.05)


def test_effects_that_look_alike_are_one_answer() -> None:
    """The one that was added comes first, no more than three in all."""
    about = setting()
    first, final = stand(about, MUCH, MUCH), stand(about, added=[creep(about)])
    others = [trial_of(first, final, (name,)) for name in ("thermal_expansion", "sensor_drift", "base_motion")]
    found = judged(about, first, final, alike=[*others[:1], trial_of(first, final, ("a", "b")), *others[1:]])
    assert found.confusable == (("creep", "thermal_expansion", "sensor_drift"),)
    outcomes = {tried.names: tried.outcome for tried in found.candidates}
    assert outcomes["creep",] == "added"
    assert "cannot tell" in outcomes["thermal_expansion",]


# --- numbers that moved beyond what was known -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "more", "moved", "names", "group", "number"),
    [
        # A tenth slower: by more mass, (1 / 0.9)^2 - 1; or, where a known mass shows that it is not that, 1 - 0.9^2.
        (AXIS, {}, {"natural_frequency": 0.9}, ("payload_mass",), (("payload_mass", "stiffness_loss"),), 0.2346),
        (WEIGHED, {"payload": 0.005}, {"natural_frequency": 0.9}, ("stiffness_loss",), (), 0.19),
        (AXIS, {}, {"gain": 1.5}, ("sensor_gain",), (), 0.5),
        (AXIS, {}, {"gain": 0.6}, ("sensor_gain",), (), -0.4),
    ],
)
def test_numbers_that_moved_too_far_are_effects(
    axis: AxisModel,
    more: dict[str, Any],
    moved: dict[str, float],
    names: tuple[str, ...],
    group: tuple[tuple[str, ...], ...],
    number: float,
) -> None:
    about = setting(axis, **more)
    values = {name: axis.numbers[name] * ratio for name, ratio in moved.items()}
    one = stand(about, moved=values)
    found = judged(about, one, one)
    assert found.verdict == "effects-found"
    assert tuple(effect.name for effect in found.effects) == names
    assert found.confusable == group
    (value,) = found.effects[0].values
    assert value.value == pytest.approx(number, abs=1e-4)
    assert value.interval[0] < value.value < value.interval[1]
    (words,) = found.conflicts
    assert next(iter(moved)) in words and "standard deviations" in words
    # The model that is written holds the effect, and its own number is back where it was known to be.
    written = found.model.axes["x"]
    assert names[0] in written.effects
    assert all(written.numbers[name] == pytest.approx(axis.numbers[name]) for name in moved)
    ramp = run_of("ramp", np.minimum(np.arange(200.0), 100.0), np.zeros(200), "identify")
    expected = AxisDynamics("x", replace(axis, mass=None, stiffness=None), 100.0).replace(values).predict(ramp)
    assert AxisDynamics("x", written, 100.0).predict(ramp) == pytest.approx(expected, abs=2e-3 * np.ptp(expected))


@pytest.mark.parametrize(
    ("moved", "is_said"),
    [
        ({"natural_frequency": 0.95}, False),  # two and a half standard deviations
        ({"gain": 1.25}, False),
        ({"natural_frequency": 1.1}, True),  # lighter or stiffer than was known: nothing in the catalogue does that
        ({"damping_ratio": 5.0}, True),
    ],
)
def test_other_moves_name_nothing(moved: dict[str, float], is_said: bool) -> None:
    about = setting()
    one = stand(about, moved={name: about.axis.numbers[name] * ratio for name, ratio in moved.items()})
    found = judged(about, one, one)
    assert (found.verdict, found.effects, found.confusable) == ("nothing-missing", (), ())
    assert bool(found.conflicts) is is_said


def test_nothing_is_implied_where_something_unknown_stays() -> None:
    about = setting()
    one = stand(about, 9.0, 9.0, moved={"natural_frequency": 0.9 * about.axis.natural_frequency})
    found = judged(about, one, one)
    assert (found.verdict, found.effects) == ("unknown", ())
    assert len(found.conflicts) == 1


def test_runs_that_all_begin_late_share_a_delay() -> None:
    """Late by two samples where half a sample was expected; one alone is late by itself."""
    about = setting()
    all_late = stand(about, moved={"one:trigger": 2.1e-3, "two:trigger": 1.9e-3})
    found = judged(about, all_late, all_late)
    assert [effect.name for effect in found.effects] == ["transport_delay"]
    assert found.effects[0].values[0].value == pytest.approx(2e-3)
    assert found.model.controller.delay == pytest.approx(2e-3)
    one_late = stand(about, moved={"one:trigger": 0.6e-3, "two:trigger": -0.2e-3})
    assert judged(about, one_late, one_late).verdict == "nothing-missing"


def test_a_gain_that_rises_with_a_falling_frequency_is_lost_stiffness() -> None:
    """k x = F and w^2 = k / m: of a fifth less stiffness both follow, and added mass would leave the gain alone."""
    about = setting()
    moved = {"natural_frequency": AXIS.natural_frequency * math.sqrt(0.65), "gain": AXIS.gain / 0.65}
    softer = stand(about, moved=moved)
    found = judged(about, softer, softer)
    assert [effect.name for effect in found.effects] == ["stiffness_loss"] and not found.confusable
    assert found.effects[0].values[0].value == pytest.approx(0.35)
    low, _ = found.effects[0].values[0].interval
    assert 0.35 - low == pytest.approx(1.96 * 2 * 0.02 * 0.65, rel=0.05)  # the old frequency is known to 2 %
    heavier = stand(about, moved={"natural_frequency": moved["natural_frequency"]})
    assert judged(about, heavier, heavier).confusable == (("payload_mass", "stiffness_loss"),)


def with_parts(of: Stand, more: Mapping[int, float]) -> Stand:
    """The stand with Gaussian noise of variance one left, and jumps added to it at some samples."""
    rng = np.random.default_rng(0)
    parts = [rng.standard_normal(len(part)) for part in of.solution.residuals]
    for place, jump in more.items():
        parts[0][place] += jump
    return replace(of, solution=replace(of.solution, residuals=tuple(parts)))


def test_jumps_are_no_noise_however_few() -> None:
    about = setting()
    calm, jumping = (with_parts(stand(about), more) for more in ({}, {100: 12.0, 700: -9.0, 1500: 10.0}))
    assert judged(about, calm, calm).verdict == "nothing-missing"
    found = judged(about, jumping, jumping)
    assert found.verdict == "unknown" and "with 3 sudden jumps" in found.remainder


def test_rounding_of_slow_motion_is_coloured_noise() -> None:
    """Sawteeth of some ten samples: whitened by what a prediction tells, they are independent numbers again."""
    step, n = 1e-7, 4000
    rng = np.random.default_rng(2)
    motion = 2e-6 * np.sin(2 * np.pi * np.arange(n) / 2500.0)
    noisy = motion + 1e-8 * rng.standard_normal(n)
    seen = run_of("slow", np.zeros(n), step * np.round(noisy / step), "identify")
    left: Any = SimpleNamespace(remainders={"slow": seen.measured() - motion})
    found = rounded({"slow": seen}, Coloured(Process(np.zeros(0), 1e-8)), left, step)
    errors = left.remainders["slow"]
    white = found.process("slow").whiten(errors[:, None])[:, 0]
    correlations = [float(e[1:] @ e[:-1] / (e @ e)) for e in (errors, white)]
    assert correlations[0] > 0.3 and abs(correlations[1]) < 0.1
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.15)


# --- candidates and features ----------------------------------------------------------------------------------------


def test_candidates_are_the_catalogue_without_what_the_axis_has() -> None:
    model = AxisDynamics("x", replace(AXIS, effects={"creep": {"per_decade": 0.01, "t0": 0.1}}), 100.0)
    names = [candidate.name for candidate in candidates(model)]
    absent = {"creep", "payload_mass", "stiffness_loss", "sensor_gain", "quantisation"}
    assert set(effects.names()) - set(names) == absent
    assert len(names) == len(set(names))
    assert "payload_mass" in [c.name for c in candidates(model, loaded=True)]
    filtered = replace(model, axis=replace(model.axis, driver=replace(model.axis.driver, bandwidth=500.0)))
    assert set(names) - {c.name for c in candidates(filtered)} == {"driver_bandwidth"}


def test_what_acts_ahead_of_the_stack_is_no_candidate_where_its_voltage_is_known() -> None:
    model = AxisDynamics("x", AXIS, 75.0)
    ahead = {c.name for c in candidates(model)} - {c.name for c in candidates(model, at_stack=True)}
    assert ahead == {"driver_bandwidth", "driver_saturation", "driver_slew", "transport_delay"}
    t = PERIOD * np.arange(400)
    command = 50 * np.sin(20 * t)
    sent = Run("sent", t, {"u": command, "x": 2e-6 * command}, {"u": "V", "x": "m"}, "hold")
    quiet = replace(sent, name="quiet", columns={"u": 0 * t, "x": np.random.default_rng(0).normal(0, NOISE, 400)})
    monitored = replace(sent, name="monitored", columns={**sent.columns, "v": command}, si={**sent.si, "v": "V"})
    stage = StageModel({"x": AXIS})
    assert course.settle(stage, [quiet, monitored], "x", None).is_at_stack
    assert not course.settle(stage, [quiet, sent, monitored], "x", None).is_at_stack
    with pytest.raises(InputError, match="driver_slew: acts ahead of the stack"):
        adding.add(stage, "driver_slew", [quiet, monitored])
    wrong = replace(sent, columns={**sent.columns, "x": 1e3 * sent.columns["x"]})
    with pytest.raises(InputError, match=r"sent:identify: column x = .* a thousand times"):
        course.settle(stage, [quiet, wrong], "x", None)


def test_trials_are_values_that_a_fit_may_have() -> None:
    model = AxisDynamics("x", AXIS, 100.0, apart=("run",))
    for candidate in candidates(model):
        added = candidate.add(model)
        numbers = {p.name: p for p in added.parameters()}
        assert candidate.strength in candidate.free
        assert candidate.trials
        for trial in candidate.trials:
            assert candidate.strength in trial and set(trial) <= set(numbers)
            assert all(numbers[name].is_plausible(value) for name, value in trial.items())
            assert trial[candidate.strength] != numbers[candidate.strength].null
        assert set(candidate.free) <= set(numbers)
        assert not any(numbers[name].per_run for name in candidate.free)
        assert candidate.is_limit is math.isinf(numbers[candidate.strength].null or 0.0)
        # Trials hold every value of every grid: none was cut off.
        grids = [{trial[name] for trial in candidate.trials} for name in candidate.trials[0]]
        assert len(candidate.trials) == len(set(itertools.product(*grids)))


def test_a_hum_is_tried_at_the_lines_that_were_seen() -> None:
    model = AxisDynamics("x", AXIS, 100.0)
    (hum,) = [c for c in candidates(model, lines=[52.7]) if c.name == "mains_hum"]
    (other,) = [c for c in candidates(model) if c.name == "mains_hum"]
    assert hum.phase
    frequency = next(name for name in hum.free if name.endswith("frequency"))
    assert {t[frequency] for t in hum.trials} - {t[frequency] for t in other.trials} == {52.7}


def test_features_are_functions_of_the_motion() -> None:
    t = PERIOD * np.arange(400)
    predicted = 1e-4 * np.sin(2 * math.pi * 5 * t)
    command = np.where(t < 0.1, 0.0, np.where(t < 0.3, 80.0, 30.0))
    model = AxisDynamics("x", AXIS, 100.0)
    made = Features(model)(run_of("run", command, predicted, "identify"), predicted)
    x = predicted / (1.98e-6 * 100)
    assert made["reading: position^2"] == pytest.approx(x**2)
    assert made["reading: position beyond 30 %"] == pytest.approx(np.maximum(x - 0.3, 0))
    # In a tenth of stroke times angular frequency; differences of samples lag by (2 pi 5 T)^2 / 6 at most.
    v = np.cos(2 * math.pi * 5 * t[1:-1]) * (1e-4 / 1.98e-4) * 5 / 118.3 / 0.1
    assert made["reading: velocity"][1:-1] == pytest.approx(v, rel=1e-3, abs=1e-6)
    since = np.where(t < 0.0995, t, np.where(t < 0.2995, t - 0.1, t - 0.3))
    assert made["reading: log of time since a step"] == pytest.approx(np.log10(1 + since / 0.01), abs=1e-9)
    assert all(values.shape == t.shape and np.isfinite(values).all() for values in made.values())


def test_a_force_is_seen_through_the_mode() -> None:
    """A force that waits between samples, by another program's integration; over the stiffness it is one at rest."""
    rng = np.random.default_rng(0)
    command = np.repeat(rng.uniform(0, 100, 8), 50)
    made = Features(AxisDynamics("x", AXIS, 100.0))(run_of("run", command, command, "identify"), np.zeros(400))
    w, fine = 2 * math.pi * 118.3, 50
    force = np.repeat(command / 100 - command[0] / 100, fine)
    moments = PERIOD / fine * np.arange(len(force))
    _, x, _ = lsim(([w**2], [1, 2 * 0.03 * w, w**2]), force, moments, interp=False)
    assert made["force: voltage^1"] == pytest.approx(x[::fine], abs=1e-6)


# --- whole diagnoses ------------------------------------------------------------------------------------------------

LOOP = {"a": 0.46e-6, "b": 0.0165, "c": 0.004, "n": 1.0, "rest": 0.0}
FLOOR = 4e-7


def commands(rng: np.random.Generator, n: int) -> dict[str, Array]:
    """Nothing; a multisine up to 200 Hz; a triangle; levels, held and short."""
    t, rest = PERIOD * np.arange(n), np.zeros(60)
    lines = np.arange(5, int(200 * n * PERIOD)) / (n * PERIOD)
    many = np.cos(2 * math.pi * np.outer(t, lines) + rng.uniform(0, 2 * math.pi, len(lines))).sum(axis=1)
    moves = {
        "multisine": 50 + 50 * many / np.abs(many).max(),
        "triangle": 100 - 100 * np.abs(2 * np.arange(n) / n - 1),
        "stairs": np.repeat(rng.uniform(0, 100, 4), n // 4),
        "levels": np.repeat(rng.uniform(0, 100, 8), n // 8),
    }
    return {"quiet": np.zeros(800), **{name: np.concatenate([rest, move]) for name, move in moves.items()}}


def recorded(
    axis: AxisModel,
    seed: int,
    *,
    n: int = 304,
    rho: float = 0.0,
    sensor: Callable[[Array], Array] = lambda y: y,
) -> list[Run]:
    """Runs of an axis, each with an offset, and noise whose next sample remembers the share `rho` of the last.

    The voltage had turned twice before a run, which is where its hysteresis and creep come from.
    """
    rng, made = np.random.default_rng(seed), []
    for name, command in commands(rng, n).items():
        run = run_of(name, command, np.zeros(len(command)), "validate" if name == "levels" else "identify")
        came_from = {f"{name}:turn.1": rng.uniform(50, 100), f"{name}:turn.2": rng.uniform(0, 25)}
        model = AxisDynamics("x", axis, 100.0, tolerance=1e-6, apart=(name,))
        motion = model.replace(came_from).predict(run)
        white = math.sqrt(1 - rho**2) * FLOOR * rng.standard_normal(len(command) + 500)
        reading = sensor(motion) + rng.normal(0, 2e-7) + lfilter([1.0], [1.0, -rho], white)[500:]
        made.append(replace(run, columns={"u": command, "x": reading}))
    return made


def acting(**added: Mapping[str, float]) -> AxisModel:
    return replace(AXIS, effects=added)


def thought(axis: AxisModel) -> StageModel:
    """The axis as it is thought to be: one percent too fast, its gain 6 % too large."""
    off = replace(axis, natural_frequency=119.5, gain=1.06 * axis.gain, damping_ratio=0.033)
    return StageModel({"x": off})


def test_creep_is_named() -> None:
    found = diagnose(thought(AXIS), recorded(acting(creep={"per_decade": 0.02, "t0": 0.1}), 1, n=600), threads=1)
    assert found.verdict == "effects-found"
    (named,) = found.effects
    assert named.name == "creep"
    for value, truth in zip(named.values, (0.02, 0.1), strict=True):
        assert value.interval[0] < truth < value.interval[1]
    assert found.validation_error < 1.15 * found.noise_floor < found.ladder[1].error
    assert found.remainder == ""


@cache
def of_noise() -> Diagnosis:
    """A stage with hysteresis that is as it was thought to be, but for its numbers; noise that remembers 0.95."""
    true, off = acting(bouc_wen=LOOP), acting(bouc_wen={**LOOP, "a": 0.93 * LOOP["a"], "b": 1.08 * LOOP["b"]})
    return diagnose(thought(off), recorded(true, 1, rho=0.95), threads=1)


def test_nothing_is_named_in_coloured_noise() -> None:
    found = of_noise()
    assert (found.verdict, found.effects, found.near, found.remainder) == ("nothing-missing", (), (), "")
    assert [rung.label for rung in found.ladder] == ["as designed", "recalibrated"]
    assert found.ladder[1].error < 0.5 * found.ladder[0].error


def test_its_numbers_are_calibrated() -> None:
    """An interval of 95 % holds the truth but for one in twenty; twice its width it hardly ever does not."""
    truth = {**AXIS.numbers, **{f"bouc_wen.{key}": number for key, number in LOOP.items()}}
    for value in of_noise().calibration:
        width = value.interval[1] - value.interval[0]
        assert abs(value.value - truth[value.parameter.name]) < width
        assert of_noise().model.axes["x"].numbers[value.parameter.name] == value.value


def test_a_sensor_that_no_effect_explains_is_unknown() -> None:
    """A reading that grows with the square of the position, by 2 % of the stroke at its end: ten times the noise."""
    found = diagnose(thought(AXIS), recorded(AXIS, 3, sensor=lambda y: y + 100 * y**2), threads=1)
    assert found.verdict == "unknown"
    assert found.effects == ()
    assert "position^2" in found.remainder


def test_hysteresis_is_named_from_a_linear_start() -> None:
    found = diagnose(thought(AXIS), recorded(acting(bouc_wen=LOOP), 1), threads=1)
    assert found.verdict == "effects-found"
    assert "bouc_wen" in (*(effect.name for effect in found.effects), *itertools.chain(*found.confusable))
    assert len(found.effects) == 1
    assert found.validation_error < 1.15 * found.noise_floor
