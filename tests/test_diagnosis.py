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
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter, lsim

from flexdesign import effects
from flexdesign.core.errors import InputError
from flexdesign.core.model import parameter_of
from flexdesign.diagnosis import Diagnosis, add_effect, diagnose
from flexdesign.diagnosis import verdict as judgement
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import case_of
from flexdesign.diagnosis.effect_selection.prior_conflicts import conflicts, explains
from flexdesign.diagnosis.models_without_physics import SMOOTH_IS_BETTER, BasisFunctions
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare, rounding_noise
from flexdesign.diagnosis.preparation.spectra import line_frequencies
from flexdesign.diagnosis.result import Value
from flexdesign.diagnosis.verdict import LARGE, Conclusion, decide, diagnosis_of, excess, is_adequate
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.axis.axis_run import of_axis
from flexdesign.dynamics.stage_dynamics import missing
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation.criterion import INCLUDES_NULL, NOT_DETERMINED
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution
from flexdesign.estimation.least_squares.residual_function import value as value_at
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.model_comparison import Step, Trial
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.sparse_residual_model import SparseModel
from flexdesign.estimation.model_selection.stepwise_selection import SelectionHistory
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from flexdesign.estimation.uncertainty.identifiability import Estimate
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.noise_level.noise_floor import ADEQUATE, ERRORS
from flexdesign.measurements.recordings import Run
from flexdesign.report.diagnosis import diagnosis_text

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


def data(
    axis: AxisModel = AXIS, dof: float = math.inf, n: int = 2000, noise: float = NOISE, **more: Any
) -> DiagnosisData:
    """Two runs for the fit and one kept apart, of random numbers; only their lengths count."""
    rng = np.random.default_rng(0)
    roles: dict[str, Literal["identify", "validate"]] = {"one": "identify", "two": "identify", "kept": "validate"}
    runs = [run_of(name, rng.uniform(0, 100, n), rng.normal(0, 1e-4, n), role, **more) for name, role in roles.items()]
    whitening = ColouredNoise(Process(np.zeros(0), noise))
    floor = NoiseFloor(whitening, dict.fromkeys(roles, noise), "stated", dof > 0, (), dof)
    known = {name: (axis.numbers[name], axis.numbers[name] * share) for name, share in axis.uncertainty.items()}
    return DiagnosisData("x", axis, tuple(of_axis(run, "x", axis) for run in runs), floor, 0.3 * noise, known)


@pytest.mark.parametrize("step", [None, 4e-7])
def test_a_line_hidden_in_quiet_records_is_seen_in_what_is_left_of_others(step: float | None) -> None:
    """A sinusoid of 1.2 times the noise at 15.5 Hz, to a tenth of the resolution; else quiet records would show it."""
    rng, t = np.random.default_rng(0), PERIOD * np.arange(2000.0)
    about = replace(data(), noise=replace(data().noise, known=step is not None, lines=()))
    vars(about)["coarse_step"] = step
    left = {run.name: NOISE * (1.2 * np.sin(2 * np.pi * 15.5 * t) + rng.standard_normal(len(t))) for run in about.runs}
    left[about.runs[0].name][700:710] = np.nan
    fit: Any = SimpleNamespace(residuals_by_run=left)
    (found,) = line_frequencies(about, fit)
    assert found == pytest.approx(15.5, abs=0.05)
    vars(about)["coarse_step"] = None
    assert line_frequencies(replace(about, noise=replace(about.noise, known=True)), fit) == ()


def test_slow_samples_are_simulated_in_few_steps_where_few_do() -> None:
    """At 10 Hz, 200 steps in a sample could be needed; the mode, which is exact, and creep need none of them."""
    about = data()
    slow = tuple(replace(run, time=100 * run.time) for run in about.runs)
    axis = replace(about.axis, natural_frequency=1e4)
    model, task = case_of(StageModel({"x": axis}), replace(about, axis=axis, runs=slow), map, lambda _: None)
    for name in ("creep", "electrostriction"):
        coarse, fine = (
            way(next(c for c in candidates(model) if c.name == name).add(model))
            for way in (task.coarse, lambda of: task.fine(of, 1.0))
        )
        assert coarse.steps_for(slow[0]) <= 8
        assert coarse.predict(slow[0]) == pytest.approx(fine.predict(slow[0]), abs=1e-3 * NOISE)


@pytest.mark.parametrize("period", [2.5e-4, 1e-3, 2e-3])
def test_every_effect_can_be_screened_where_the_model_itself_needs_few_steps(period: float) -> None:
    """An effect whose simulation runs away would be missing from the catalogue, and nobody would know."""
    about = data(noise=1e3 * NOISE)
    runs = tuple(replace(run, time=run.time * (period / PERIOD)) for run in about.runs)
    axis = replace(about.axis, natural_frequency=125.0, effects={})
    model, task = case_of(StageModel({"x": axis}), replace(about, axis=axis, runs=runs), map, lambda _: None)
    for candidate in candidates(model):
        if not missing("x", effects.find(candidate.name), runs[0].columns):
            trials = [task.coarse(candidate.add(model)).replace(values) for values in candidate.trials]
            assert any(np.isfinite(np.asarray(trial.predict(runs[0]))).all() for trial in trials), candidate.name


def fit(
    about: DiagnosisData,
    seen: float = 1.0,
    kept: float = 1.0,
    added: Sequence[Candidate] = (),
    moved: Numbers = NONE,
    tests: float | None = None,
) -> FittedModel:
    """A stand that leaves so many times the noise, in squares, with some numbers moved to other values."""
    model, task = case_of(StageModel({"x": about.axis}), about, map, lambda _: None)
    begun: Any = model
    for effect in added:
        begun = effect.add(begun)
    begun = begun.replace(moved)
    free = [*task.free, *(name for effect in added for name in effect.free)]
    problem = task.problem(task.identify, begun, free)
    where = problem.where
    half = math.sqrt(seen * task.identify.samples / 2)
    parts = tuple(half * np.eye(1, record.rows)[0] for record in task.identify.records)
    normal = np.diag(1 / (1e-3 * where.sizes(where.start)) ** 2)
    cost = sum(float(part @ part) for part in parts)
    solution = Solution(problem, where.start, cost, parts, (), normal)
    held = kept * sum(record.present.sum() for record in task.validate.records)
    tests = kept if tests is None else tests
    rms = {role: NOISE * math.sqrt(of) for role, of in (("identify", seen), ("validate", kept), ("test", tests))}
    left = {run.name: np.full(len(run.time), rms[run.role]) for run in about.runs}
    return FittedModel(tuple(added), solution, begun, float(held), left)


