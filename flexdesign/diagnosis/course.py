"""Diagnosis of one axis: calibrate, add what earns its place, and judge whether that is all.

First the numbers of the model itself are fitted, what finite elements know within its uncertainty, so that no effect is
blamed for a stiffness that is one percent off. Then effects are added while they earn their place, rivals are tried in
their stead, and what is left is laid beside the noise. Only where nothing is left, or where the effects explain more
than any smooth function of position, velocity and voltage could, are they named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from flexdesign.diagnosis import conflicts, periodic, rounding
from flexdesign.diagnosis.beginning import (
    Beginning,
    at_rest,
    begins_otherwise,
    begun_like,
    in_time,
    in_tune,
    known_of_start,
)
from flexdesign.diagnosis.candidates import candidates
from flexdesign.diagnosis.features import Features
from flexdesign.diagnosis.findings import Diagnosis
from flexdesign.diagnosis.judgement import conclude
from flexdesign.dynamics.axis_choice import choose_axis
from flexdesign.dynamics.axis_model import AxisDynamics
from flexdesign.dynamics.axis_run import is_at_stack, of_axis
from flexdesign.errors import InputError
from flexdesign.evidence.coloured import Coloured
from flexdesign.evidence.noise import Whitening
from flexdesign.evidence.rival import Rival, rival
from flexdesign.evidence.screening import Candidate
from flexdesign.evidence.selection import MOST, Step, backward, forward
from flexdesign.evidence.stand import Case, Stand, calibrated, fitted
from flexdesign.evidence.suite import Suite
from flexdesign.identification import HYSTERESIS, LINEAR, prior
from flexdesign.model import Model
from flexdesign.noise_floor import NoiseFloor, noise_floor
from flexdesign.runs import Run, split
from flexdesign.stage_model import AxisModel, StageModel

Array = NDArray[np.float64]
#: Error that a prediction may have, in shares of the noise; and in shares of the stroke, at least and at most.
EXACT, FINEST_TOLERANCE, COARSEST_TOLERANCE = 0.02, 1e-6, 1e-4
#: Most steps in a sample for fits, and steps for screening; no step of either is longer than this [s], which the
#: fastest relaxations of the catalogue bear.
STEPS, STEPS_SCREENING, LONGEST_STEP = 16, 4, 4e-4
#: An effect must move a held-out prediction by this share of the noise, or of the stroke if that is less.
OF_NOISE, OF_STROKE = 0.3, 5e-4
#: A run is no later than so many standard deviations, in the model as it was designed and where one record is all there
#: is: it would be late by many samples for the lag that the model lacks. Several that are all late share a delay.
BELIEVED = 4.0
#: A measured command is taken as smooth if that lowers the cost by so many times what a sample leaves on average.
SMOOTHER = 20.0
#: What is said of such a run.
SMOOTH = "the command is taken as smooth between its samples, which fits better than straight lines"
#: Where the noise is unknown, an effect must explain this share of what was unexplained (in squares).
LEAST = 1e-3
#: How often rounding is drawn, to learn what chance makes of it.
ROUNDED = 400
#: Decades of decay after which a mode has rung down.
RUNG_DOWN = 3.0


@dataclass(frozen=True, eq=False)
class Course:
    """How a diagnosis went: the stands from the designed model to the last effect.

    Parameters
    ----------
    designed, calibrated
        The model as it was, where runs began fitted; and with its own numbers fitted.
    stands
        With one more step of effects each.
    steps
        What was tried at each step, the last one without success.
    final
        The last stand, without effects that lost their place.
    agreed
        How many starts of the calibration ended at the best minimum.
    """

    designed: Stand
    calibrated: Stand
    stands: tuple[Stand, ...]
    steps: tuple[Step, ...]
    final: Stand
    agreed: int


@dataclass(frozen=True, eq=False)
class Setting:
    """What is diagnosed, with what, and how well things are known.

    Parameters
    ----------
    name, axis
        The axis.
    runs
        With roles, seen by this axis.
    noise
        The noise floor.
    tolerance
        What an effect must move [response].
    known
        What is known of the model's own numbers.
    """

    name: str
    axis: AxisModel
    runs: tuple[Run, ...]
    noise: NoiseFloor
    tolerance: float
    known: Mapping[str, tuple[float, float]]

    @property
    def is_loaded(self) -> bool:
        """Whether some runs carry a known mass on an axis whose mass is known."""
        return self.axis.mass is not None and any(run.payload for run in self.runs)

    @property
    def is_at_stack(self) -> bool:
        """Whether the voltage at the stack is known of every run that moves."""
        moving = [run for run in self.runs if np.ptp(run.command())]
        return bool(moving) and all(is_at_stack(run) for run in moving)

    @property
    def is_one_record(self) -> bool:
        """Whether no more than one run that moves teaches: then its own delay is not told from one that all have."""
        return sum(bool(np.ptp(run.command())) for run in self.of("identify")) < 2

    @cached_property
    def coarse_step(self) -> float | None:
        """The step of readings that come in whole steps larger than the noise [response]; else None."""
        return conflicts.coarse_step(self)

    def rounded(self, stand: Stand) -> Whitening | None:
        """Return the noise with the rounding of what is predicted, where readings come in coarse steps."""
        if self.coarse_step is None:
            return None
        return rounding.rounded({run.name: run for run in self.runs}, self.noise.whitening, stand, self.coarse_step)

    def drawn(self, stand: Stand) -> Iterator[Mapping[str, Array]]:
        """Yield what rounding makes of a prediction, where readings come in coarse steps; else nothing."""
        if self.coarse_step is None:
            return
        runs = {run.name: run for run in self.of("identify")}
        yield from rounding.errors(runs, self.noise.whitening, stand, self.coarse_step, ROUNDED)

    def of(self, role: str) -> list[Run]:
        """Return the runs of a role."""
        return [run for run in self.runs if run.role == role]

    @property
    def judging(self) -> list[str]:
        """Names of the runs that judge: those kept apart, or all if there are none."""
        return [run.name for run in self.of("validate") or self.runs]

    @property
    def floor(self) -> float:
        """Noise floor of the runs that judge [response]."""
        sizes = {run.name: np.isfinite(run.measured()).sum() for run in self.runs}
        squares = [self.noise.rms[name] ** 2 * sizes[name] for name in self.judging]
        return float(np.sqrt(sum(squares) / sum(sizes[name] for name in self.judging)))


def diagnose(
    model: StageModel,
    runs: Sequence[Run],
    *,
    axis: str | None = None,
    more: Sequence[str] = (),
    tolerance: float | None = None,
    threads: int = 2,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find which physical effects a stage model lacks.

    Parameters
    ----------
    model
        The stage model; its uncertainties say how far its numbers may move.
    runs
        What was recorded; where nobody chose roles, they are split.
    axis
        Which one; may be left out where model and runs leave no choice.
    more
        Paths of effects beside those of the catalogue.
    tolerance
        What an effect must at least move a held-out prediction, rms [response]; by default 0.05 % of the stroke or
        0.3 of the noise, whichever is less.
    threads
        Simulations at a time.
    seed
        Of the sample of starts.
    progress
        Told what is being done.

    Raises
    ------
    InputError
        If the axis is ambiguous, a run does not suit it, or no run may be fitted.
    """
    began = perf_counter()
    progress("reading the noise")
    setting = settle(model, runs, axis, tolerance)
    with simulating(threads) as each:
        setting = with_better_between(model, setting, each, progress)
        dynamics, case = case_of(model, setting, each, progress)

        def every(stand: Stand) -> tuple[Candidate, ...]:
            lines = periodic.frequencies(setting, stand)
            return candidates(dynamics, more, lines, loaded=setting.is_loaded, at_stack=setting.is_at_stack)

        case, course = search(setting, case, dynamics, every, seed)
        progress("looking at what is left")
        left = _rival(case, course.final)
        before = _rival(case, course.calibrated) if course.final.effects else left
    found = conclude(model, setting, course, before, left)
    evaluations = sum(stand.solution.problem.evaluations for stand in (course.calibrated, *course.stands))
    return replace(found, evaluations=evaluations, seconds=perf_counter() - began)


