"""Whether a number beyond its prior explains much beside what remains: sums of columns, by linear algebra."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexdesign.core.model import Parameter
from flexdesign.diagnosis.effect_selection import prior_conflicts
from flexdesign.diagnosis.effect_selection.prior_conflicts import (
    LARGE,
    Conflict,
    _delay_shift,
    conflicts,
    explains,
    shown,
)
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import DELAY, TRIGGER
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import NAMES, N, Shape, Sum, base, column, offset
from tests.estimation.toys import Array, Run, parameter

SIGMA, HELD, EVERY = 0.1, ("kept", "apart"), (*NAMES, "kept", "apart")
#: What is known of the number p, whose true value is another.
MIDDLE, SPREAD, TRUE = 1.0, 0.05, 2.0


@dataclass(frozen=True, eq=False)
class Staged(Sum):
    """A sum whose runs each begin late, by numbers of their own."""

    @property
    def apart(self) -> tuple[str, ...]:
        return EVERY

    def replace(self, values: Mapping[str, float]) -> Staged:
        return Staged(self.shapes, super().replace(values).every)

    def plus(self, shape: Shape, *more: Parameter) -> Staged:
        return Staged((*self.shapes, shape), (*self.every, *more))


def unknown(run: Any) -> Array:
    """What no number explains: of mean square one, and normal to all that is fitted."""
    others = np.column_stack([np.ones(N), *(column(run, name) for name in ("p", "q", "late"))])
    left = column(run, "unknown") - others @ np.linalg.lstsq(others, column(run, "unknown"))[0]
    return np.asarray(left / np.sqrt(np.mean(left**2)))


def case_of(
    model: Sum, truth: Mapping[str, float], rest: float, known: Mapping[str, tuple[float, float]]
) -> EstimationTask:
    rng, true = np.random.default_rng(0), model.replace(truth)

    def dataset(names: tuple[str, ...]) -> Dataset:
        blank = [Run(name, np.arange(N) / N, None) for name in names]
        noise = [SIGMA * rng.standard_normal(N) for _ in names]
        made = [
            dataclasses.replace(run, data=true.predict(run) + rest * unknown(run) + e)
            for run, e in zip(blank, noise, strict=True)
        ]
        return Dataset(made, ColouredNoise(Process.white(SIGMA)), offset)

    return EstimationTask(dataset(NAMES), dataset(HELD), ("p", "q"), lambda _: known, lambda _: model, 1e-3)


def data(known: Mapping[str, tuple[float, float]]) -> Any:
    """What is asked of a data set: the prior, and the error of the validation runs with its noise."""
    return SimpleNamespace(known=known, error=lambda fit: fit.rms(HELD), known_noise=lambda _: SIGMA, selecting=())


def conflict(number: str) -> Conflict:
    return Conflict("moved", (), None, lambda model: model, number)


def final(task: EstimationTask, model: Sum) -> FittedModel:
    found = fit_model(task, model)
    assert found is not None
    return found


def error_of(task: EstimationTask, held: float | None) -> float:
    """Mean square on the validation runs where q, and p if it is not held, is fitted to the others, offsets aside."""

    def centred(run: Any, values: Array) -> Array:
        return np.asarray(values - np.mean(values))

    def stacked(dataset: Dataset, name: str) -> Array:
        runs: list[Any] = [record.observation for record in dataset.records]
        return np.concatenate([centred(r, r.data if name == "data" else column(r, name)) for r in runs])

    names = ["q"] if held is not None else ["p", "q"]
    left, new = (stacked(dataset, "data") for dataset in (task.identify, task.validate))
    if held is not None:
        left, new = (d - held * stacked(s, "p") for d, s in ((left, task.identify), (new, task.validate)))
    amounts = np.linalg.lstsq(np.column_stack([stacked(task.identify, n) for n in names]), left)[0]
    return float(np.mean((new - np.column_stack([stacked(task.validate, n) for n in names]) @ amounts) ** 2))


@pytest.mark.parametrize("rest", [0.0, 0.3, 0.6, 0.8, 1.2])
def test_a_number_beyond_its_prior_must_explain_much_beside_what_remains(rest: float) -> None:
    """Held at its prior it leaves the square of its move more, beside the square of the remainder."""
    known = {"p": (MIDDLE, SPREAD)}
    model = base("p", "q")
    task = case_of(model, {"p": TRUE, "q": -1.0}, rest, known)
    # In the fit itself the number is free of its prior, as strong data make it.
    free = dataclasses.replace(task, known=lambda _: {})
    after, before = error_of(task, None), error_of(task, MIDDLE)
    ratio = (before - after) / max(after - SIGMA**2, 1e-300)
    assert not 0.9 * LARGE < ratio < 1.1 * LARGE  # near the limit the fit's own tolerance would decide
    assert explains(data(known), task, final(free, model), conflict("p")) is (ratio > LARGE)
    assert (ratio > LARGE) is (rest < 0.65)


@pytest.mark.parametrize(
    ("damping_ratio", "is_done", "is_payload"),
    [(0.05, False, True), (0.35, False, True), (0.6, False, False), (0.6, True, True)],
)
def test_no_payload_and_no_soft_support_overdamp_a_mode(damping_ratio: float, is_done: bool, is_payload: bool) -> None:
    """At half of the frequency the ratio c / (2 sqrt(k m)) is half with more mass, and twice with less stiffness.

    It is known to be 0.05 within as much: 0.35 is 0.175 for the stiffness of the design, 2.5 standard deviations off.
    """
    design = AxisModel(30.0, 0.05, 1e-6)
    own = {"natural_frequency": 15.0, "damping_ratio": damping_ratio}
    parameters = [parameter(name, value, 0.01 * value, 100 * value) for name, value in own.items()]
    where = SimpleNamespace(names=[*own], parameters=parameters, known={}, values=lambda _: own)
    solution = SimpleNamespace(
        problem=SimpleNamespace(where=where), x=np.array([*own.values()]), covariance=np.diag([1e-6, 1e-8])
    )
    axis = dataclasses.replace(design, **own)
    fit: Any = SimpleNamespace(
        model=AxisDynamics("x", axis), solution=solution, names=(), effects=(), half_width=lambda j: 1e-3
    )
    known = {"natural_frequency": (30.0, 3.0), "damping_ratio": (0.05, 0.05)}
    about: Any = SimpleNamespace(
        known=known,
        axis=design,
        is_loaded=False,
        coarse_step=None,
        error=lambda _: 1.0,
        known_noise=lambda _: 0.0,
        selecting=(),
    )
    found = conflicts(about, fit)
    assert [each.number for each in found] == [*own][: 1 + (damping_ratio > 0.2)]
    if is_done or not is_payload:
        nothing: Any = None
        beyond, implied = shown(about, nothing, fit, found, is_done=is_done)
        assert beyond == found
        assert [each.group[0] for each in implied] == ["payload_mass"] * is_payload
    else:  # whether it explains enough then decides
        assert not any(each.is_overdamped for each in found)


@pytest.mark.parametrize(("ratio", "is_much"), [(0.9, False), (1.1, True)])
def test_what_was_read_off_the_recordings_needs_no_fit_and_must_matter(ratio: float, is_much: bool) -> None:
    """Its mean square is compared with that of the residual above the noise, which is 3 by construction."""
    residual: Any = SimpleNamespace(
        error=lambda _: math.hypot(SIGMA, math.sqrt(3.0)), known_noise=lambda _: SIGMA, selecting=()
    )
    nothing: Any = None
    seen = dataclasses.replace(conflict(""), rms=math.sqrt(ratio * LARGE * 3.0))
    assert explains(residual, nothing, nothing, seen) is is_much


def test_where_the_model_cannot_be_simulated_at_the_prior_the_number_explains_all() -> None:
    known = {"p": (MIDDLE, SPREAD)}
    model = base("p", "q").plus(lambda v, run: np.full(N, np.nan if v["p"] == MIDDLE else 0.0))
    task = dataclasses.replace(case_of(base("p", "q"), {"p": TRUE}, 1.2, known), known=lambda _: {})
    assert explains(data(known), task, final(task, model.replace({"p": 1.9})), conflict("p"))


@pytest.mark.parametrize(("rest", "is_much"), [(0.3, True), (1.2, False)])
def test_runs_that_began_late_are_held_within_one_standard_deviation(rest: float, is_much: bool) -> None:
    """All of them began ten standard deviations late; nine of these are taken from the fit."""
    sigma, late = 0.1, 1.0
    own = [parameter(f"{n}:{TRIGGER}", 0.0, -9.0, 9.0, run=n) for n in EVERY]
    model = Staged().plus(lambda v, run: v["p"] * column(run, "p") + v["q"] * column(run, "q"), *base("p", "q").every)
    model = model.plus(lambda v, run: v[f"{run.name}:{TRIGGER}"] * column(run, "late"), *own)
    known = {p.name: (0.0, sigma) for p in own}
    task = case_of(model, {"p": TRUE, "q": -1.0, **{p.name: late for p in own}}, rest, known)
    fit = final(task, model)
    # Of a column of that variance all but one standard deviation is lost.
    variance = np.mean([np.var(column(record.observation, "late")) for record in task.validate.records])
    remains = data(known).error(fit) ** 2 - SIGMA**2
    assert bool((late - sigma) ** 2 * variance > LARGE * remains) is is_much
    assert explains(data(known), task, fit, conflict(TRIGGER)) is is_much
    # That columns are shifted is said where it explains much, or where nothing else is left to explain.
    moved = [conflict(TRIGGER), conflict("p")]
    assert shown(data(known), task, fit, moved, is_done=False)[0] == tuple(moved if is_much else moved[1:])
    assert shown(data(known), task, fit, moved, is_done=True) == (tuple(moved), [])
    # The case itself believes whatever the data say.
    values = {p.name: p.start or 0.0 for p in fit.model.parameters() if p.run}
    assert all(value == pytest.approx(late, abs=0.1) for value in values.values())


@pytest.mark.parametrize("between", ["hold", "linear"])
@pytest.mark.parametrize(("late", "said"), [(1.0, "late"), (-1.0, "early"), (0.0, "")])
def test_runs_that_all_began_late_have_a_delay_and_early_ones_shifted_columns(
    late: float, said: str, between: str
) -> None:
    """A command that was not held acts earlier than one that was: then what is stated may be wrong as well."""
    own = [parameter(f"{n}:{TRIGGER}", 0.0, -9.0, 9.0, run=n) for n in EVERY]
    model = Staged().plus(lambda v, run: v["p"] * column(run, "p") + v["q"] * column(run, "q"), *base("p", "q").every)
    model = model.plus(lambda v, run: v[DELAY] + 0.0 * column(run, "p"), parameter(DELAY, 0.0, 0.0, 9.0))
    model = model.plus(lambda v, run: v[f"{run.name}:{TRIGGER}"] * column(run, "late"), *own)
    truth = {"p": TRUE, "q": -1.0, **{p.name: late for p in own}}
    fit = final(case_of(model, truth, 0.0, {p.name: (0.0, 0.1) for p in own}), model)
    runs = [SimpleNamespace(between_samples=between, between_is_stated=True)]
    found = _delay_shift(SimpleNamespace(is_at_stack=False, runs=runs), fit)  # type: ignore[arg-type]
    assert (found is None) is (late == 0)
    if found is not None:
        assert float(found.words.split(" ms")[0].removeprefix(f"all runs began {said}, by ")) == pytest.approx(
            1e3, rel=0.05
        )
        assert found.group == (("transport_delay",) if late > 0 else ())
        assert ("shifted against each other" in found.words) is (late < 0)
        assert ("as `between_samples` says" in found.words) is (late < 0 and between == "hold")


@pytest.mark.parametrize(("most", "group"), [(9.0, ("transport_delay",)), (0.5, ())])
def test_runs_that_begin_as_late_as_is_plausible_name_no_delay(most: float, group: tuple[str, ...]) -> None:
    """They began later than that, by how much the fit cannot say."""
    own = [parameter(f"{n}:{TRIGGER}", 0.0, -most, most, run=n) for n in EVERY]
    model = Staged().plus(lambda v, run: v["p"] * column(run, "p") + v["q"] * column(run, "q"), *base("p", "q").every)
    model = model.plus(lambda v, run: v[DELAY] + 0.0 * column(run, "p"), parameter(DELAY, 0.0, 0.0, 9.0))
    model = model.plus(lambda v, run: v[f"{run.name}:{TRIGGER}"] * column(run, "late"), *own)
    truth = {"p": TRUE, "q": -1.0, **{p.name: 1.0 for p in own}}
    fit = final(case_of(model, truth, 0.0, {p.name: (0.0, 0.1) for p in own}), model)
    runs = [SimpleNamespace(between_samples="hold", between_is_stated=True)]
    found = _delay_shift(SimpleNamespace(is_at_stack=False, runs=runs), fit)  # type: ignore[arg-type]
    assert found is not None
    assert (found.group, found.named is None) == (group, not group)
    assert found.words.endswith("the most that is plausible") is (not group)


FRICTION = {"level": 1e-6, "presliding": 1e-6}
LOOP = {"a": 0.9e-6, "b": 0.02, "c": 0.0, "n": 1.0, "rest": 0.0}


@pytest.mark.parametrize(
    ("name", "values", "added", "found"),
    [
        ("coulomb_friction", FRICTION, True, ()),
        ("coulomb_friction", {**FRICTION, "level": 0.2e-6}, True, ("sensor_gain",)),
        ("coulomb_friction", FRICTION, False, ("sensor_gain",)),
        ("bouc_wen", LOOP, True, ()),
        ("bouc_wen", {**LOOP, "a": 0.1e-6}, True, ("sensor_gain",)),
        ("bouc_wen", {**LOOP, "a": 1.4e-6}, True, ()),  # the gain of the design is that of the range, between both
        ("bouc_wen", LOOP, False, ("sensor_gain",)),
    ],
)
def test_a_gain_that_an_added_effect_makes_up_for_is_no_conflict(
    name: str, values: Mapping[str, float], added: bool, found: tuple[str, ...]
) -> None:
    """Friction with half of the stiffness, or a loop that holds half of the gain back, unless the design had it."""
    design = AxisModel(30.0, 0.02, 1e-6)
    own = {"natural_frequency": 30.0 / math.sqrt(2), "gain": 1.9e-6}
    axis = dataclasses.replace(design, **own, effects={name: values})
    parameters = [parameter(number, value, 0.01 * value, 100 * value) for number, value in own.items()]
    names = [p.name for p in parameters]
    where = SimpleNamespace(names=names, parameters=parameters, known={}, values=lambda _: own)
    problem = SimpleNamespace(where=where)
    solution = SimpleNamespace(problem=problem, x=np.array([*own.values()]), covariance=np.diag([1e-6, 1e-18]))
    fit: Any = SimpleNamespace(
        model=AxisDynamics("x", axis),
        solution=solution,
        discrepancy=1.0,
        names=(name,) if added else (),
        half_width=lambda j: 1.96 * math.sqrt(solution.covariance[j, j]),
    )
    about: Any = SimpleNamespace(
        known={"gain": (1e-6, 0.1e-6)}, axis=design, is_loaded=False, is_at_stack=False, coarse_step=None
    )
    assert tuple(group for each in conflicts(about, fit) for group in each.group) == found


@pytest.mark.parametrize(
    ("gain", "error", "is_done", "is_named"),
    [(0.66e-6, 0.03e-6, False, True), (0.95e-6, 0.5e-6, False, False), (0.95e-6, 0.5e-6, True, True)],
)
def test_a_gain_that_is_within_its_prior_with_another_effect_is_not_named(
    gain: float, error: float, is_done: bool, is_named: bool
) -> None:
    """A third of the gain is missing, unless friction is in the model: 5 % less, which it does not determine."""
    design = AxisModel(30.0, 0.02, 1e-6)

    def fit(gain: float, error: float, *names: str) -> Any:
        (own,) = (parameter("gain", gain, 0.01 * gain, 100 * gain),)
        where = SimpleNamespace(names=["gain"], parameters=[own], known={}, values=lambda _: {"gain": gain})
        solution = SimpleNamespace(problem=SimpleNamespace(where=where), x=np.array([gain]), covariance=np.eye(1))
        model = AxisDynamics("x", dataclasses.replace(design, gain=gain))
        return SimpleNamespace(model=model, solution=solution, names=names, effects=(), half_width=lambda j: error)

    about: Any = SimpleNamespace(
        known={"gain": (1e-6, 0.01e-6)},
        axis=design,
        is_loaded=False,
        is_at_stack=False,
        coarse_step=None,
        error=lambda _: 1.0,
        known_noise=lambda _: 1.0,  # so that any change explains much
    )
    alone, nothing = fit(0.66e-6, 0.03e-6), SimpleNamespace(free=("gain",))
    found = conflicts(about, alone)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prior_conflicts, "explains", lambda *_: True)
        beyond, implied = shown(
            about,
            nothing,
            alone,
            found,
            is_done=is_done,
            others=[fit(gain, error, "coulomb_friction")],  # type: ignore[arg-type]
        )
    assert len(beyond) == 1
    assert [each.named.name for each in implied if each.named] == ["sensor_gain"] * is_named
    assert beyond[0].words.endswith("but not with coulomb friction") is not is_named