def effect(about: DiagnosisData, name: str) -> Candidate:
    model, _ = case_of(StageModel({"x": about.axis}), about, map, lambda _: None)
    return next(c for c in candidates(model) if c.name == name)


def creep(about: DiagnosisData) -> Candidate:
    return effect(about, "creep")


def sparse_model(held_gain: float = 0.0, moved: float = 0.0, **terms: float) -> SparseModel:
    gain = float(sum(terms.values()))
    return SparseModel(terms, gain, held_gain, moved, {name: amount / gain for name, amount in terms.items()})


def course_of(
    first: FittedModel, *stands: FittedModel, alike: Sequence[Trial] = (), tried: Sequence[Trial] = (), **more: Any
) -> SelectionHistory:
    chosen = [trial_of(before, after) for before, after in itertools.pairwise((first, *stands))]
    steps = [Step(trial, (trial, *alike, *tried)) for trial in chosen]
    return SelectionHistory(first, first, stands, (*steps, Step(None, ())), **more)


def judged(
    about: DiagnosisData,
    first: FittedModel,
    final: FittedModel,
    left: SparseModel | None = None,
    alike: Sequence[Trial] = (),
    *,
    is_better_smooth: bool = False,
) -> Diagnosis:
    """What a diagnosis says of hand-made fits, without effects and perhaps with some."""
    return concluded(about, course_of(first, *([final] if final.effects else []), alike=alike), left, is_better_smooth)


def concluded(
    about: DiagnosisData,
    course: SelectionHistory,
    left: SparseModel | None = None,
    is_better_smooth: bool = False,
    is_end_relevant: bool = True,
) -> Diagnosis:
    left = left or sparse_model()
    # Hand-made fits have no Jacobian to profile by, and one sample for a residual, which looks white.
    with (
        mock.patch.multiple(
            judgement,
            intervals=quadratic,
            better_kind=lambda *_: SMOOTH_IS_BETTER if is_better_smooth else "",
            relevant_ends=lambda _, fit: fit.at_bound(),
            is_end_relevant=lambda *_: is_end_relevant,
        ),
        mock.patch.object(FittedModel, "is_white", False),
    ):
        _, task = case_of(StageModel({"x": about.axis}), about, map, lambda _: None)
        verdict, named, refusals = decide(about, task, course, left)
        ladder = [course.nominal, *course.levels_to(named)]
        moved = conflicts(about, named)
        is_done = is_adequate(about, course.final, left)
        implied = [each for each in moved if each.named is not None and is_done]
        stage = StageModel({"x": about.axis})
        conclusion = Conclusion(
            verdict=verdict,
            refusals=refusals,
            smooth_model=left,
            error_ladder=ladder,
            groups=(),
            conflicts=moved,
            implied_effects=implied,
            offset_rms=None,
            by_run={},
        )
        return diagnosis_of(stage, about, course, conclusion)


def quadratic(solution: Solution, names: Sequence[str], **_: Any) -> tuple[Estimate, ...]:
    """Intervals of 1.96 standard deviations of the coordinates, within the plausible range."""
    where, made = solution.problem.where, []
    for j, parameter in enumerate(where.parameters):
        if parameter.name in names:
            scale = max(solution.cost / solution.problem.dataset.samples, 1.0)
            half = 1.96 * math.sqrt(max(float(solution.covariance[j, j]), 0.0) * scale)
            ends = np.clip([solution.x[j] - half, solution.x[j] + half], where.lower[j], where.upper[j])
            low, high = sorted(value_at(parameter, float(end)) for end in ends)
            made.append(Estimate(parameter, value_at(parameter, float(solution.x[j])), None, (low, high), True))
    return tuple(made)


def trial_of(before: FittedModel, after: FittedModel, names: tuple[str, ...] = ()) -> Trial:
    names = names or tuple(name for name in after.names if name not in before.names)
    return Trial(names, after, before.cost - after.cost, 0.9, NOISE, 20.0, 20.0, "")


def verdict_of(
    first: float, final: float, named: bool, left: SparseModel | None = None, is_better_smooth: bool = False
) -> tuple[str, tuple[str, ...], tuple[str, ...], bool]:
    """Verdict, effects, near ones, and whether something stays, where validation runs are as those that were fitted."""
    about = data()
    calibrated = fit(about, first, first)
    last = fit(about, final, final, [creep(about)]) if named else calibrated
    found = judged(about, calibrated, last, left, is_better_smooth=is_better_smooth)
    return found.verdict, tuple(e.name for e in found.effects), tuple(found.possible_effects), bool(found.remainder)


#: Mean squares, in those of the noise; and smooth functions that explain what is there, or hardly move anything.
LITTLE, MUCH = 1.05, 1000.0
SMOOTH, FAINT = sparse_model(500.0, NOISE, position=400.0), sparse_model(500.0, 0.2 * NOISE, position=400.0)
#: Of `MUCH` an effect leaves this much where it explains `LARGE` times what it leaves.
LIMIT = (MUCH - 1) / (1 + LARGE)