@contextmanager
def simulating(threads: int) -> Iterator[Any]:
    """Give a `map` that runs on so many threads; those of linear algebra would fight with them, on small matrices."""
    with threadpool_limits(1), ThreadPoolExecutor(threads) as pool:
        yield pool.map if threads > 1 else map


def settle(model: StageModel, runs: Sequence[Run], axis: str | None, tolerance: float | None) -> Setting:
    """Return what is to be diagnosed, with its noise floor."""
    name = choose_axis(model, runs, axis)
    its = model.axes[name]
    seen = tuple(of_axis(run, name, its) for run in split(runs))
    if not any(run.role == "identify" for run in seen):
        raise InputError("command line", "RUNS", None, "all are kept for validation; name a run with role identify")
    rate = 2 * math.pi * its.natural_frequency * min(max(its.damping_ratio, 1e-3), 1.0)
    noise = noise_floor(runs, name, settle=RUNG_DOWN * math.log(10) / rate, sensor_noise=its.sensor.noise)
    noise = _of_blocks(noise, seen)
    first = Setting(name, its, seen, noise, 0.0, _known(its))
    if (step := first.coarse_step) is not None:  # a quiet record may show nothing of it
        at_least = {run: max(rms, step / math.sqrt(12)) for run, rms in noise.rms.items()}
        first = replace(first, noise=replace(noise, rms=at_least))
    volts = max(float(np.abs(run.command()).max()) for run in seen) or 1.0
    least = min(OF_NOISE * first.floor, OF_STROKE * abs(its.gain * its.driver.gain) * volts)
    return replace(first, tolerance=least if tolerance is None else tolerance)


