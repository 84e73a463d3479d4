"""The experiments that a diagnosis needs, adapted to the limits, modes and damping of one axis.

They record the noise at rest, the dynamics at several amplitudes, the hysteresis loop at two rates, the response long
after a step, and the change by a known mass. The validation runs have commands of other shapes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.experiment_design.commands import Command, other_than
from flexdesign.diagnosis.experiment_design.effect_strength import VISIBLE_SHARE
from flexdesign.diagnosis.experiment_design.limits import COMMAND_GRID, Limits
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.trajectories import Multisine

#: Peak to peak of the multisines, per range of voltage: the noise dominates the first, nonlinearity the last.
MULTISINE_LEVELS = {"small": 0.04, "medium": 0.2, "large": 0.6}
#: Draws of random phases, of which the one with the lowest peaks is taken: their crest factor is 2.9, of one draw 3.4.
PHASE_DRAWS = 30
#: How long the step is held [s]: three decades of the creep of a stack, which then still goes on.
STEP_HOLD = 100.0
#: Change of temperature that shows what heat does [K].
WARMING = 1.0
#: An added mass of this share of the moving one lowers the resonance by 5 %.
ADDED_MASS = 0.1
#: The experiment that is repeated with it.
SAME_WITH_MASS = "multisine_medium_a"


def suite_of(model: AxisDynamics, limits: Limits, seed: int = 1) -> tuple[Command, ...]:
    """Return the experiments for an axis, in the order in which to run them; last those in which no command moves.

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
        If slew or motion leave less of the range to an experiment than the change of an effect that is to be seen.
    """
    maker = _Maker(model, limits, seed)
    settling, uniform = maker.settling, maker.generator.uniform
    small = [0.5, 0.52, 0.5, 0.48, 0.5, 0.54, 0.5, 0.46, 0.5]
    sizes = [0.5 + way * size / 2 for size in (0.05, 0.15, 0.4) for way in (-1, 1)]
    stairs = [*np.linspace(0, 1, 9), *np.linspace(1, 0, 9)[1:]]
    held = 0.6 if limits.level(0.6) != limits.home else 0.8
    made = [
        maker.command("quiet", "quiet", "noise floor, mains hum, drift: what no model can predict", maker.rest),
        maker.levels("calibration", "steps", "gain and sign from small steps", small, 1.5 * settling),
        # Two realisations of each: what differs between them, beyond noise, is nonlinear.
        *(maker.multisine(level, realisation) for level in MULTISINE_LEVELS for realisation in ("a", "b")),
        maker.levels(
            "steps", "steps", "steps of several sizes: slew, friction, stiffness that changes with the motion",
            [*sizes, 0.5], 2.0 * settling,
        ),
        *maker.triangles(),
        maker.levels("staircase", "staircase", "gain over the range, up and down", stairs, max(0.3, 1.5 * settling)),
        maker.levels(
            "hold", "hold", "creep, drift: what goes on after a step, over the logarithm of time", [held], STEP_HOLD
        ),
        maker.decaying_sine(10),
        maker.levels(
            "random_levels", "levels", "validation: steps of random sizes after random waits",
            uniform(0.3, 0.7, 16), 1.5 * settling * uniform(0.5, 1.5, 16), role="validate",
        ),
    ]  # fmt: skip
    same = next(command for command in made if command.name == SAME_WITH_MASS)
    note = "fix a mass that lowers the resonance by about 5 % to the output, and write it into conditions"
    if model.axis.mass is not None:
        mass = units.to_text(ADDED_MASS * model.axis.mass, "g", 2, "kg")
        note = f"fix {mass} to the output (a tenth of the model's moving mass), weighed to 1 %"
    purpose = "distinguishes a mass from a stiffness, and checks the moving mass"
    added_mass = replace(same, name="added_mass", purpose=purpose, mass_ratio=ADDED_MASS, note=note)
    return (*made, added_mass, *maker.other_excitations())


class _Maker:
    """Makes commands from shapes, by the limits, modes and damping of an axis."""

    def __init__(self, model: AxisDynamics, limits: Limits, seed: int) -> None:
        self.model, self.limits, self.generator = model, limits, np.random.default_rng(seed)
        self.period, axis = 1 / limits.rate, model.axis
        modes = [(axis.natural_frequency, axis.damping_ratio), *((m.frequency, m.damping_ratio) for m in axis.modes)]
        lowest, self.highest = min(f for f, _ in modes), max(f for f, _ in modes)
        self.gentle = min(lowest / 30, limits.bandwidth / 8)  # of this frequency, turns hardly shake the mode
        # After this time the slowest mode has decayed to 2 %.
        self.settling = min(max(4.0 / min(2 * math.pi * f * max(d, 1e-3) for f, d in modes), 0.1), 2.0)
        # Tones of multisines, from well below the resonance to well above it: four within its width, and their distance
        # a whole part of the sampling rate.
        wanted = min(max(min(2 * d * f for f, d in modes) / 4, lowest / 400), lowest / 40)
        self.resolution = limits.rate / math.ceil(limits.rate / wanted)
        self.band = (lowest / 40, min(limits.bandwidth, 3 * self.highest))
        self.rest = self.still(2.0)  # a hundred periods of mains hum

    def command(self, name: str, kind: str, purpose: str, samples: Array, **more: Any) -> Command:
        """Return samples [V] as a command, rounded to multiples of the grid that lie within the voltage range."""
        first = math.ceil(self.limits.low / COMMAND_GRID - 1e-9)
        last = math.floor(self.limits.high / COMMAND_GRID + 1e-9)
        # Divided by a whole number: the nearest double of the decimal that a file holds.
        rounded = np.clip(np.rint(samples / COMMAND_GRID), first, last) / round(1 / COMMAND_GRID)
        return Command(name, kind, purpose, rounded, self.period, **more)

    def still(self, duration: float) -> Array:
        """Return the command at home for a time."""
        return np.full(round(duration * self.limits.rate) + 1, self.limits.home)

    def levels(
        self, name: str, kind: str, purpose: str, shares: Sequence[float] | Array, dwell: float | Array, **more: Any
    ) -> Command:
        """Return levels, given as shares of the range, each held for a time [s]; a single one is marked."""
        points = [(self.limits.level(float(s)), float(d)) for s, d in np.broadcast(shares, dwell)]
        inner, marks = self.path(points)
        return self.framed(name, kind, purpose, inner, 0.0, marks or [0.0], **more)

    def path(self, points: Sequence[tuple[float, float]], gentle: float = 0.0) -> tuple[Array, list[float]]:
        """Return levels [V], each held for a time [s], joined by ramps; and when each ramp begins [s]."""
        pieces, begins, level, count = [], [], points[0][0], 0
        for target, dwell in points:
            if target != level:
                begins.append(count * self.period)
                pieces.append(self.ramp(level, target, gentle))
                count += len(pieces[-1])
            held = max(1, round(dwell * self.limits.rate))
            pieces.append(np.full(held, target))
            count, level = count + held, target
        return np.concatenate(pieces), begins

    def ramp(self, start: float, end: float, gentle: float) -> Array:
        """Return the samples between two levels, neither of them included: none where the command may jump.

        A gentle way takes at least a time [s]. It is half a cosine, which leaves a mode of a few of its periods' length
        nearly at rest.
        """
        # As a low-pass of first order rises from 10 to 90 %, which is 0.8 of a ramp.
        ramp_time = math.log(9) / (2 * math.pi * self.limits.bandwidth) / 0.8
        slowest = abs(end - start) / self.limits.step * (0.5 * math.pi if gentle else 1.0)
        samples = max(1, math.ceil(max(ramp_time, gentle) * self.limits.rate - 0.5), math.ceil(slowest))
        share = np.arange(1, samples) / samples
        return start + (end - start) * (0.5 - 0.5 * np.cos(np.pi * share) if gentle else share)

    def framed(
        self, name: str, kind: str, purpose: str, samples: Array, rest: float, marks: Sequence[float], **more: Any
    ) -> Command:
        """Return samples [V] after a gentle way from home and a rest [s], and before the way home.

        The moments `marks` [s] count from the first of the samples on.
        """
        home, slow = self.limits.home, self.settling
        first, _ = self.path([(home, 0.2), (float(samples[0]), rest)], slow)
        last, _ = self.path([(float(samples[-1]), 0.0), (home, slow)], slow)
        marks = tuple(len(first) * self.period + mark for mark in marks)
        return self.command(name, kind, purpose, np.concatenate([first, samples, last[1:]]), marks=marks, **more)

    def within(
        self, name: str, kind: str, purpose: str, wave: Array, size: float, marks: Sequence[float] = (), **more: Any
    ) -> Command:
        """Return a wave, from -1 to 1, about the middle of the range, as large as the limits allow.

        Its peak to peak is at most the share `size` of the range. Its slope stays within the slew limit, and the motion
        that the model predicts within the static range: at a resonance a small tone moves far.
        """
        whole = 0.5 * size * self.limits.span * wave

        def make(share: float, why: str) -> Command:
            scaled = f"reduced to {100 * share:.0f} % by the {why}" if why else ""
            samples = self.limits.level(0.5) + share * whole
            return self.framed(name, kind, purpose, samples, self.settling, marks, scaled=scaled, **more)

        share = min(1.0, self.slew_share(whole) * (1 - 1e-9))
        why = "slew limit" if share < 1 else ""
        middle, half = self._static_range
        for _ in range(3):  # hysteresis makes the motion grow by a little less than the command
            far = float(np.abs(self._motion(make(share, why)) - middle).max())
            if half > 0 and not far <= half:  # also where the motion runs away
                share, why = 0.98 * share * half / far if math.isfinite(far) else 0.0, "range of motion"
        if share * size < VISIBLE_SHARE:
            left = f"{why} leaves {100 * share * size:.2g} % of the range, which shows no effect"
            raise InputError("command line", "plan", name, f"{left}; allow a faster slew, or a lower --bandwidth")
        return make(share, why)

    def slew_share(self, wave: Array) -> float:
        """Return by how much a wave [V] may grow within the slew limit."""
        return float(self.limits.step / np.abs(np.diff(wave)).max())

    @cached_property
    def _static_range(self) -> tuple[float, float]:
        """Middle and half of the motion while the command goes slowly to both ends of what the limits allow."""
        limits = self.limits
        there = math.ceil(max(self.settling, limits.span / limits.slew) * limits.rate) + 1
        corners = [limits.home, limits.high, limits.low, limits.high]
        swept = np.interp(np.arange(3 * there + 1) / there, np.arange(4), corners)
        motion = self._motion(self.command("swept", "triangle", "", swept))
        return 0.5 * float(motion.max() + motion.min()), 0.5 * float(np.ptp(motion))

    def _motion(self, command: Command) -> Array:
        return self.model.predict(command.run(self.model.name, self.model.axis.response))

    def multisine(self, level: str, realisation: str) -> Command:
        """Return a multisine of one level: a period in which the stage settles, and two that differ by noise alone.

        The small ones cover the whole band. Larger ones end at a lower frequency if a slow driver asks for that:
        reduced to its slew limit they would all be as small.
        """
        size, period = MULTISINE_LEVELS[level], 1 / self.resolution
        seeds = self.generator.integers(2**32, size=PHASE_DRAWS).tolist()
        low, high = self.band
        tones = self.tones(high, seeds)
        share = self.slew_share(0.5 * size * self.limits.span * tones)
        if share < 1 and size > min(MULTISINE_LEVELS.values()):  # the slope grows with the highest frequency
            high = self.resolution * round(max(share * high, 2 * low) / self.resolution)
            tones = self.tones(high, seeds)
        has_modes = high >= self.highest
        purpose = "resonance, damping, delay" if has_modes else f"gain and hysteresis up to {units.hertz(high, 2)}"
        return self.within(
            f"multisine_{level}_{realisation}", "multisine",
            f"{purpose} at {100 * size:g} % of the range, phases {realisation}", np.tile(tones, 3), size,
            marks=(period, 2 * period, 3 * period), cycle=period,
        )  # fmt: skip

    def tones(self, highest: float, seeds: Sequence[int]) -> Array:
        """Return a period of tones up to a frequency [Hz], from -1 to 1, with the phases of largest rms."""
        edges, resolution = [f"{edge!r} Hz" for edge in (self.band[0], highest)], f"{self.resolution!r} Hz"
        shape = dict(shape="multisine", low="-1 V", high="1 V", band=edges, resolution=resolution)
        samples = round(self.limits.rate / self.resolution)
        draws = (Multisine.model_validate({**shape, "seed": each}).sampled(self.period)[:samples] for each in seeds)
        return max(draws, key=np.std)  # all have the same peak

    def triangles(self) -> Iterator[Command]:
        """Yield triangles over the whole range at two rates, from home and back."""
        limits = self.limits
        fast = min(self.gentle, limits.step * limits.rate / (2 * limits.span))
        why = f"{100 * fast / self.gentle:.0f} % of its rate, slew limit" if fast < self.gentle else ""
        for name, frequency, cycles, purpose, scaled in (
            ("slow", min(0.5, fast / 8), 3, "the loop of the hysteresis, without dynamics", ""),
            ("fast", fast, 8, "the same loop at a higher rate: what changes is no rate-independent hysteresis", why),
        ):
            corners = [limits.home, *([limits.high, limits.low] * cycles), limits.home]
            times = np.append(0.0, np.cumsum(np.abs(np.diff(corners)))) / (2 * limits.span * frequency)
            samples = np.interp(np.arange(math.ceil(times[-1] * limits.rate) + 1) * self.period, times, corners)
            yield self.command(f"triangle_{name}", "triangle", purpose, samples, cycle=1 / frequency, scaled=scaled)

    def decaying_sine(self, cycles: int) -> Command:
        """Return a slow sine over the whole range whose cycles become smaller."""
        turns = np.arange(round(cycles / self.gentle / self.period) + 1) * self.gentle * self.period
        wave = np.sin(2 * np.pi * turns) * np.exp(-3 * turns / cycles)
        return self.within("decaying_sine", "sine", "validation: loops of every size", wave, 1.0, role="validate")

    def other_excitations(self) -> Iterator[Command]:
        """Yield experiments in which something else than the command acts: a push, another axis, the temperature."""
        slow, other = self.still(STEP_HOLD), other_than(self.model.name)
        motion = 0.25 * self.model.stroke * (1 - np.cos(np.linspace(0, 4 * np.pi, len(self.rest))))
        yield self.command(
            "static_push", "push", "the stiffness at the output", self.rest, push=VISIBLE_SHARE * self.model.stroke,
            note="load the output with a known force, such as a weight on a string, while the command rests",
        )  # fmt: skip
        yield self.command(
            "other_axis", "other axis", f"what axis {other} does to this one", self.rest, recorded={other: motion},
            note=f"move axis {other} over half its range, twice, while this one rests; record both",
        )  # fmt: skip
        yield self.command(
            "warming", "temperature", "what warmth does", slow, recorded={"T": np.linspace(0, WARMING, len(slow))},
            note=f"let the room or the driver warm the stage by {WARMING:g} K or more while the command rests; record "
            "the temperature",
        )  # fmt: skip