@pytest.mark.parametrize(
    ("task", "expected"),
    [
        ((LITTLE, LITTLE, False), ("nothing-missing", (), (), False)),
        ((MUCH, MUCH, False), ("unknown", (), (), True)),
        ((MUCH, LITTLE, True), ("effects-found", ("creep",), (), False)),
        # Something remains: the effect explains much more, or not.
        ((MUCH, 1 + 0.95 * LIMIT, True), ("effects-found", ("creep",), (), True)),
        ((MUCH, 1 + 1.05 * LIMIT, True), ("unknown", (), ("creep",), True)),
        # What remains may be noise, but is more than half of what the effect explains; of this it is less.
        ((1.20, 1.07, True), ("unknown", (), ("creep",), True)),
        ((1.24, 1.07, True), ("effects-found", ("creep",), (), False)),
        # Smooth functions would explain more in the place of the effect; where only noise remains nobody asks.
        ((MUCH, 1 + 0.95 * LIMIT, True, None, True), ("unknown", (), ("creep",), True)),
        ((MUCH, LITTLE, True, None, True), ("effects-found", ("creep",), (), False)),
        # Nothing stands out of the noise, but smooth functions explain something; too little of it to matter.
        ((LITTLE, LITTLE, False, SMOOTH), ("unknown", (), (), True)),
        ((LITTLE, LITTLE, False, FAINT), ("nothing-missing", (), (), False)),
        ((LITTLE, LITTLE, False, replace(SMOOTH, held_gain=-1.0)), ("nothing-missing", (), (), False)),
    ],
)
def test_verdicts(task: tuple[Any, ...], expected: tuple[Any, ...]) -> None:
    assert verdict_of(*task) == expected


def test_what_remains_beside_a_named_effect_is_stated() -> None:
    """The root of 100 noises less one, above the noise; nothing where the model is adequate."""
    about = data()
    first = fit(about, MUCH, MUCH)
    found = judged(about, first, fit(about, 100.0, 100.0, [creep(about)]))
    assert found.verdict == "effects-found"
    assert found.remainder_rms == pytest.approx(math.sqrt(99) * NOISE)
    assert judged(about, first, fit(about, added=[creep(about)])).remainder_rms == 0.0


@pytest.mark.parametrize(("kept", "is_said"), [(3.9, False), (5.0, True)])
def test_a_residual_twice_the_noise_that_counts_as_noise_is_explained(kept: float, is_said: bool) -> None:
    """The noise is known from two values alone; in squares twice the noise is four."""
    about = data(dof=1.0)
    found = judged(about, fit(about, MUCH, MUCH), fit(about, kept, kept, [creep(about)]))
    assert (found.verdict, found.remainder_rms) == ("effects-found", 0.0)
    assert (" 2.2 times the noise. It counts as noise" in diagnosis_text.verdict(found)) is is_said


def test_what_explains_all_but_with_numbers_at_their_ends_is_stated() -> None:
    """Then nothing is named, and the remainder is that of the calibrated model."""
    about = data()
    added = effect(about, "coulomb_friction")
    first, final = fit(about, MUCH, MUCH), fit(about, added=[added], moved={"coulomb_friction.level": 1e-3})
    assert final.at_bound() == ["coulomb_friction.level"]
    found = judged(about, first, final)
    assert (found.verdict, found.effects) == ("unknown", ())
    assert found.remainder_rms == pytest.approx(math.sqrt(MUCH - 1) * NOISE)
    assert found.remainder == "31.6 times the noise remains"


def test_of_two_effects_the_first_is_named_where_the_second_explains_little() -> None:
    about = data()
    one, other = creep(about), effect(about, "quadratic_stiffness")
    first, second = fit(about, MUCH, MUCH), fit(about, 100.0, 100.0, [one])
    # Both explain much beside what remains; the second does not; neither does.
    for after, names in ((20.0, 2), (60.0, 1), (99.0, 1)):
        found = concluded(about, course_of(first, second, fit(about, after, after, [one, other])))
        assert (found.verdict, len(found.effects)) == ("effects-found", names)
        assert tuple(found.possible_effects) == ("creep", "quadratic_stiffness")[names:]
        assert [rung.label for rung in found.error_ladder][2:] == ["+ creep", "+ quadratic_stiffness"][:names]
    second = fit(about, 800.0, 800.0, [one])
    found = concluded(about, course_of(first, second, fit(about, 700.0, 700.0, [one, other])))
    assert found.verdict == "unknown"
    # Of mean squares: what each step takes, of what calibration leaves above the noise.
    shares = {"creep": (MUCH - 800) / (MUCH - 1), "quadratic_stiffness": 100 / (MUCH - 1)}
    assert found.possible_effects == pytest.approx(shares)


@pytest.mark.parametrize(("tests", "is_said"), [(1.01, False), (1.5, True)])
def test_a_calibration_that_makes_test_runs_worse_is_a_doubt(tests: float, is_said: bool) -> None:
    """Mean squares of test runs, in those of the noise; one in a hundred is less than the factor 1.02 in rms."""
    about = data()
    unseen = replace(about.runs[-1], name="unseen", role="test")
    noise = replace(about.noise, rms={**about.noise.rms, "unseen": NOISE})
    about = replace(about, runs=(*about.runs, unseen), noise=noise)
    nominal, calibrated = fit(about, 2.0, 2.0, tests=1.0), fit(about, 1.0, 1.0, tests=tests)
    found = concluded(about, replace(course_of(calibrated), nominal=nominal))
    assert ("makes the test runs worse" in found.confidence) is is_said
    alone = data()
    found = concluded(alone, replace(course_of(fit(alone, 1.0, 1.5)), nominal=fit(alone, 2.0, 1.0)))
    assert "test runs" not in found.confidence


def test_two_effects_of_one_step_are_named_together() -> None:
    """Whatever one of them would have explained alone."""
    about = data()
    one, other = creep(about), effect(about, "quadratic_stiffness")
    first = fit(about, MUCH, MUCH)
    tried = [trial_of(first, fit(about, 100.0, 100.0, [one]))]
    for after, names in ((60.0, ("creep", "quadratic_stiffness")), (500.0, ())):
        course = course_of(first, fit(about, after, after, [one, other]), tried=tried)
        assert [level.names for level in course.levels] == [(), ("creep", "quadratic_stiffness")]
        found = concluded(about, course)
        assert tuple(named.name for named in found.effects) == names
        assert tuple(found.possible_effects) == (() if names else ("creep", "quadratic_stiffness"))


def test_an_effect_at_the_end_of_what_is_plausible_is_not_named() -> None:
    about = data()
    low, high = next(p.plausible for p in effects.find("creep").parameters if p.name == "per_decade")
    first = fit(about, MUCH, MUCH)
    for value, verdict in ((0.5 * (low + high), "effects-found"), (high, "unknown")):
        for after in (LITTLE, 100.0):
            last = fit(about, after, after, [creep(about)], {"creep.per_decade": value})
            assert judged(about, first, last).verdict == verdict