def with_better_between(model: StageModel, setting: Setting, each: Any, progress: Callable[[str], None]) -> Setting:
    """Return the setting with measured commands smooth between their samples, if nobody said and that fits better.

    Straight lines make a sine of frequency w smaller by (w h)^2 / 12, which would pass for a lag or a further mode.
    """
    unsaid = [run for run in setting.runs if run.command_is != "dac" and not run.between_is_stated]
    if not unsaid:
        return setting
    progress("asking what commands do between their samples")
    smooth = tuple(
        replace(run, between_samples="smooth", remarks=(*run.remarks, SMOOTH)) if run in unsaid else run
        for run in setting.runs
    )
    tried = [setting, replace(setting, runs=smooth)]
    stands = []
    for each_setting in tried:
        dynamics, case = case_of(model, each_setting, each, lambda _: None)
        stands.append(fitted(case, dynamics, (), {}, exact=False))
    straight, curved = stands
    if straight is None or curved is None:
        return setting
    scale = max(straight.scale, 1.0)
    return tried[1] if curved.cost < straight.cost - SMOOTHER * scale else setting


def _of_blocks(noise: NoiseFloor, runs: Sequence[Run]) -> NoiseFloor:
    """Return the noise with that of blocks of a record under their own names, too."""
    records = {run.name: run.name if run.name in noise.rms else run.name.rpartition(":")[0] for run in runs}
    processes = {name: noise.whitening.process(record) for name, record in records.items()}
    return replace(noise, whitening=Coloured(processes), rms={n: noise.rms[r] for n, r in records.items()})


def _from_rest(axis: AxisModel) -> AxisModel:
    """Return an axis that begins as it was never driven; where each run came from is a number of its own."""
    if "bouc_wen" not in axis.effects:
        return axis
    return replace(axis, effects={**axis.effects, "bouc_wen": {**axis.effects["bouc_wen"], "rest": 0.0}})


def _known(axis: AxisModel) -> dict[str, tuple[float, float]]:
    return prior(axis, [*LINEAR, *HYSTERESIS[:-1]] if "bouc_wen" in axis.effects else LINEAR)


