"""Which effects can replace one another: the residual after another effect took the place of the hidden one.

An effect can replace the hidden one if the readings, with it fitted in its place together with the base and
everything else that is hidden, are met to within three tenths of the noise. That is the measure by which the package
decides whether an effect is worth naming, so that no reading of these runs is worse for the wrong name. All is done
with the recordings' own simulator: first linearised, over a few settings of each effect's other numbers; what comes
near is then fitted, by Gauss and Newton's method.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from studies.hidden_effect_trial.detection import Columns, Complement, State, columns
from studies.hidden_effect_trial.effects import BY_NAME, CATALOGUE, INVERSE_STRENGTH, Stage, Values

Array = NDArray[np.float64]
#: Largest residual, over the noise, where one effect replaces another.
REPLACES_BELOW = 0.3
#: Amounts at which an effect is tried: a limit, or what acts beyond a threshold, is not proportional to it.
AMOUNTS, THRESHOLDS = (0.03,), (0.01, 0.05, 0.2, 0.5)
_NOT_PROPORTIONAL = (*INVERSE_STRENGTH, "driver_saturation")
#: A stage that moves by this number of strokes is destroyed by the trial.
TORN = 10.0
#: Steps of the fit, and the share of the hidden effect that may be left before a fit is worth while.
STEPS, NEAR = 5, 0.35
#: What changes the resonance: nothing else can replace it but a contact that is open over the whole stroke.
_RESONANCE = ("payload_mass", "stiffness_loss", "preload_loss")
#: Never replace another: rounding has no derivative; a missing loop is a model's, not an effect's, absence.
_NEVER = ("quantisation", "bouc_wen")


def substitutes(
    state: State, name: str, nominal: Stage, noise: float, polish: bool = True
) -> tuple[tuple[str, ...], float]:
    """Return which effects can replace one, and the smallest residual.

    Parameters
    ----------
    state
        The true stage with all that is hidden, and its runs.
    name
        The hidden effect in question.
    nominal
        The base as the stage model states it.
    noise
        Root mean square of the noise [m].
    polish
        Whether to fit what comes near.

    Returns
    -------
    Names, and what the nearest leaves [m].
    """
    others = {other: values for other, values in state.effects.items() if other != name}
    base = State(state.stage, others, state.runs)
    loops = "bouc_wen" not in state.effects
    complement = Complement(columns(base, nominal, loops))
    plain, target = base.readings(), state.readings()
    signal = target - plain
    whole, nearest, found = complement.residual(signal)[0], math.inf, []
    if name in _RESONANCE[:2]:
        starts = [_same_resonance(state, name, other) for other in _RESONANCE if other not in state.effects]
        left_by = [_fit_residual(start, target, nominal, loops, REPLACES_BELOW * noise) for start in starts]
        names = [other for other in _RESONANCE if other not in state.effects]
        return tuple(n for n, left in zip(names, left_by, strict=True) if left <= REPLACES_BELOW * noise), min(left_by)
    for candidate in CATALOGUE:
        if candidate.name in (*state.effects, *_NEVER, *_RESONANCE[:2]):
            continue
        amounts = THRESHOLDS if candidate.name in _NOT_PROPORTIONAL else AMOUNTS
        tried = [
            _fit_substitute(base, plain, signal, complement, candidate.name, amount, constants)
            for constants in candidate.samples(state.stage)
            for amount in amounts
        ]
        left, start = min(tried, key=lambda each: each[0])
        nearest = min(nearest, left)
        near = left < max(NEAR * whole, 2.0 * REPLACES_BELOW * noise) and left < 0.8 * whole
        if polish and near and left > REPLACES_BELOW * noise and start is not None:
            left = _fit_residual(start, target, nominal, loops, REPLACES_BELOW * noise)
        if left <= REPLACES_BELOW * noise:
            found.append(candidate.name)
    return tuple(found), nearest


def nearest(base: State, signal: Array, nominal: Stage) -> tuple[str, float]:
    """Return which further effect explains most of a signal, and which share of its rms it leaves.

    Parameters
    ----------
    base
        The stage with what is hidden in it, and its runs.
    signal
        Samples of all runs [m].
    nominal
        The base as the stage model states it.
    """
    complement = Complement(columns(base, nominal, loops="bouc_wen" not in base.effects))
    plain, whole = base.readings(), complement.residual(signal)[0]
    best, least = "", whole
    for candidate in CATALOGUE:
        if candidate.name in (*base.effects, *_NEVER, *_RESONANCE[:2]):
            continue
        for constants in candidate.samples(base.stage):
            for amount in THRESHOLDS if candidate.name in _NOT_PROPORTIONAL else AMOUNTS:
                left, _ = _fit_substitute(base, plain, signal, complement, candidate.name, amount, constants)
                best, least = (candidate.name, left) if left < least else (best, least)
    return best, least / whole


def _fit_substitute(
    base: State, plain: Array, signal: Array, complement: Complement, name: str, amount: float, constants: Values
) -> tuple[float, State | None]:
    """Return what an effect leaves of a signal if it is taken as strong as fits best, and the model that does it."""
    hidden = BY_NAME[name]
    shapes = []
    for phase in (0.0, 0.5 * math.pi) if name in ("mains_hum", "base_motion") else (0.0,):
        runs = (
            base.runs
            if not phase
            else State(base.stage, base.effects, base.runs)
            .with_changes([f"phase:{i}" for i in range(len(base.runs))], [phase] * len(base.runs))
            .runs
        )
        values = hidden.at(amount, constants, base.stage)
        shapes.append(
            State(base.stage, {**base.effects, name: values}, runs).readings()
            - (plain if not phase else State(base.stage, base.effects, runs).readings())
        )
    if not all(0.0 < np.abs(shape).max() < TORN * base.stage.stroke for shape in shapes):  # nor NaN
        return math.inf, None
    more = np.column_stack(shapes)
    if len(shapes) > 1:  # a phase of its own in each run
        ends = np.cumsum([0, *(run.n for run in base.runs)])
        more = np.zeros((len(signal), 2 * len(base.runs)))
        for i, shape in enumerate(shapes):
            for j in range(len(base.runs)):
                more[ends[j] : ends[j + 1], 2 * j + i] = shape[ends[j] : ends[j + 1]]
        return complement.residual(signal, more)[0], None
    left, steps, weights = complement.residual(signal, more)
    if name in _NOT_PROPORTIONAL and not 0.2 < weights[0] < 5.0:
        weights = np.ones(1)
    started = hidden.at(float(np.clip(amount * weights[0], 1e-4, 1.0)), constants, base.stage)
    if weights[0] <= 0.0:
        if name not in (
            "electrostriction",
            "stress_stiffening",
            "quadratic_stiffness",
            "sensor_drift",
            "stroke_dependent_amplification",
            "second_mode",
            "preload_loss",
        ):
            return math.inf, None
        started[hidden.strength] *= amount * weights[0] / max(amount * weights[0], 1e-4)
    moved = base.with_changes(complement.columns.names, list(_limit_steps(complement.columns, steps)))
    return left, State(moved.stage, {**moved.effects, name: started}, moved.runs)


def _same_resonance(state: State, name: str, other: str) -> State:
    """Return the model that has another effect in the place of one that changes the resonance, to the same effect."""
    stage, ratio = state.stage, state.effects[name]["ratio"]
    lost = ratio if name == "stiffness_loss" else 1.0 - 1.0 / (1.0 + ratio)  # of the stiffness, at the same frequency
    values = {
        "payload_mass": {"ratio": 1.0 / (1.0 - lost) - 1.0},
        "stiffness_loss": {"ratio": lost},
        "preload_loss": {"ratio": -lost, "onset": 3.0 * stage.stroke},
    }[other]
    softer = 1.0 - lost
    # Gain, damping and loop as they show: what lost stiffness or an open contact does to them is undone.
    gain = stage.gain / (softer if name == "stiffness_loss" else 1.0) * (softer if other != "payload_mass" else 1.0)
    power = {"payload_mass": 0.5, "stiffness_loss": -0.5, "preload_loss": -0.5}
    zeta = stage.zeta * softer ** (power[name] - power[other])
    a = stage.a * (softer if other == "preload_loss" else 1.0)
    made = Stage(**{**vars(stage), "gain": gain, "zeta": zeta, "a": a})
    others = {key: of for key, of in state.effects.items() if key != name}
    return State(made, {**others, other: values}, state.runs)


def _limit_steps(of: Columns, steps: Array) -> Array:
    """Return steps in SI, none longer than half a unit for what must stay positive."""
    return np.clip(steps, -0.5, 0.5) * of.unit


def _fit_residual(start: State, target: Array, nominal: Stage, loops: bool, enough: float) -> float:
    """Return what a model leaves once it is fitted [m]."""
    state, left = start, math.inf
    for _ in range(STEPS):
        rest = target - state.readings()
        if not np.isfinite(rest).all():
            return left
        reached = float(np.sqrt(np.mean(rest**2)))
        if reached <= enough or reached > 0.97 * left:
            return min(reached, left)
        left = reached
        of = columns(state, nominal, loops)
        _, steps, _ = Complement(of).residual(rest)
        state = state.with_changes(of.names, list(_limit_steps(of, steps)))
    return left