@pytest.mark.parametrize("known", [True, False])
def test_a_residual_within_a_stated_tolerance_counts_as_none(known: bool) -> None:
    """Nine times the variance of the noise: three times it in all, the root of eight above it."""
    above = math.sqrt(8) if known else 3.0
    about = data(dof=math.inf if known else 0.0)
    one = fit(about, 9.0, 9.0)
    for share, verdict in ((1.02, "nothing-missing"), (0.98, "unknown")):
        asked = replace(about, tolerance=share * above * NOISE, is_asked=True)
        found = judged(asked, one, one)
        assert (found.verdict, found.effects) == (verdict, ())
        assert bool(found.remainder) is (verdict == "unknown")
    # What an effect leaves within it takes no part in whether that explains enough.
    less = fit(about, 4.0, 4.0, [creep(about)])
    rest = NOISE * math.sqrt(3 if known else 4)
    for share, verdict in ((1.02, "effects-found"), (0.98, "unknown")):
        asked = replace(about, tolerance=share * rest, is_asked=True)
        assert judged(asked, one, less).verdict == verdict
    # Nobody said what matters: then it is the noise, or what is usual where that is unknown.
    usual = replace(about, tolerance=1.02 * above * NOISE)
    assert judged(usual, one, one).verdict == ("unknown" if known else "nothing-missing")


def test_unknown_noise_is_said_and_never_weighed_against() -> None:
    """The guess is far too small: an effect leaves many times that much, and explains a large share all the same."""
    about = replace(data(dof=0.0), tolerance=NOISE)
    first = fit(about, MUCH, MUCH)
    for after, verdict in ((MUCH / (1.05 + LARGE), "effects-found"), (MUCH / (0.95 + LARGE), "unknown")):
        found = judged(about, first, fit(about, after, after, [creep(about)]))
        assert found.verdict == verdict
        assert "noise of these runs is unknown" in found.confidence
        assert "times the noise" not in found.remainder
    assert not judged(data(), first, first).confidence
    # Five and two variances of the guess: one remains above a noise that is known, two where it is not.
    for dof, verdict in ((math.inf, "effects-found"), (0.0, "unknown")):
        about = replace(data(dof=dof), tolerance=NOISE)
        assert judged(about, fit(about, 5.0, 5.0), fit(about, 2.0, 2.0, [creep(about)])).verdict == verdict


def test_errors_are_stated_of_test_runs_and_nothing_is_chosen_by_them() -> None:
    about = data()
    run = replace(about.runs[-1], name="unseen", role="test")
    noise = replace(about.noise, rms={**about.noise.rms, "unseen": NOISE})
    about = replace(about, runs=(*about.runs, run), noise=noise)
    calibrated = fit(about, MUCH, MUCH, tests=400.0)
    found = judged(about, calibrated, fit(about, LITTLE, LITTLE, [creep(about)], tests=100.0))
    assert [(rung.error / NOISE) ** 2 for rung in found.error_ladder] == pytest.approx([400, 400, 100])
    assert (found.verdict, found.remainder) == ("effects-found", "")
    assert found.error == pytest.approx(10 * NOISE)
    # However well the test run is predicted, it names nothing.
    assert judged(about, calibrated, fit(about, MUCH - 1, MUCH - 1, [creep(about)], tests=1.0)).verdict == "unknown"


def test_a_calibration_that_was_refused_is_said() -> None:
    about = data()
    first = fit(about, MUCH, MUCH)
    assert (
        "calibration makes the validation runs worse" in concluded(about, course_of(first, is_refused=True)).confidence
    )
    assert not concluded(about, course_of(first)).confidence


def test_what_stays_counts_wherever_it_stays() -> None:
    """On the validation runs, or on those that were fitted; both must be noise."""
    about = data()
    for seen, kept, verdict in ((1.0, 1.0, "nothing-missing"), (1.0, 1.5, "unknown"), (1.5, 1.0, "unknown")):
        one = fit(about, seen, kept)
        assert judged(about, one, one).verdict == verdict


@pytest.mark.parametrize("dof", [50.0, math.inf])
def test_the_less_is_known_of_the_noise_the_more_counts_as_noise(dof: float) -> None:
    """A level known from k samples is off by the root of 1 / 2k, its square by twice that; so is chance, from n."""
    about = data(dof=dof)
    for n, seen, kept in ((4000, 1.0, 0.0), (2000, 0.0, 1.0)):
        allowed = ADEQUATE + ERRORS * math.sqrt(2 / n + 2 / dof)
        for share, is_noise in ((0.99, True), (1.01, False)):
            more = share * allowed
            left = excess(about, fit(about, 1 + more * seen, 1 + more * kept))
            assert (left[0] <= left[1]) is is_noise
            assert left == pytest.approx((more, allowed))


def test_words_say_what_remains_and_what_it_looks_like() -> None:
    about = data()
    one = fit(about, 9.0, 9.0)
    left = sparse_model(10.0, 1e-6, **{"a": 1.0, "b": 5.0, "c": 2.0, "d": 0.5})
    assert judged(about, one, one, left).remainder.startswith("3 times the noise remains")
    assert judged(about, one, one, left).remainder.endswith("explain most: b, c, a")
    assert "no smooth function" in judged(about, one, one).remainder
    assert "whitened" not in judged(about, one, one).remainder
    coloured = ColouredNoise(Process(np.array([-0.9]), NOISE))
    correlated = replace(about, noise=replace(about.noise, whitening=coloured))
    assert "times the noise remains (whitened: " in judged(correlated, one, one, left).remainder


def test_a_ladder_and_shares_are_those_of_the_stands() -> None:
    about = data()
    found = judged(about, fit(about, 101.0, 101.0), fit(about, 2.0, 2.0, [creep(about)]))
    assert [rung.label for rung in found.error_ladder] == ["as designed", "recalibrated", "+ creep"]
    assert [(rung.error / NOISE) ** 2 for rung in found.error_ladder] == pytest.approx([101, 101, 2])
    assert found.effects[0].share == pytest.approx((101 - 2) / 100)
    assert found.noise_floor == pytest.approx(NOISE)
    assert found.error == pytest.approx(NOISE * math.sqrt(2))
    for value in (*found.effects[0].values, *found.calibration):
        assert value.interval[0] < value.value < value.interval[1]
    # Half of an interval is 1.96 standard deviations, wider where more than noise stays.
    gain = next(value for value in found.calibration if value.parameter.name == "gain")
    assert gain.interval[1] - gain.value == pytest.approx(1.96 * math.sqrt(2) * 1e-3 * about.axis.gain, rel=0.05)