def case_of(
    model: StageModel, setting: Setting, each: Any, progress: Callable[[str], None]
) -> tuple[AxisDynamics, Case]:
    """Return the model of the axis, with numbers of its own for each run, and what it is confronted with."""
    volts = max(float(np.abs(run.command()).max()) for run in setting.runs) or 1.0
    stroke = abs(setting.axis.gain * setting.axis.driver.gain) * volts
    least = math.ceil(max(run.period for run in setting.runs) / LONGEST_STEP)
    screening, fine = max(STEPS_SCREENING, least), max(STEPS, 2 * least)
    exact = float(np.clip(EXACT * setting.floor / stroke, FINEST_TOLERANCE, COARSEST_TOLERANCE))
    dynamics = AxisDynamics(
        setting.name,
        _from_rest(setting.axis),
        volts,
        tolerance=exact,
        delay=model.controller.delay,
        finest=fine,
        apart=tuple(run.name for run in setting.runs),
        highest=0.5 / max(run.period for run in setting.runs),
        bipolar=any(bool(np.min(run.command()) < -0.05 * volts) for run in setting.runs),
    )
    free = LINEAR + (HYSTERESIS[:-1] if "bouc_wen" in setting.axis.effects else ())
    noise, shapes = setting.noise.whitening, Beginning(setting.axis, stroke)

    def known(of: Model) -> Mapping[str, tuple[float, float]]:
        own = {p.name: known_of_start(p, setting.runs, volts) for p in of.parameters() if p.run}
        return {**setting.known, **{name: about for name, about in own.items() if about}}

    return dynamics, Case(
        identify=Suite(setting.of("identify"), noise, shapes),
        validate=Suite(setting.of("validate"), noise, shapes),
        free=free,
        known=known,
        tolerance=setting.tolerance,
        coarse=lambda of: cast(AxisDynamics, of).with_steps(screening, fixed=True),
        fine=lambda of: cast(AxisDynamics, of).with_steps(fine),
        each=each,
        progress=progress,
        designed={name: setting.axis.numbers[name] for name in LINEAR},
        believed=BELIEVED if setting.is_one_record else math.inf,
        drawn=setting.drawn,
    )


def search(
    setting: Setting,
    case: Case,
    dynamics: AxisDynamics,
    catalogue: Callable[[Stand], Sequence[Candidate]],
    seed: int,
) -> tuple[Case, Course]:
    """Calibrate, and add effects while they earn their place; return the case as calibrated, and how it went.

    Which effects are tried, and at what values, may follow from what calibration leaves: `catalogue` tells.
    """
    case.progress("predicting with the model as it is")
    designed = fitted(replace(case, free=(), believed=BELIEVED), dynamics, (), {})
    case.progress("calibrating")
    stand, agreed = calibrated(case, in_tune(case, in_time(case, dynamics)), seed=seed)
    if stand is not None:  # how a mode rings as a record begins follows from its calibrated numbers
        case = begun_like(case, cast(AxisDynamics, stand.model), setting.rounded(stand))
        stand = fitted(case, stand.model, (), {})
    if designed is None or stand is None:
        raise InputError("model", f"axis.{dynamics.name}", None, "cannot be simulated at the values it has")
    if not setting.noise.known:  # then nothing says at which size of what is left it would be noise
        case = replace(case, least=LEAST * stand.seen_cost)
    base, stands, steps, every = stand, list[Stand](), list[Step](), catalogue(stand)
    while len(stand.effects) < MOST:
        step = forward(case, stand, every)
        if step.chosen is None and (other := at_rest(case, stand, every, setting.rounded(stand))) is not None:
            case, stand, step = other
            base, stands = (base, [*stands[:-1], stand]) if stands else (stand, stands)
        steps.append(step)
        if step.chosen is None:
            break
        stand = backward(case, step.chosen.stand, dynamics, every)
        if stand.names == (stands[-1] if stands else base).names:  # what was added made itself superfluous
            base = base if stands else min(base, stand, key=lambda each: each.cost)
            stand = stands[-1] if stands else base
            break
        present = cast(AxisDynamics, stand.model)
        if begins_otherwise(cast(AxisDynamics, (stands[-1] if stands else base).model), present):
            case = begun_like(case, present)
            stand = fitted(case, stand.model, stand.effects, {}) or stand
        stands.append(stand)
    return case, Course(designed, base, tuple(stands), tuple(steps), stand, agreed)


def _rival(case: Case, stand: Stand) -> Rival:
    seen = stand.solution.problem.suite  # records may begin in more ways in a later stand
    return rival(replace(case, identify=seen), stand, Features(cast(AxisDynamics, stand.model)))
