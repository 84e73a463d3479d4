"""What is found about an axis: the plants its printed gains belong to, and what the gains do on them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from flexdesign.core.errors import InputError
from flexdesign.dynamics.control import (
    PID,
    Margins,
    Plant,
    Tuning,
    Ultimate,
    by_experiment,
    margins,
    open_loop,
    rule,
    settling_time,
    simulate,
    tune,
    ultimate,
)
from flexdesign.dynamics.control.plants_from_gains import Candidate as Implied
from flexdesign.dynamics.control.plants_from_gains import Comparison, compare, plants_for_delays, plants_for_frequency
from flexdesign.dynamics.control.sampled_loop import Matrices, Response, matrices
from flexdesign.dynamics.control.ziegler_nichols import from_rule
from studies.lin2019_gains.printed import Axis

Array = NDArray[np.float64]
#: Half width of the settling band, as a share of the step.
BAND = 0.02
#: Loop delays that are looked at one by one, and how finely the family between them is traced, in samples.
DELAYS, FAMILY_STEP = (0.0, 1.0, 2.0), 0.1
#: Length of the step responses, in samples; what has not settled by then has an infinite settling time.
SAMPLES = 1000


class Step(NamedTuple):
    """A unit step: response, 2 % settling time [s], largest overshoot as a share of the step."""

    response: Response
    settling: float
    overshoot: float


@dataclass(frozen=True)
class Candidate:
    """A plant that the printed gains can belong to, and what they do on it.

    Parameters
    ----------
    label
        What was assumed to find it.
    plant
        The plant.
    rounding
        How far natural frequency [Hz] and damping ratio move within the rounding of the printed gains.
    alone, printed, ours
        Step responses: open loop, printed gains (None if unstable), our gains (None if not tuned).
    margins
        Of the loop with the printed gains.
    tuning
        Our gains; None where the printed ones are unstable, because the paper's loop ran.
    """

    label: str
    plant: Plant
    rounding: tuple[float, float]
    alone: Step
    printed: Step | None
    margins: Margins
    tuning: Tuning | None
    ours: Step | None


class Experiment(NamedTuple):
    """Ziegler and Nichols' experiment on a simulated loop and the analysis of the same plant."""

    label: str
    exact: Ultimate
    measured: Ultimate
    runs: int


@dataclass(frozen=True)
class Findings:
    """Everything about one axis.

    Parameters
    ----------
    axis
        The axis as printed.
    recomputed, recomputed_margins
        Ziegler-Nichols on the printed transfer function, and its margins there.
    candidates
        Plants that the printed gains can belong to.
    family
        The plants between them, by rising delay, up to where the damping vanishes.
    limit
        The member of the family on which the printed gains are just stable; with more delay they are not.
    comparison
        Frequency responses of the candidates on which the printed gains are stable, where these answer well.
    experiments
        Ziegler-Nichols by experiment.
    """

    axis: Axis
    recomputed: PID
    recomputed_margins: Margins
    candidates: tuple[Candidate, ...]
    family: tuple[Plant, ...]
    limit: Plant
    comparison: Comparison
    experiments: tuple[Experiment, ...]

    @property
    def stable(self) -> list[Candidate]:
        """The candidates on which the printed gains are stable."""
        return [candidate for candidate in self.candidates if candidate.margins.stable]

    @property
    def credible(self) -> list[Plant]:
        """The members of the family for which the printed gains are stable."""
        return [*(plant for plant in self.family if plant.delay < self.limit.delay), self.limit]


def investigate(axis: Axis) -> Findings:
    """Return all findings about an axis."""
    period = axis["period"]
    retold = rule(ultimate(axis.model.discretise(period)))
    implied = plants_for_delays(axis.pid, period, axis["gain"], DELAYS)
    at_printed = plants_for_frequency(axis.pid, period, axis["gain"], axis.model.natural_frequency)
    named = [(_label(found, period), found) for found in implied]
    # A whole oscillation later the same phase comes again: only the shortest delay is a loop that anyone would build.
    named += [("printed frequency", found) for found in at_printed[:1]]
    candidates = tuple(evaluate(axis, label, found.plant) for label, found in named)
    members = family(axis, implied[0].plant)
    stable = [found for (_, found), candidate in zip(named, candidates, strict=True) if candidate.margins.stable]
    return Findings(
        axis,
        retold,
        margins(open_loop(axis.model, retold, period)),
        candidates,
        members,
        _limit(axis, members),
        compare(stable, _answering(stable)),
        (experiment("eq (31)", axis.model, period), experiment(named[0][0], implied[0].plant, period)),
    )


def evaluate(axis: Axis, label: str, plant: Plant) -> Candidate:
    """Return a candidate with what the printed gains and ours do on it."""
    period = axis["period"]
    found = margins(open_loop(plant, axis.pid, period))
    tuning = tune(plant, period) if found.stable else None
    return Candidate(
        label,
        plant,
        rounding(axis, plant),
        step_response(plant, None, period),
        step_response(plant, axis.pid, period) if found.stable else None,
        found,
        tuning,
        step_response(plant, tuning.pid, period) if tuning else None,
    )