def test_candidates_say_what_became_of_them() -> None:
    about = data()
    first, final = fit(about, MUCH, MUCH), fit(about, added=[creep(about)])
    alike = trial_of(first, final, ("thermal_expansion",))
    worse = trial_of(first, fit(about, 100.0, 100.0, [creep(about)]), ("thermal_drift",))
    refused = replace(alike, names=("sensor_drift",), reason="no more than chance gives")
    found = judged(about, first, final, alike=[alike, worse, refused])
    assert {tried.names: tried.outcome for tried in found.candidates} == {
        ("creep",): "added",
        ("thermal_expansion",): "these runs do not distinguish it from what was added",
        ("thermal_drift",): "explains less",
        ("sensor_drift",): "no more than chance gives",
    }


# --- numbers that moved beyond the prior -----------------------------------------------------------------------


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
    about = data(axis, **more)
    values = {name: axis.numbers[name] * ratio for name, ratio in moved.items()}
    one = fit(about, moved=values)
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
    about = data()
    one = fit(about, moved={name: about.axis.numbers[name] * ratio for name, ratio in moved.items()})
    found = judged(about, one, one)
    assert (found.verdict, found.effects, found.confusable) == ("nothing-missing", (), ())
    assert bool(found.conflicts) is is_said


@pytest.mark.parametrize(("times", "is_end_relevant", "verdict"), [
    (1.0, True, "unknown"), (1.0, False, "effects-found"), (2.0, True, "effects-found"),
])  # fmt: skip
def test_an_effect_is_not_named_where_the_gain_of_the_model_ends(
    times: float, is_end_relevant: bool, verdict: str
) -> None:
    """A tenth of the design's gain, the least that is plausible, leaves the motion to the effect.

    The design says nothing about its uncertainty.
    """
    about = replace(data(), known={})
    moved = {"gain": 0.1 * times * about.axis.gain}
    course = course_of(fit(about, MUCH, MUCH), fit(about, 0.1 * MUCH, 0.1 * MUCH, [creep(about)], moved))
    found = concluded(about, course, is_end_relevant=is_end_relevant)
    assert found.verdict == verdict
    assert ("creep" in found.possible_effects) is (verdict == "unknown")
    reason = "gain is at the end of what is plausible"
    assert found.refusals == ({"creep": reason} if verdict == "unknown" else {})


@pytest.mark.parametrize(
    ("name", "calibrated", "final", "verdict"),
    [
        ("gain", 1.0, 0.4, "unknown"),
        ("gain", 1.0, 0.6, "effects-found"),
        ("gain", 0.45, 0.4, "effects-found"),  # a wrong unit, rather than the effect
        ("natural_frequency", 1.0, 2.1, "unknown"),
        ("natural_frequency", 1.0, 1.9, "effects-found"),
        ("natural_frequency", 2.05, 2.1, "effects-found"),
    ],
)
def test_an_effect_is_not_named_that_moves_the_model_far_from_its_design(
    name: str, calibrated: float, final: float, verdict: str
) -> None:
    """Beyond a factor of two, where calibration alone needs none: friction as hysteresis with twice the frequency."""
    about = data()
    of_design = about.axis.numbers[name]
    course = course_of(
        fit(about, MUCH, MUCH, moved={name: calibrated * of_design}),
        fit(about, 0.1 * MUCH, 0.1 * MUCH, [creep(about)], {name: final * of_design}),
    )
    found = concluded(about, course)
    assert found.verdict == verdict
    assert ("creep" in found.possible_effects) is (verdict == "unknown")
    assert ("more than twice" in found.refusals.get("creep", "")) is (verdict == "unknown")


def test_an_interval_of_all_that_is_plausible_is_none() -> None:
    about = parameter_of(AxisDynamics("x", data().axis, 100.0), "damping_ratio")
    low, high = about.plausible
    for interval, text in (((low, high), "(not determined)"), ((0.019, 0.021), "(95 %: 0.01900 to 0.02100)")):
        said = diagnosis_text.quantity(Value(about, 0.02, interval), short=True)
        assert said.startswith("damping_ratio 0.02") and said.endswith(text)


@pytest.mark.parametrize(("share", "is_overstated"), [(0.2, True), (0.3, False)])
def test_a_residual_far_below_the_noise_tells_that_it_is_overstated(share: float, is_overstated: bool) -> None:
    """As of repeats of a command by two different loops; less than half of the noise in rms, without test runs."""
    about = data()
    first = fit(about, share, share)
    assert not about.observed("test") and about.observed("validate")
    assert ("noise, which is overstated" in judged(about, first, first).confidence) is is_overstated


@pytest.mark.parametrize(
    ("refused", "is_determined", "expected"),
    [
        ("", True, ""),
        (f"creep.per_decade {NOT_DETERMINED}", True, ""),
        ("", False, f"creep.per_decade {INCLUDES_NULL}"),
        ("no more than chance gives", True, "no more than chance gives"),
    ],
)
def test_an_added_effect_is_judged_by_the_interval_that_is_stated(
    refused: str, is_determined: bool, expected: str
) -> None:
    about = data()
    first, final = fit(about, MUCH, MUCH), fit(about, LITTLE, LITTLE, [creep(about)])
    trial = replace(trial_of(first, final), reason=refused)
    history = SelectionHistory(first, first, (), (Step(None, (trial,)),))
    kept: Any = lambda _, fit: fit if is_determined else first  # noqa: E731
    with mock.patch.object(add_effect, "drop_undetermined", kept):
        found = add_effect._fit_addition(mock.sentinel.task, history, creep(about))
    assert found == (final, expected)


