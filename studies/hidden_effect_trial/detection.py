"""What of an effect shows: the part of its contribution that no recalibration of the base can imitate.

The recordings are linearised in everything that a fit may move: base parameters, and of each run its offset, initial
hysteresis, initial velocity and trigger delay. What an effect adds is projected on the complement. Parameters that are
known within bounds move within them alone, which makes it a least-squares problem with bounds; so a delay counts only
beyond what a trigger may do, and a resonance only beyond three standard deviations of what is known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from studies.hidden_effect_trial import bench
from studies.hidden_effect_trial.effects import BY_NAME, Stage, Values
from studies.hidden_effect_trial.recordings import PERIOD, TRIGGER, Recording

Array = NDArray[np.float64]
Effects = Mapping[str, Values]
#: What is known of a base parameter, relative, one standard deviation; a fit may go three of them away.
PRIOR_SIGMA = {"gain": 0.10, "omega": 0.018, "zeta": 1.0}
REACH = 3.0
#: Trigger delays are fitted with this much more room than they need: whoever fits does not know the limit to a hair.
DELAY_MARGIN = 2.0
#: Relative change of a parameter for a difference quotient.
DIFFERENCE_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Columns:
    """Sensitivities of all recordings to some parameters.

    Parameters
    ----------
    names
        Of the parameters; of one that belongs to a run, with the run's number.
    matrix
        Samples of all runs by parameters; each parameter counted in units of `unit`.
    unit
        SI per unit.
    low, high
        How far each may move, in units.
    """

    names: tuple[str, ...]
    matrix: Array
    unit: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class State:
    """A model that is being matched to recordings: its base, effects and runs, all of which a fit may change."""

    stage: Stage
    effects: Effects
    runs: tuple[Recording, ...]

    def readings(self, substeps: int = bench.COARSE) -> Array:
        """Return the readings of all runs, one after the other [m]."""
        return np.concatenate(bench.readings(self.stage, self.effects, self.runs, substeps))

    def with_changes(self, names: Sequence[str], steps: Sequence[float]) -> State:
        """Return the model with some parameters changed by so much, in SI; effects' by so much of their logarithm."""
        stage, runs = dict(vars(self.stage)), list(self.runs)
        effects = {name: dict(values) for name, values in self.effects.items()}
        for name, step in zip(names, steps, strict=True):
            key, _, place = name.partition(":")
            if place.isdigit():
                runs[int(place)] = replace(runs[int(place)], **{key: getattr(runs[int(place)], key) + step})
            elif place:
                effects[key][place] *= math.exp(min(max(step, -1.5), 1.5))
            else:
                stage[key] += step
        return State(Stage(**stage), effects, tuple(runs))


def columns(state: State, nominal: Stage, loops: bool = True) -> Columns:
    """Return the sensitivities of a model's readings.

    Parameters
    ----------
    state
        The model.
    nominal
        The base as the stage model states it: what bounds refer to.
    loops
        Whether the model has Bouc-Wen hysteresis.
    """
    here, stage = state.readings(), state.stage
    names: list[str] = []
    found: list[Array] = []
    units: list[float] = []
    bounds: list[tuple[float, float]] = []
    base = ("gain", "omega", "zeta", "a", "b", "c") if loops else ("gain", "omega", "zeta")
    for name in base:
        value, unit = getattr(stage, name), abs(getattr(nominal, name))
        names.append(name)
        found.append((state.with_changes([name], [DIFFERENCE_STEP * unit]).readings() - here) / DIFFERENCE_STEP)
        units.append(unit)
        reach = REACH * PRIOR_SIGMA.get(name, math.inf)
        at = value / unit
        bounds.append((max(1.0 - reach, 0.02) - at if name in PRIOR_SIGMA else -math.inf, 1.0 + reach - at))
    for effect, values in state.effects.items():
        for key in values:
            if values[key] and math.isfinite(values[key]) and (effect, key) not in _FIXED:
                names.append(f"{effect}:{key}")
                found.append((state.with_changes(names[-1:], [DIFFERENCE_STEP]).readings() - here) / DIFFERENCE_STEP)
                units.append(1.0)
                bounds.append((-math.inf, math.inf))
    own = {"velocity": 0.003 * stage.stroke * stage.omega, "late": PERIOD, "offset": stage.stroke}
    own |= {"shift": 0.1 * stage.stroke} if loops else {}
    own |= {"before": stage.volts, "waited": 10.0} if "creep" in state.effects else {}
    own |= {"phase": 1.0} if {"mains_hum", "base_motion"} & set(state.effects) else {}
    ends = np.cumsum([0, *(run.n for run in state.runs)])
    for key, unit in own.items():
        count = len(state.runs)
        # One simulation moves all runs at once: they do not know of each other.
        all_moved = state.with_changes([f"{key}:{i}" for i in range(count)], [DIFFERENCE_STEP * unit] * count)
        change = (all_moved.readings() - here) / DIFFERENCE_STEP
        for i, run in enumerate(state.runs):
            column = np.zeros_like(change)
            column[ends[i] : ends[i + 1]] = change[ends[i] : ends[i + 1]]
            names.append(f"{key}:{i}")
            found.append(column)
            units.append(unit)
            spare = DELAY_MARGIN * TRIGGER
            late = run.late / PERIOD
            bounds.append((-spare - late, spare - late) if key == "late" else (-math.inf, math.inf))
    low, high = np.array(bounds).T
    return Columns(tuple(names), np.column_stack(found), np.array(units), np.minimum(low, 0.0), np.maximum(high, 0.0))


