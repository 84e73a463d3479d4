"""The experiments that a diagnosis needs, adapted to the limits, modes and damping of one axis.

They record the noise at rest, the dynamics at several amplitudes, the hysteresis loop at two rates, the response long
after a step, and the change by a known mass. The validation runs have commands of other shapes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.experiment_design.commands import (
    ROOM_TEMPERATURE,
    Command,
    multisine,
    on_grid,
    other_than,
    path,
    triangle,
)
from flexdesign.diagnosis.experiment_design.limits import Limits
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel

#: Peak to peak of the multisines, per range of voltage: the noise dominates the first, nonlinearity the last.
MULTISINE_LEVELS = {"small": 0.04, "medium": 0.2, "large": 0.6}
#: Realisations of each: what differs between them, beyond noise, is nonlinear.
REALISATIONS = ("a", "b")
#: Periods that are kept of each, after one in which the stage settles: what differs between them is noise.
PERIODS_KEPT = 2
#: How long the step is held [s]: three decades of the creep of a stack, which then still goes on.
STEP_HOLD = 100.0
#: Length of the record at rest [s]: a hundred periods of mains hum.
QUIET_TIME = 2.0
#: An added mass of this share of the moving one lowers the resonance by 5 %.
ADDED_MASS = 0.1
#: A gentle transition to a level takes this number of periods of the lowest mode.
TRANSITION_PERIODS = 8
#: The experiment that is repeated with it.
SAME_WITH_MASS = "multisine_medium_a"
#: A static push moves the output by this share of its stroke.
STATIC_PUSH = 0.02
#: Least share of its intended amplitude at which an experiment is still useful.
LEAST_SHARE = 0.05
#: The motion may pass the ends of the static range by this share of the stroke.
OVERTRAVEL = 0.05


@dataclass(frozen=True)
class Times:
    """Times and frequencies that the modes of an axis require.

    Parameters
    ----------
    lowest
        Frequency of its lowest mode [Hz].
    settling
        After which the slowest mode has decayed to 2 % [s].
    resolution
        Distance of a multisine's tones, a whole part of the sampling rate: four within a resonance's width [Hz].
    band
        Of a multisine: from well below the resonance to well above it [Hz].
    """

    lowest: float
    settling: float
    resolution: float
    band: tuple[float, float]


def times(axis: AxisModel, limits: Limits) -> Times:
    """Return the times and frequencies that experiments on an axis go by."""
    modes = [(axis.natural_frequency, axis.damping_ratio), *((m.frequency, m.damping_ratio) for m in axis.modes)]
    lowest, highest = min(f for f, _ in modes), max(f for f, _ in modes)
    decay = min(2 * math.pi * f * max(d, 1e-3) for f, d in modes)
    width = min(2 * d * f for f, d in modes)
    wanted = min(max(width / 4, lowest / 400), lowest / 40)
    resolution = limits.rate / math.ceil(limits.rate / wanted)
    band = (lowest / 40, min(limits.bandwidth, 3 * highest))
    return Times(lowest, min(max(4.0 / decay, 0.1), 2.0), resolution, band)


def suite_of(model: AxisDynamics, limits: Limits, seed: int = 1) -> tuple[Command, ...]:
    """Return the experiments for an axis, in the order in which to run them.

    Parameters
    ----------
    model
        The axis as it is known; what a command would move too far by it is made smaller.
    limits
        What commands keep to.
    seed
        Of the random phases and levels: the same seed gives the same commands.

    Raises
    ------
    InputError
        If slew or motion leave less than a twentieth of an experiment.
    """
    maker = _Maker(model, limits, times(model.axis, limits), np.random.default_rng(seed))
    made = [replace(command, samples=on_grid(command.samples, limits)) for make in _MADE for command in make(maker)]
    same = next(command for command in made if command.name == SAME_WITH_MASS)
    return (*made, _added_mass(model.axis, same))


def other_excitations(model: AxisDynamics, limits: Limits) -> tuple[Command, ...]:
    """Return experiments in which something else than the command acts: a push, another axis, the temperature.

    They belong to the menu of what can distinguish effects; no command file can do them alone.
    """
    maker = _Maker(model, limits, times(model.axis, limits), np.random.default_rng(0))
    still, other = maker.still(4.0), other_than(model.name)
    slow = maker.still(STEP_HOLD)
    motion = 0.5 * model.stroke * (1 - np.cos(2 * np.pi * np.arange(len(still)) / (len(still) - 1) * 2)) / 2
    warms = ROOM_TEMPERATURE + 2.0 * np.arange(len(slow)) / (len(slow) - 1)
    return (
        Command(
            "static_push", "push", "the stiffness at the output", still, maker.period, push=STATIC_PUSH * model.stroke,
            note="load the output with a known force, such as a weight on a string, while the command rests",
        ),
        Command(
            "other_axis", "other axis", f"what axis {other} does to this one", still, maker.period,
            recorded={other: (model.axis.response, motion)},
            note=f"move axis {other} over half its range, twice, while this one rests; record both",
        ),
        Command(
            "warming", "temperature", "what warmth does", slow, maker.period, recorded={"T": ("K", warms)},
            note="let the room or the driver warm the stage by 2 K while the command rests; record the temperature",
        ),
    )  # fmt: skip


@dataclass(frozen=True)
class _Maker:
    """The inputs of all experiments."""

    model: AxisDynamics
    limits: Limits
    times: Times
    generator: np.random.Generator

    @property
    def period(self) -> float:
        return 1 / self.limits.rate

    def still(self, duration: float) -> Array:
        """Return the command at home for a time."""
        return np.full(round(duration * self.limits.rate) + 1, self.limits.home)

    def path(self, *points: tuple[float, float], gentle: float = 0.0) -> tuple[Array, tuple[float, ...]]:
        """Return levels, given as shares of the range with the time of each, from home and gently back."""
        limits, slow = self.limits, TRANSITION_PERIODS / self.times.lowest
        levels = [(limits.level(share), dwell) for share, dwell in points]
        first, away = path(limits, [(limits.home, 0.2), (levels[0][0], 0.0)], slow)
        inner, marks = path(limits, levels, gentle)
        last, _ = path(limits, [(levels[-1][0], 0.0), (limits.home, self.times.settling)], slow)
        begins = (len(first) - 1) * self.period
        together = np.concatenate([first[:-1], inner, last[1:]])
        return together, (*(away if gentle else ()), *(begins + mark for mark in marks))

    def about(self, share: float, wave: Array, before: float) -> tuple[Array, float]:
        """Return home, a gentle way to where a wave begins, the wave about the middle, and the way home.

        The wave has a peak to peak of 2, `share` of the range when it is drawn.
        """
        limits = self.limits
        samples = limits.middle + 0.5 * share * limits.span * wave
        slow = TRANSITION_PERIODS / self.times.lowest
        first, _ = path(limits, [(limits.home, 0.2), (float(samples[0]), before)], slow)
        last, _ = path(limits, [(float(samples[-1]), 0.0), (limits.home, self.times.settling)], slow)
        return np.concatenate([first, samples, last[1:]]), len(first) * self.period

    def within(self, name: str, make: Callable[[float], Array]) -> tuple[float, str]:
        """Return the factor, at most one, by which a wave must be reduced, and the limit that requires it.

        ``make(share)`` returns the command at a factor. Its slope must stay within the slew limit, and the motion that
        the model predicts within the static range: at a resonance a small tone moves far.
        """
        share, why = 1.0, ""
        steepest = float(np.abs(np.diff(make(1.0))).max())
        if steepest > self.limits.step:
            share, why = self.limits.step / steepest * (1 - 1e-9), "slew limit"
        for _ in range(3):  # hysteresis makes the motion grow by a little less than the command
            far = self._too_far(make(share))
            if far <= 1:
                break
            share, why = 0.98 * share / far, "range of motion"
        if share < LEAST_SHARE:
            remedy = (
                f"{why} leaves {100 * share:.2g} % of what {name} needs; allow a faster slew, or a lower --bandwidth"
            )
            raise InputError("command line", "plan", name, remedy)
        return share, f"reduced to {100 * share:.0f} % by the {why}" if why else ""

    def _too_far(self, samples: Array) -> float:
        """Return the largest motion from the middle of the static range, per what is allowed."""
        low, high = self.limits.level(0.0), self.limits.level(1.0)
        there = math.ceil(max(self.times.settling, abs(high - low) / self.limits.slew) * self.limits.rate) + 1
        corners = [self.limits.home, high, low, high]
        slow = np.interp(np.arange(3 * there + 1) / there, np.arange(4), corners)
        static, found = self._motion(slow), self._motion(samples)
        middle, half = 0.5 * (static.max() + static.min()), (0.5 + OVERTRAVEL) * float(np.ptp(static))
        far = float(np.abs(found - middle).max()) / half if half > 0 else 0.0
        return far if math.isfinite(far) else math.inf

    def _motion(self, samples: Array) -> Array:
        tried = Command("tried", "sine", "", on_grid(samples, self.limits), self.period)
        return self.model.predict(tried.run(self.model.name, self.model.axis.response))


def _quiet(maker: _Maker) -> list[Command]:
    purpose = "noise floor, mains hum, drift: what no model can predict"
    return [Command("quiet", "quiet", purpose, maker.still(QUIET_TIME), maker.period)]


def _calibration(maker: _Maker) -> list[Command]:
    dwell = 1.5 * maker.times.settling
    levels = [0.5, 0.52, 0.5, 0.48, 0.5, 0.54, 0.5, 0.46, 0.5]
    samples, marks = maker.path(*((level, dwell) for level in levels))
    return [Command("calibration", "steps", "gain and sign from small steps", samples, maker.period, marks=marks)]


def _steps(maker: _Maker) -> list[Command]:
    dwell = 2.0 * maker.times.settling
    levels = [s for size in (0.05, 0.15, 0.4) for s in (0.5 - size / 2, 0.5 + size / 2)]
    samples, marks = maker.path(*((level, dwell) for level in [*levels, 0.5]))
    purpose = "steps of several sizes: slew, friction, stiffness that changes with the motion"
    return [Command("steps", "steps", purpose, samples, maker.period, marks=marks)]


def _multisines(maker: _Maker) -> list[Command]:
    found, period = [], 1 / maker.times.resolution
    for level, size in MULTISINE_LEVELS.items():
        for realisation in REALISATIONS:
            tones = multisine(maker.times.band, maker.times.resolution, maker.limits.rate, maker.generator)
            wave, name = np.tile(tones, 1 + PERIODS_KEPT), f"multisine_{level}_{realisation}"

            def make(share: float, wave: Array = wave, size: float = size) -> Array:
                return maker.about(share * size, wave, maker.times.settling)[0]

            share, why = maker.within(name, make)
            samples, begins = maker.about(share * size, wave, maker.times.settling)
            purpose = f"resonance, damping, delay at {100 * share * size:.2g} % of the range, phases {realisation}"
            marks = tuple(begins + (1 + k) * period for k in range(PERIODS_KEPT + 1))
            found.append(
                Command(name, "multisine", purpose, samples, maker.period, marks=marks, cycle=period, scaled=why)
            )
    return found


def _triangles(maker: _Maker) -> list[Command]:
    limits = maker.limits
    wanted = min(maker.times.lowest / 30, limits.bandwidth / 8)  # turns hardly shake the mode
    fast = min(wanted, limits.step * limits.rate / (2 * limits.span))
    slow = min(0.5, fast / 8)
    why = f"{100 * fast / wanted:.0f} % of its rate, slew limit" if fast < wanted else ""
    purposes = {
        "slow": (slow, 3, "the loop of the hysteresis, without dynamics", ""),
        "fast": (fast, 8, "the same loop at a higher rate: what changes is no rate-independent hysteresis", why),
    }
    return [
        Command(f"triangle_{name}", "triangle", purpose, triangle(limits, frequency, cycles), maker.period,
                cycle=1 / frequency, scaled=scaled)
        for name, (frequency, cycles, purpose, scaled) in purposes.items()
    ]  # fmt: skip


def _staircase(maker: _Maker) -> list[Command]:
    dwell = max(0.3, 1.5 * maker.times.settling)
    stairs = [*np.linspace(0, 1, 9), *np.linspace(1, 0, 9)[1:]]
    samples, marks = maker.path(*((float(level), dwell) for level in stairs))
    return [Command("staircase", "staircase", "gain over the range, up and down", samples, maker.period, marks=marks)]


def _hold(maker: _Maker) -> list[Command]:
    level = 0.6 if maker.limits.level(0.6) != maker.limits.home else 0.8
    samples, marks = maker.path((level, STEP_HOLD), gentle=TRANSITION_PERIODS / maker.times.lowest)
    purpose = "creep, drift: what goes on after a step, over the logarithm of time"
    return [Command("hold", "hold", purpose, samples, maker.period, marks=marks)]


def _added_mass(axis: AxisModel, same: Command) -> Command:
    mass = axis.mass
    if mass is None:
        note = "fix a mass that lowers the resonance by about 5 % to the output, and write it into conditions"
    else:
        remarks = units.to_text(ADDED_MASS * mass, "g", 2, "kg")
        note = f"fix {remarks} to the output (a tenth of the model's moving mass), weighed to 1 %"
    purpose = "distinguishes a mass from a stiffness, and checks the moving mass"
    return replace(same, name="added_mass", purpose=purpose, mass_ratio=ADDED_MASS, note=note)


def _decaying_sine(maker: _Maker) -> list[Command]:
    limits, cycles = maker.limits, 10
    frequency = min(maker.times.lowest / 30, limits.bandwidth / 8)
    turns = np.arange(round(cycles / frequency * limits.rate) + 1) * frequency / limits.rate
    wave = np.sin(2 * np.pi * turns) * np.exp(-3 * turns / cycles)

    def make(share: float) -> Array:
        return maker.about(share, wave, maker.times.settling)[0]

    share, why = maker.within("decaying_sine", make)
    purpose = "validation: loops of every size"
    return [Command("decaying_sine", "sine", purpose, make(share), maker.period, "validate", scaled=why)]


def _random_levels(maker: _Maker) -> list[Command]:
    levels, dwells = maker.generator.uniform(0.3, 0.7, 16), maker.generator.uniform(0.5, 1.5, 16)
    points = [(float(s), 1.5 * float(d) * maker.times.settling) for s, d in zip(levels, dwells, strict=True)]
    samples, marks = maker.path(*points)
    purpose = "validation: steps of random sizes after random waits"
    return [Command("random_levels", "levels", purpose, samples, maker.period, "validate", marks=marks)]


_MADE: tuple[Callable[[_Maker], list[Command]], ...] = (
    _quiet, _calibration, _multisines, _steps, _triangles, _staircase, _hold, _decaying_sine, _random_levels,
)  # fmt: skip