def test_why_possible_effects_are_not_named_is_said() -> None:
    about = data()
    first = fit(about, MUCH, MUCH)
    found = judged(about, first, fit(about, 0.5 * MUCH, 0.5 * MUCH, [creep(about)]))
    assert found.refusals == {"creep": "less than twice what then remains is explained"}
    assert f"creep (50 %). It is not named, as {found.refusals['creep']}. To fit it" in diagnosis_text.possible(found)
    found = judged(about, first, fit(about, 0.01 * MUCH, 0.01 * MUCH, [creep(about)]), is_better_smooth=True)
    assert found.refusals == {"creep": SMOOTH_IS_BETTER}
    # Of two effects each has its own reason.
    levels = [
        fit(about, share * MUCH, share * MUCH, [creep(about), effect(about, "mains_hum")][:k])
        for k, share in enumerate((1, 0.01, 0.009))
    ]
    found = concluded(about, course_of(*levels), is_better_smooth=True)
    little = "less than twice what then remains is explained"
    assert found.refusals == {"mains_hum": little, "creep": SMOOTH_IS_BETTER}
    said = diagnosis_text.possible(found)
    assert f"Creep is not named, as {SMOOTH_IS_BETTER}. Mains hum is not named, as {little}. To fit each" in said
    # One that explains nothing of what the model is chosen by is none.
    found = judged(about, first, fit(about, 0.5 * MUCH, 2.0 * MUCH, [creep(about)]))
    assert (found.verdict, dict(found.possible_effects)) == ("unknown", {})


@pytest.mark.parametrize(("end", "verdict"), [(0, "unknown"), (1, "effects-found")])
def test_a_mode_that_no_run_shows_hides_no_effect(end: int, verdict: str) -> None:
    """The highest natural frequency says that the motion is quasi-static; the lowest one that the model is wrong."""
    about = data()
    parameters = case_of(StageModel({"x": about.axis}), about, map, str)[0].parameters()
    (ends,) = (p.plausible for p in parameters if p.name == "natural_frequency")
    moved = {"natural_frequency": ends[end]}
    course = course_of(fit(about, MUCH, MUCH), fit(about, 0.1 * MUCH, 0.1 * MUCH, [creep(about)], moved))
    assert concluded(about, course).verdict == verdict


def test_numbers_of_the_model_at_an_end_are_said() -> None:
    about = data()
    name = "damping_ratio"
    (ends,) = (
        p.plausible for p in case_of(StageModel({"x": about.axis}), about, map, str)[0].parameters() if p.name == name
    )
    for value, is_said in ((ends[1], True), (0.5 * ends[1], False)):
        one = fit(about, moved={name: value})
        assert ("damping ratio of the model ended at the limit" in judged(about, one, one).confidence) is is_said
    # In SI units a small gain is as near to zero as to its limits.
    about = replace(about, axis=replace(about.axis, gain=1e-10))
    for times, is_said in ((0.1, True), (2.0, False)):
        one = fit(about, moved={"gain": times * about.axis.gain})
        assert ("gain of the model ended at the limit" in judged(about, one, one).confidence) is is_said
    both = fit(about, moved={"gain": 0.1 * about.axis.gain, name: ends[1]})
    assert "gain and damping ratio of the model ended" in judged(about, both, both).confidence


@pytest.mark.parametrize("ratio", [2.32, 0.4])
def test_a_gain_that_no_calibration_explains_is_a_structural_error(ratio: float) -> None:
    about = data()
    one = fit(about, moved={"gain": ratio * about.axis.gain})
    found = judged(about, one, one)
    assert (found.verdict, found.effects) == ("nothing-missing", ())
    (words,) = found.conflicts
    assert f"{ratio:.2g} times that of the model" in words and "structure of the model" in words and "%" not in words


def test_nothing_is_implied_where_something_unknown_stays() -> None:
    about = data()
    one = fit(about, 9.0, 9.0, moved={"natural_frequency": 0.9 * about.axis.natural_frequency})
    found = judged(about, one, one)
    assert (found.verdict, found.effects) == ("unknown", ())
    assert len(found.conflicts) == 1


def test_runs_that_all_begin_late_share_a_delay() -> None:
    """Late by two samples where half a sample was expected; one alone is late by itself."""
    about = data()
    all_late = fit(about, moved={"one:trigger": 2.1e-3, "two:trigger": 1.9e-3})
    found = judged(about, all_late, all_late)
    assert [effect.name for effect in found.effects] == ["transport_delay"]
    assert found.effects[0].values[0].value == pytest.approx(2e-3)
    assert found.model.controller.delay == pytest.approx(2e-3)
    one_late = fit(about, moved={"one:trigger": 0.6e-3, "two:trigger": -0.2e-3})
    assert judged(about, one_late, one_late).verdict == "nothing-missing"


def test_a_gain_that_rises_with_a_falling_frequency_is_lost_stiffness() -> None:
    """k x = F and w^2 = k / m: of a fifth less stiffness both follow, and added mass would leave the gain alone."""
    about = data()
    moved = {"natural_frequency": AXIS.natural_frequency * math.sqrt(0.65), "gain": AXIS.gain / 0.65}
    softer = fit(about, moved=moved)
    found = judged(about, softer, softer)
    assert [effect.name for effect in found.effects] == ["stiffness_loss"] and not found.confusable
    assert found.effects[0].values[0].value == pytest.approx(0.35)
    low, _ = found.effects[0].values[0].interval
    assert 0.35 - low == pytest.approx(1.96 * 2 * 0.02 * 0.65, rel=0.05)  # the old frequency is known to 2 %
    heavier = fit(about, moved={"natural_frequency": moved["natural_frequency"]})
    assert judged(about, heavier, heavier).confusable == (("payload_mass", "stiffness_loss"),)


def with_parts(of: FittedModel, more: Mapping[int, float]) -> FittedModel:
    """The stand with Gaussian noise of variance one left, and jumps added to it at some samples."""
    rng = np.random.default_rng(0)
    parts = [rng.standard_normal(len(part)) for part in of.solution.residuals]
    for place, jump in more.items():
        parts[0][place] += jump
    return replace(of, solution=replace(of.solution, residuals=tuple(parts)))