#: Numbers of effects that a fit leaves alone: known, or without influence where they stand.
_FIXED = {
    ("mains_hum", "frequency"),
    ("base_motion", "frequency"),
    ("prandtl_ishlinskii", "shape"),
    ("quantisation", "step"),
}


class Complement:
    """What sensitivities cannot reach, bounds kept."""

    def __init__(self, of: Columns) -> None:
        norms = np.linalg.norm(of.matrix, axis=0)
        used = norms > 1e-9 * norms.max()
        bounded = np.isfinite(of.low) | np.isfinite(of.high)
        self.columns, self.count = of, len(of.names)
        self.free, self.bound = np.flatnonzero(used & ~bounded), np.flatnonzero(used & bounded)
        self.norms = norms[self.free]
        self.matrix = of.matrix[:, self.free] / self.norms
        self.basis = _basis(self.matrix)
        self.coefficients = np.linalg.pinv(self.basis.T @ self.matrix, rcond=1e-7)
        self.rest = self._project_out(of.matrix[:, self.bound])

    def _project_out(self, signal: Array) -> Array:
        return np.asarray(signal - self.basis @ (self.basis.T @ signal))

    def residual(self, signal: Array, more: Array | None = None) -> tuple[float, Array, Array]:
        """Return the residual of a signal.

        Parameters
        ----------
        signal
            Samples of all runs [m].
        more
            Further columns that may be subtracted freely.

        Returns
        -------
        Its root mean square [m], the steps of all parameters in their units, and the weights of the further columns.
        """
        rest, bound = self._project_out(signal), self.rest
        inner = np.zeros((len(signal), 0)) if more is None else self._project_out(more)
        extra = _basis(inner / np.maximum(np.linalg.norm(inner, axis=0), 1e-300))
        clear, reduced = rest - extra @ (extra.T @ rest), bound - extra @ (extra.T @ bound)
        steps: Array = np.zeros(self.count)
        if len(self.bound):
            q, r = np.linalg.qr(reduced)
            norms = np.maximum(np.linalg.norm(r, axis=0), 1e-300)
            limits = self.columns.low[self.bound] * norms, self.columns.high[self.bound] * norms
            solved = lsq_linear(r / norms, q.T @ clear, limits, method="bvls", tol=1e-10).x / norms
            steps[self.bound] = solved
            clear = clear - reduced @ solved
            rest = rest - bound @ solved
            signal = signal - self.columns.matrix[:, self.bound] @ solved
        weights = np.asarray(np.linalg.lstsq(extra.T @ inner, extra.T @ rest, rcond=1e-9)[0], dtype=np.float64)
        if more is not None:
            signal = signal - more @ weights
        steps[self.free] = self.coefficients @ (self.basis.T @ signal) / self.norms
        return float(np.sqrt(np.mean(clear**2))), steps, weights


def _basis(matrix: Array) -> Array:
    """Return orthonormal columns that span a matrix, directions lost in rounding left out."""
    q, r = np.linalg.qr(matrix)
    u, s, _ = np.linalg.svd(r)
    return np.asarray(q @ u[:, s > 1e-7 * s.max(initial=1e-300)])


def contribution(stage: Stage, effects: Effects, name: str, runs: tuple[Recording, ...]) -> Array:
    """Return what one of the effects adds to the readings of all runs [m]."""
    without = {other: values for other, values in effects.items() if other != name}
    substeps = _steps_showing(name)
    return State(stage, effects, runs).readings(substeps) - State(stage, without, runs).readings(substeps)


def _steps_showing(name: str) -> int:
    """Return the steps in a sample that show what an effect adds: those of recordings, if it acts within a sample."""
    return bench.FINE if name == "driver_slew" else bench.COARSE


def strength_for(
    wanted: float,
    name: str,
    constants: Values,
    stage: Stage,
    others: Effects,
    runs: tuple[Recording, ...],
    complement: Complement,
) -> tuple[Values, float] | None:
    """Return the values of an effect of which so much is left, and how much that is; None if it cannot be so strong.

    Parameters
    ----------
    wanted
        Root mean square of the residual [m].
    name, constants
        The effect, and its parameters in addition to the strength.
    stage, others, runs
        The bench without it.
    complement
        What its model cannot reach.
    """
    hidden, substeps = BY_NAME[name], _steps_showing(name)
    plain = State(stage, others, runs).readings(substeps)

    def residual_at(amount: float) -> float:
        values = hidden.at(amount, constants, stage)
        return complement.residual(State(stage, {**others, name: values}, runs).readings(substeps) - plain)[0]

    # Regula falsi on logarithms: the residual grows about as a power of the strength.
    tried: list[tuple[float, float]] = []
    amount = 0.1
    for _ in range(12):
        reached = residual_at(amount)
        if not math.isfinite(reached):
            amount *= 0.2
            continue
        tried.append((amount, max(reached, 1e-15)))
        if abs(math.log(tried[-1][1] / wanted)) < 0.1:
            return hidden.at(amount, constants, stage), reached
        below = [t for t in tried if t[1] < wanted]
        above = [t for t in tried if t[1] >= wanted]
        if below and above:
            (x0, y0), (x1, y1) = max(below), min(above)
            share = math.log(wanted / y0) / math.log(y1 / y0) if y1 < 1e3 * y0 else 0.5
            amount = x0 * (x1 / x0) ** min(max(share, 0.1), 0.9)
        elif below:
            if max(below)[0] >= 1.0:
                return None
            amount = min(1.0, max(below)[0] * min(wanted / max(below)[1], 10.0))
        else:
            amount = min(above)[0] * max(wanted / min(above)[1], 0.03) ** 1.2
    return None