def step_response(plant: Plant, pid: PID | None, period: float) -> Step:
    """Return the response to a unit step, in open loop without a controller."""
    response = simulate(plant, pid, np.ones(SAMPLES), period)
    settling = settling_time(response.time, response.output, 1.0, BAND)
    return Step(response, settling, max(0.0, float(np.max(response.output)) - 1.0))


def fit_plant(axis: Axis, target: Ultimate, delay: float, near: Plant) -> Plant | None:
    """Return the plant next to `near` with this delay [s] and ultimate gain and period; None if there is none.

    Two equations, 1 + Ku G(z) = 0 at the ultimate period, in the two unknowns natural frequency and damping ratio.
    """
    z = 2 * math.pi * axis["period"] / target.period

    def mismatch(logarithms: Array) -> tuple[float, float]:
        plant = replace(near, natural_frequency=math.exp(logarithms[0]), damping_ratio=math.exp(logarithms[1]))
        sampled = replace(plant, delay=delay).sampled(axis["period"])
        value = 1 + target.gain * complex(Matrices(sampled.a, sampled.b, sampled.c, 0.0).response(z)[0])
        return value.real, value.imag

    solution = root(mismatch, [math.log(near.natural_frequency), math.log(near.damping_ratio)], tol=1e-12)
    if np.max(np.abs(solution.fun)) > 1e-8:
        return None
    frequency, damping = np.exp(solution.x)
    return replace(near, natural_frequency=float(frequency), damping_ratio=float(damping), delay=delay)


def family(axis: Axis, first: Plant) -> tuple[Plant, ...]:
    """Return the plants of the printed gains from `first` on, by rising delay, up to where no damping is left."""
    members, step = [first], FAMILY_STEP * axis["period"]
    while True:
        following = fit_plant(axis, axis.target, first.delay + len(members) * step, members[-1])
        if following is None or following.damping_ratio < 1e-6:
            return tuple(members)
        members.append(following)


def rounding(axis: Axis, plant: Plant) -> tuple[float, float]:
    """Return how far natural frequency [Hz] and damping ratio move if the printed gains are off by half a digit."""
    frequency = damping = 0.0
    for kp, ti in itertools.product((-1, 1), repeat=2):
        gains = PID(axis["kp"] + kp * axis.half_digit("kp"), axis["ti"] + ti * axis.half_digit("ti"))
        moved = fit_plant(axis, from_rule(gains), plant.delay, plant)
        if moved is None:
            raise InputError("study", "rounding", axis.name, "no plant belongs to the gains half a digit off")
        frequency = max(frequency, abs(moved.natural_frequency - plant.natural_frequency))
        damping = max(damping, abs(moved.damping_ratio - plant.damping_ratio))
    return frequency, damping


def damping_for(settling: float, frequency: float) -> float:
    """Return the damping ratio for which a step at `frequency` [Hz] settles to `BAND` in `settling` [s]."""
    return -math.log(BAND) / (2 * math.pi * frequency * settling)


def settling_on(plant: Plant, pid: PID, period: float) -> float:
    """Return the settling time of a controller on a plant [s]; nan if the loop is unstable."""
    if not matrices(open_loop(plant, pid, period)).is_stable():
        return math.nan
    return step_response(plant, pid, period).settling


def experiment(label: str, plant: Plant, period: float) -> Experiment:
    """Find the ultimate gain by running the proportional loop, and also from the plant itself."""
    runs = 0

    def respond(kp: float) -> Array:
        nonlocal runs
        runs += 1
        with np.errstate(over="ignore", invalid="ignore"):  # gains far too large run beyond all numbers
            return simulate(plant, PID(kp), np.ones(1200), period, substeps=1).output

    start = 0.1 / plant.static_gain
    found = by_experiment(respond, period, start)
    return Experiment(label, ultimate(plant.discretise(period)), found, runs)


def _label(found: Implied, period: float) -> str:
    samples = round(found.plant.delay / period)
    return {0: "no delay", 1: "1 sample of delay"}.get(samples, f"{samples} samples of delay")


def _limit(axis: Axis, members: Sequence[Plant]) -> Plant:
    """Return the member whose outermost closed-loop pole lies on the unit circle; the last if none does."""
    loops = [matrices(open_loop(plant, axis.pid, axis["period"])) for plant in members]
    radii = [float(np.max(np.abs(loop.closed_poles()))) for loop in loops]
    first = next((i for i, radius in enumerate(radii) if radius >= 1), None)
    if first is None:
        return members[-1]
    ends = slice(first - 1, first + 1)
    delay = float(np.interp(1.0, radii[ends], [plant.delay for plant in members[ends]]))
    return fit_plant(axis, axis.target, delay, members[first - 1]) or members[first - 1]


def _answering(candidates: Sequence[Implied]) -> Array:
    """Return frequencies up to where the first of the candidates answers less than at rest [Hz]."""
    grid = np.arange(1.0, 500.0, 0.5)
    weakest = np.min([np.abs(c.plant.response(grid)) / abs(c.plant.static_gain) for c in candidates], axis=0)
    return grid[: int(np.argmax(weakest < 1))]