def test_jumps_are_no_noise_however_few() -> None:
    about = data()
    calm, jumping = (with_parts(fit(about), more) for more in ({}, {100: 12.0, 700: -9.0, 1500: 10.0}))
    assert judged(about, calm, calm).verdict == "nothing-missing"
    found = judged(about, jumping, jumping)
    assert found.verdict == "unknown" and "with 3 sudden jumps" in found.remainder


def test_steps_of_readings_are_named_only_where_they_matter() -> None:
    """Rounding makes step / sqrt(12) rms: it is no answer to a residual far above that, nor below what was asked."""
    about = data()
    vars(about)["coarse_step"] = step = 10 * NOISE
    (steps,) = conflicts(about, fit(about))
    task: Any = None  # not used: there is nothing to fit
    with mock.patch.object(DiagnosisData, "known_noise", lambda *_: 0.0):
        assert explains(about, task, fit(about, kept=(step / NOISE) ** 2 / 12 / (1.1 * LARGE)), steps)
        assert not explains(about, task, fit(about, kept=(step / NOISE) ** 2 / 12), steps)
    asked = replace(about, tolerance=step, is_asked=True)
    vars(asked)["coarse_step"] = step
    assert conflicts(asked, fit(asked))[0].named is None


def test_rounding_of_slow_motion_is_coloured_noise() -> None:
    """Sawteeth of some ten samples: whitened by what a prediction tells, they are independent numbers again."""
    step, n = 1e-7, 4000
    rng = np.random.default_rng(2)
    motion = 2e-6 * np.sin(2 * np.pi * np.arange(n) / 2500.0)
    noisy = motion + 1e-8 * rng.standard_normal(n)
    errors = step * np.round(noisy / step) - motion
    white = rounding_noise(motion, 1e-8, step).whiten(errors[:, None])[:, 0]
    correlations = [float(e[1:] @ e[:-1] / (e @ e)) for e in (errors, white)]
    assert correlations[0] > 0.3 and abs(correlations[1]) < 0.1
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.15)


# --- candidates and features ----------------------------------------------------------------------------------------


def test_candidates_are_the_catalogue_without_what_the_axis_has() -> None:
    model = AxisDynamics("x", replace(AXIS, effects={"creep": {"per_decade": 0.01, "t0": 0.1}}), 100.0)
    names = [candidate.name for candidate in candidates(model)]
    absent = {"creep", "payload_mass", "stiffness_loss", "sensor_gain", "sensor_delay", "quantisation"}
    assert set(effects.names()) - set(names) == absent
    assert len(names) == len(set(names))
    assert "payload_mass" in [c.name for c in candidates(model, loaded=True)]
    assert {*names} - {c.name for c in candidates(model, swings=False)} == {"base_motion"}  # a force of inertia
    filtered = replace(model, axis=replace(model.axis, driver=replace(model.axis.driver, bandwidth=500.0)))
    assert set(names) - {c.name for c in candidates(filtered)} == {"driver_bandwidth"}


def test_friction_may_be_as_large_as_the_stroke() -> None:
    """A drive whose friction holds back half of its command still moves."""
    model = AxisDynamics("x", AXIS, 100.0)
    friction = next(each for each in candidates(model) if each.name == "coulomb_friction")
    level = next(p for p in friction.add(model).parameters() if p.name == friction.strength)
    assert level.plausible == pytest.approx((0.0, model.stroke))


def test_a_periodic_effect_shows_by_its_line() -> None:
    """A phase and an amplitude of each run: a cosine and a sine at the frequency that the model has."""
    model = AxisDynamics("x", AXIS, 100.0)
    by_name = {candidate.name: candidate for candidate in candidates(model)}
    assert {name for name, each in by_name.items() if each.trace} == {"base_motion", "mains_hum"}
    shaken = by_name["base_motion"]
    t = 3.0 + 1e-3 * np.arange(500)
    run = Run("shaken", t, {"u": 0 * t, "x": 0 * t}, {"u": "V", "x": "m"})
    assert shaken.trace is not None
    columns = shaken.trace(shaken.add(model).replace({"base_motion.frequency": 37.0}), run)
    line = 2e-9 * np.sin(2 * math.pi * 37.0 * t + 0.7)
    assert columns is not None
    assert columns @ np.linalg.lstsq(columns, line)[0] == pytest.approx(line, abs=1e-15)


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
    assert prepare(stage, [quiet, monitored], "x", None).is_at_stack
    assert not prepare(stage, [quiet, sent, monitored], "x", None).is_at_stack
    with pytest.raises(InputError, match="driver_slew: acts ahead of the stack"):
        add_effect.add(stage, "driver_slew", [quiet, monitored])
    wrong = replace(sent, columns={**sent.columns, "x": 1e3 * sent.columns["x"]})
    with pytest.raises(InputError, match=r"sent:identify: column x = .* a thousand times"):
        prepare(stage, [quiet, wrong], "x", None)


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
        is_delay = candidate.strength in ("controller.delay", "sensor.delay")
        assert candidate.has_own_trials is (is_delay or math.isinf(numbers[candidate.strength].null or 0.0))
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
    made = BasisFunctions(model)(run_of("run", command, predicted, "identify"), predicted)
    x = predicted / (1.98e-6 * 100)
    assert made["reading: position^2"] == pytest.approx(x**2)
    assert made["reading: position beyond 40 %"] == pytest.approx(np.maximum(x - 0.4, 0))
    # In stroke times angular frequency; differences of samples lag by (2 pi 5 T)^2 / 6 at most.
    v = np.cos(2 * math.pi * 5 * t[1:-1]) * (1e-4 / 1.98e-4) * 5 / 118.3
    assert made["reading: velocity"][1:-1] == pytest.approx(v, rel=1e-3, abs=1e-6)
    since = np.where(t < 0.0995, t, np.where(t < 0.2995, t - 0.1, t - 0.3))
    assert made["reading: log of time since a step"] == pytest.approx(np.log10(1 + since / 0.01), abs=1e-9)
    assert all(values.shape == t.shape and np.isfinite(values).all() for values in made.values())


def test_a_force_is_seen_through_the_mode() -> None:
    """A force that waits between samples, by another program's integration; over the stiffness it is one at rest."""
    rng = np.random.default_rng(0)
    command = np.repeat(rng.uniform(0, 100, 8), 50)
    made = BasisFunctions(AxisDynamics("x", AXIS, 100.0))(run_of("run", command, command, "identify"), np.zeros(400))
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
    assert found.error < 1.15 * found.noise_floor < found.error_ladder[1].error
    assert found.remainder == ""


