"""What is driven and recorded: about twenty seconds in nine runs, and one for testing, each with its unknown start."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.hidden_effect_trial.effects import Stage

Array = NDArray[np.float64]
#: Sampling period [s].
PERIOD = 1e-3
#: Largest trigger delay either way, in samples; largest offset and initial velocity, in strokes and strokes times
#: natural frequency.
TRIGGER, OFFSET, KICKED = 0.3, 0.05, 0.003
#: How often commands wait between samples, where nothing settles it.
HELD = 0.3


@dataclass(frozen=True, eq=False)
class Recording:
    """One run as it was driven.

    Parameters
    ----------
    name, role, held
        Of the file; "identify", "validate" or "test"; whether the command waits between samples.
    u
        Command at n samples, and one more that the record does not show [V].
    turns, before, waited
        What the stage did before, see `kernel.history` [V, V, s].
    offset, velocity, late
        Reading where motion is zero [m], initial velocity [m/s], and how late the command acts [s].
    shift
        Change of the initial hysteresis [m]; for sensitivities.
    phase
        Of whatever is periodic [rad].
    seed
        Of whatever happens at random in this run.
    """

    name: str
    role: str
    held: bool
    u: Array
    turns: Array
    before: float
    waited: float
    offset: float
    velocity: float
    late: float
    phase: float
    seed: int
    shift: float = 0.0

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.u) - 1


def waits(rng: np.random.Generator) -> bool:
    """Draw what commands do between samples."""
    return bool(rng.random() < HELD)


def draw(rng: np.random.Generator, stage: Stage, held: bool | None = None) -> tuple[Recording, ...]:
    """Return the runs on a stage; `held` settles what commands do between samples, else it is drawn."""
    held = waits(rng) if held is None else held
    wave = _multisine(rng, stage)
    top = stage.volts
    middle = top * rng.uniform(0.45, 0.55)
    commands = {
        "quiet": ("identify", np.full(1500, top * rng.uniform(0.1, 0.9))),
        "multisine-high": ("identify", middle + np.tile(wave, 2)),
        "multisine-medium": ("identify", middle + 0.5 * np.tile(np.roll(wave, int(rng.integers(1000))), 2)),
        "multisine-low": ("identify", middle + 0.25 * np.tile(np.roll(wave, int(rng.integers(1000))), 2)),
        "triangle": ("identify", _triangle(2500, 2, top * rng.uniform(0.9, 1.0))),
        "staircase": ("identify", np.repeat(_levels(rng, 9, top), 300)),
        "sine": ("identify", middle + top * rng.uniform(0.25, 0.4) * _sine(1000, 20.0)),
        "decaying-sine": ("validate", _decaying(rng, 2500, top)),
        "random-levels": ("validate", np.repeat(_levels(rng, 14, top), 180)),
    }
    return tuple(
        _recording(rng, stage, f"{number}-{name}", role, held, u)
        for number, (name, (role, u)) in enumerate(commands.items(), start=1)
    )


def draw_test(rng: np.random.Generator, stage: Stage, held: bool) -> Recording:
    """Return the run that is neither fitted nor used to choose: a triangle, a step and a slow sweep about its level."""
    top = stage.volts
    low, high, level = (top * rng.uniform(*ends) for ends in ((0.05, 0.2), (0.6, 0.8), (0.4, 0.6)))
    t = np.arange(900) * PERIOD
    sweep = level + top * rng.uniform(0.15, 0.25) * np.sin(2.0 * math.pi * (1.0 + 0.5 * 40.0 * t / t[-1]) * t)
    u = np.concatenate((low + _triangle(1200, 1, high - low), np.full(400, level), sweep))
    return _recording(rng, stage, "t-triangle-step-sweep", "test", held, u)


def _recording(rng: np.random.Generator, stage: Stage, name: str, role: str, held: bool, u: Array) -> Recording:
    """Return a run with its unknown start drawn."""
    top = stage.volts
    return Recording(
        turns=np.array([top * rng.uniform(0.5, 1.0), top * rng.uniform(0.0, 0.2), u[0]]),
        name=name,
        role=role,
        held=held,
        u=np.append(u, u[-1] if held else 2.0 * u[-1] - u[-2]),
        before=float(top * rng.uniform(0.0, 0.7)),
        waited=float(np.exp(rng.uniform(math.log(2.0), math.log(60.0)))),
        offset=float(stage.stroke * rng.uniform(-OFFSET, OFFSET)),
        velocity=float(stage.stroke * stage.omega * rng.normal() * KICKED / 3.0),
        late=float(PERIOD * rng.uniform(-TRIGGER, TRIGGER)),
        phase=float(rng.uniform(0.0, 2.0 * math.pi)),
        seed=int(rng.integers(2**31)),
    )


def _multisine(rng: np.random.Generator, stage: Stage) -> Array:
    """Return a second of a multisine whose response stays within four tenths of the stroke either way [V]."""
    t = np.arange(1000) * PERIOD
    f0 = stage.omega / (2.0 * math.pi)
    lines = np.arange(3.0, min(1.5 * f0, 300.0), 4.0)
    phases = rng.uniform(0.0, 2.0 * math.pi, len(lines))
    r = lines / f0
    answer = 1.0 / (1.0 - r**2 + 2j * stage.zeta * r)
    # Flat below the resonance; at the resonance driven less, or it would take the whole stroke.
    amplitudes = 1.0 / np.sqrt(1.0 + np.abs(answer) ** 2 / 4.0)
    u = (amplitudes[:, None] * np.cos(2.0 * math.pi * lines[:, None] * t + phases[:, None])).sum(axis=0)
    spun = amplitudes * np.exp(1j * phases) * answer
    x = (spun[:, None] * np.exp(2j * math.pi * lines[:, None] * t)).sum(axis=0).real
    return np.asarray(u * 0.4 * stage.volts / max(np.abs(x).max(), np.abs(u).max()))


def _sine(n: int, frequency: float) -> Array:
    return np.sin(2.0 * math.pi * frequency * np.arange(n) * PERIOD)


def _triangle(n: int, cycles: int, top: float) -> Array:
    turn = np.arange(n) * cycles / n % 1.0
    return np.asarray(top * (1.0 - np.abs(2.0 * turn - 1.0)))


def _levels(rng: np.random.Generator, count: int, top: float) -> Array:
    """Return voltages that are neither close to nor far from the one before, from zero to the top and about [V]."""
    levels = [0.0, 0.35, 0.7, 1.0]
    while len(levels) < count:
        level = rng.uniform(0.0, 1.0)
        if 0.1 < abs(level - levels[-1]) < 0.4:
            levels.append(float(level))
    return top * np.array(levels)


def _decaying(rng: np.random.Generator, n: int, top: float) -> Array:
    t = np.arange(n) * PERIOD
    frequency = rng.uniform(2.0, 6.0)
    return np.asarray(0.5 * top * (1.0 + np.exp(-t / 0.8) * np.sin(2.0 * math.pi * frequency * t)))