@cache
def of_noise() -> Diagnosis:
    """A stage with hysteresis that is as it was thought to be, but for its numbers; noise that remembers 0.95."""
    true, off = acting(bouc_wen=LOOP), acting(bouc_wen={**LOOP, "a": 0.93 * LOOP["a"], "b": 1.08 * LOOP["b"]})
    return diagnose(thought(off), recorded(true, 1, rho=0.95), threads=1)


def test_nothing_is_named_in_coloured_noise() -> None:
    found = of_noise()
    assert (found.verdict, found.effects, found.remainder) == ("nothing-missing", (), "")
    assert not found.possible_effects
    assert [rung.label for rung in found.error_ladder] == ["as designed, offsets alone", "as designed", "recalibrated"]
    assert found.error_ladder[2].error < 0.5 * found.error_ladder[1].error


def test_the_first_line_of_the_ladder_is_the_model_with_offsets_alone() -> None:
    (kept,) = [run for run in of_noise().runs if run.role == "validate"]
    model = AxisDynamics("x", of_noise().before.axes["x"], 100.0, tolerance=1e-7)
    left = kept.measured() - model.predict(kept)
    alone, nominal, *_ = of_noise().error_ladder
    assert alone.error == pytest.approx(float(np.std(left)), rel=1e-3)
    assert nominal.error < 0.8 * alone.error  # hysteresis came from elsewhere


def with_test_run(wrong: float) -> Diagnosis:
    """Creep is hidden; the reading of the test run is wrong by a sine of some size."""
    axis = acting(creep={"per_decade": 0.02, "t0": 0.1})
    runs, unseen = recorded(axis, 1, n=600), recorded(axis, 5, n=600)[-1]
    reading = unseen.columns["x"] + wrong * np.sin(2 * math.pi * 7 * unseen.time)
    unseen = replace(unseen, name="unseen", role="test", columns={**unseen.columns, "x": reading})
    return diagnose(thought(AXIS), [*runs, unseen], threads=1)


def test_a_test_run_changes_no_number_and_the_ladder_is_its_own() -> None:
    right, wrong = with_test_run(0.0), with_test_run(1e-5)
    for one, other in zip((*right.effects, right), (*wrong.effects, wrong), strict=True):
        values = [each.values if hasattr(each, "values") else each.calibration for each in (one, other)]
        assert [v.value for v in values[0]] == pytest.approx([v.value for v in values[1]], rel=1e-6)
    assert [(t.names, t.outcome) for t in right.candidates] == [(t.names, t.outcome) for t in wrong.candidates]
    assert right.verdict == wrong.verdict == "effects-found"
    assert right.error_ladder[-1].error < 1.2 * right.noise_floor
    assert wrong.error_ladder[-1].error == pytest.approx(
        math.hypot(right.error_ladder[-1].error, 1e-5 / math.sqrt(2)), rel=0.05
    )


def test_rounding_asks_nothing_of_test_runs() -> None:
    """Readings in steps of five times the noise: what rounding makes of test runs is nobody's to know in a search."""
    step = 2e-6
    runs = recorded(AXIS, 1, sensor=lambda y: y)
    runs += [replace(recorded(AXIS, 2)[-1], name="unseen", role="test")]
    coarse = [replace(r, columns={**r.columns, "x": step * np.round(r.columns["x"] / step)}) for r in runs]
    found = diagnose(thought(AXIS), coarse, threads=1)
    assert [named.name for named in found.effects] == ["quantisation"]
    assert found.error_ladder[-1].error == pytest.approx(math.hypot(FLOOR, step / math.sqrt(12)), rel=0.15)


def test_a_calibration_that_makes_validation_worse_is_refused() -> None:
    """The fitted runs have another gain than the validation run, which is as it was thought to be."""
    runs = [run for run in recorded(replace(AXIS, gain=1.4 * AXIS.gain), 1) if run.role == "identify"]
    runs += [run for run in recorded(replace(AXIS, gain=1.06 * AXIS.gain), 1) if run.role == "validate"]
    found = diagnose(thought(AXIS), runs, threads=1)
    assert "calibration makes the validation runs worse" in found.confidence
    errors = {rung.label: rung.error for rung in found.error_ladder}
    assert errors["recalibrated"] == pytest.approx(errors["as designed"], rel=1e-3)
    assert found.verdict == "unknown"
    assert found.model.axes["x"].gain == pytest.approx(thought(AXIS).axes["x"].gain)


def slow(axis: AxisModel) -> list[Run]:
    """Smooth strokes of 0.5 to 2 Hz: at 2 Hz of 118 the mode changes a response by 3 parts in 10 000 at all."""
    rng, t, made = np.random.default_rng(3), PERIOD * np.arange(2000), []
    for name, frequency in (("half", 0.5), ("one", 1.0), ("two", 2.0)):
        command = np.where(t < 0.2, 0.0, 50 - 50 * np.cos(2 * math.pi * frequency * (t - 0.2)))
        run = run_of(name, command, np.zeros(len(t)), "validate" if name == "one" else "identify")
        reading = AxisDynamics("x", axis, 100.0, tolerance=1e-6).predict(run) + FLOOR * rng.standard_normal(len(t))
        made.append(replace(run, columns={"u": command, "x": reading}))
    return made


def test_numbers_that_runs_do_not_show_keep_their_design_values() -> None:
    model = thought(AXIS)
    found = diagnose(model, slow(AXIS), threads=1)
    assert found.verdict == "nothing-missing"
    assert set(found.undetermined) == {"natural_frequency", "damping_ratio"}
    assert [value.parameter.name for value in found.calibration] == ["gain"]
    after, before = found.model.axes["x"], model.axes["x"]
    assert (after.natural_frequency, after.damping_ratio) == (before.natural_frequency, before.damping_ratio)
    assert after.gain == pytest.approx(AXIS.gain, rel=1e-3)
    assert of_noise().undetermined == ()


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
    assert found.error < 1.15 * found.noise_floor
