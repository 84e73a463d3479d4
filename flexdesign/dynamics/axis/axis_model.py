"""One axis of a stage as a model that a fit can move: its numbers by name, and what they predict of a recorded run.

The command of a run is simulated open loop, as it was recorded. A fit differentiates the prediction by finite
differences, so that the number of steps in a sample may not change from one trial to the next: it is found once for
each run, from the error estimate, and kept by all models that come of the first one by new values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Block, Effect, Observation, Parameter
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.axis import axis_parameters, axis_response
from flexdesign.dynamics.axis.axis_parameters import DELAY, TRIGGER, observable_range, with_payload, with_values
from flexdesign.dynamics.axis.axis_run import command_of, is_at_stack, smooth_way, span, without_amplifier
from flexdesign.dynamics.signal_chain.chain import AxisChain
from flexdesign.dynamics.signal_chain.step_count import Steps
from flexdesign.dynamics.simulate import Lead, Loop, Response, Stage, simulate
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.dynamics.stage_model import fields as units_of
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.measurements.recordings.frequency_response import parts

#: Error that a prediction may have, relative to its span: far below the noise of any sensor.
TOLERANCE = 1e-7
#: The same of what is only drawn or compared.
COMPARED_TOLERANCE = 1e-6
#: Below this share of the tolerance a prediction is exact, and needs no margin.
EXACT = 1e-3
#: A mode at half its damping has decayed to this share of the first command's response before a record begins.
DECAYED = 1e-4
#: A response that moves by more than this share of its span, while its command stands still, rings from before.
RINGS = 0.05
#: A command that moves less than this share of its span in the first period of the mode stands still.
STILL = 0.01
#: Periods of the mode after which it is taken to have settled, however small its damping.
LONGEST_LEAD = 1000.0
#: Where the voltage had turned before a record, as numbers of its own, and in shares of the range of the commands.
REVERSALS = {"turn.1": 0.75, "turn.2": 0.1}
#: Where a search tries them in shares of the largest command, where commands have one sign, and where they have both.
TRIAL_REVERSALS = {"turn.1": (0.5, 0.75, 0.95), "turn.2": (-0.25, 0.0, 0.1, 0.25)}
TRIAL_REVERSALS_BIPOLAR = {"turn.1": (-0.95, -0.5, 0.5, 0.95), "turn.2": (-0.95, -0.25, 0.25, 0.95)}
#: Range of the turning voltages, over the largest command: a stage may have been driven further before the record.
TURNED_WITHIN = 2.0
#: Where a search tries a phase [rad]: from the opposite one a fit goes nowhere.
QUARTERS = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
#: Steps in a period of a slow mode, which integrate its motion to a percent.
STEPS_PER_PERIOD = 20
#: Samples of a lead in a period of the fastest mode, at least: with two a force would make it grow, as in a record.
SAMPLES_PER_PERIOD = 4
#: Periods of the mode that a way before a record takes.
PERIODS_OF_A_WAY = 6.0
#: A record began within this of its first sample [s].
TRIGGERED_WITHIN = (-0.02, 0.02)


@dataclass(frozen=True, eq=False)
class AxisDynamics:
    """The signal chain of one axis, a `flexdesign.core.model.Model` of runs; immutable.

    Parameters
    ----------
    name
        The axis.
    axis
        Its numbers.
    max_command
        Largest command that is expected [V]; with the gain it gives the stroke, on which plausible ranges hang.
    tolerance
        Error allowed in a prediction, relative to its span.
    origin
        The numbers about which ranges are plausible: those of the first model; by default `axis`.
    steps
        Numbers of steps found so far; by default none.
    delay
        How late commands act [s].
    finest
        No more steps in a sample than these, whatever the error.
    fixed
        Whether the number of steps is fixed, which saves finding it.
    margin
        The number of steps found at the first values is multiplied by this, as other values may ask for more.
    apart
        Names of the runs that have numbers of their own: how late the record began, ``RUN:trigger``, and where the
        voltage had turned before, ``RUN:turn.1`` and ``RUN:turn.2``, from which all hysteresis has its state.
    bipolar
        Whether commands of both signs are known.
    highest
        Highest frequency that the samples show [Hz]; an effect may have none above.
    own
        These numbers where they differ from those of all runs, SI; of a number in `by_run` the deviation from its mean.
    by_run
        Numbers of effects that differ from run to run, with the standard deviation that each run's may have, SI. The
        axis has the mean; a run its deviation, ``RUN:sensor_drift.rate``.
    """

    name: str
    axis: AxisModel
    max_command: float = 100.0
    tolerance: float = TOLERANCE
    origin: AxisModel | None = None
    steps: Steps = field(default_factory=Steps, repr=False)
    delay: float = 0.0
    finest: int = 1024
    fixed: bool = False
    margin: int = 2
    apart: tuple[str, ...] = ()
    bipolar: bool = False
    highest: float = math.inf
    own: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    by_run: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.steps.at is None:
            self.steps.at, self.steps.delay = self.axis, self.delay

    @property
    def first(self) -> AxisModel:
        """The numbers that the axis had before any were replaced."""
        return self.origin or self.axis

    @property
    def stroke(self) -> float:
        """What the first gain makes of the largest command [response]."""
        return axis_parameters.stroke_of(self.first, self.max_command)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return every number that the prediction depends on, named as in `AxisModel.numbers`, and the delay.

        The mass is none of them: it follows from stiffness and natural frequency.
        """
        numbers = {**self.axis.numbers, DELAY: self.delay}
        every = axis_parameters.of(self.first, self.axis, self.max_command)
        made = [
            replace(p, start=numbers.get(p.name, p.start), **observable_range(p, self.first, self.highest))
            for p in every
        ]
        made = [replace(p, twin=p.name) if p.name in self.by_run else p for p in made]
        return (*made, *(mine for run in self.apart for mine in self._of_run(run, made)))

    def _of_run(self, run: str, common: Sequence[Parameter]) -> Iterator[Parameter]:
        """Yield the numbers that a run has for itself; where it has none of its own they are those of all runs."""
        own = self.own.get(run, {})
        trigger = Parameter(TRIGGER, "s", "ms", "how late the record began", 0.0, 0.0, TRIGGERED_WITHIN)
        # Of both signs, also where commands have one sign: nobody knows how a stage came to rest.
        farthest, tried = TURNED_WITHIN * self.max_command, TRIAL_REVERSALS_BIPOLAR if self.bipolar else TRIAL_REVERSALS
        before, range_ = "where the voltage had turned before the record", (-farthest, farthest)
        turns = (
            Parameter(n, "V", "V", before, None, start, range_, screen=tuple(s * self.max_command for s in tried[n]))
            for n, start in self._reversals().items()
        )
        phases = (replace(p, screen=QUARTERS) for p in common if p.per_run and p.si == "rad")
        deviations = (_deviation(p) for p in common if p.name in self.by_run)
        for p in (*phases, *deviations, trigger, *(turns if self._remembers else ())):
            yield replace(p, name=f"{run}:{p.name}", start=own.get(p.name, p.start), run=run)

    def _reversals(self) -> dict[str, float]:
        """Return where a voltage had turned before a record unless the run has numbers of its own [V], by name."""
        low = -self.max_command if self.bipolar else 0.0
        return {name: low + share * (self.max_command - low) for name, share in REVERSALS.items()}

    def replace(self, values: Mapping[str, float]) -> AxisDynamics:
        """Return the model with some values changed, SI; a new natural frequency keeps the stiffness."""
        shared = {name: value for name, value in values.items() if name != DELAY and ":" not in name}
        own = {run: dict(numbers) for run, numbers in self.own.items()}
        for name, value in values.items():
            run, colon, number = name.rpartition(":")
            if colon:
                own.setdefault(run, {})[number] = value
        axis, delay = with_values(self.axis, shared), values.get(DELAY, self.delay)
        return replace(self, axis=axis, origin=self.first, delay=delay, own=own)

    def set_apart(self, runs: Iterable[str]) -> AxisDynamics:
        """Return the model with numbers of its own for each of some runs: where it began, and how late."""
        return replace(self, apart=tuple(runs))

    def refined(self, tolerance: float | None = None) -> AxisDynamics:
        """Return the model with steps found anew at its present values, perhaps for another tolerance."""
        steps = Steps(self.axis, self.delay)
        return replace(self, tolerance=tolerance or self.tolerance, steps=steps)

    def with_steps(self, finest: int, *, fixed: bool = False, tolerance: float | None = None) -> AxisDynamics:
        """Return the model with steps found anew: at most this number in a sample, or exactly this number.

        A tolerance takes the place of its own.
        """
        return replace(self, finest=finest, fixed=fixed, tolerance=tolerance or self.tolerance, steps=Steps())

    def with_effect(self, effect: Effect, name: str = "") -> AxisDynamics:
        """Return the model with an effect added, at its start values scaled to this stroke.

        Parameters
        ----------
        effect
            The effect; one of driver, sensor or controller sets the parameter that represents it.
        name
            Under which `flexdesign.effects.find` has it; by default its own.

        Raises
        ------
        InputError
            If the axis has it already, or the catalogue does not.
        """
        name = name or effect.name
        number = units_of.AXIS_FIELDS.get(name)
        if number is not None:
            start = effect.parameters[0].start
            assert start is not None
            return replace(self.replace({number: start}), steps=Steps(), origin=self.first)
        if effects.original(name) not in effects.names() and not name.endswith(".py"):
            raise InputError("model", name, None, f"is no effect{suggest(name, effects.names())}")
        if name in self.axis.effects:
            raise InputError("model", name, None, f"acts on axis {self.name} already")
        # Plausible ranges do not depend on the values given here.
        blank = {p.name: p.start if p.start is not None else 0.0 for p in effect.parameters}
        scaled = axis_parameters.of_effect(self.first, self.max_command, effect, name, blank)
        starts = {p.name.rpartition(".")[2]: p.start for p in scaled}
        values = {key: blank[key] if start is None else start for key, start in starts.items()}
        axis, origin = (replace(a, effects={**a.effects, name: values}) for a in (self.axis, self.first))
        return replace(self, axis=axis, origin=origin, steps=Steps())

    def predict(self, observation: Observation) -> Array:
        """Return what is expected of a run or of a frequency response, shaped as `measured` gives it.

        Of a run that is the reading that the recorded command gives [response], n values; NaN where the motion runs
        away. A record that begins at another command than zero is preceded by that command, held until the mode has
        settled. Of a frequency response it is the small-signal one at its working point [response/V], 2n values.

        Raises
        ------
        TypeError
            If the observation is neither.
        """
        if isinstance(observation, FrequencyResponse):
            return parts(self.response(observation))
        if not isinstance(observation, Run):
            raise TypeError("an axis predicts runs and frequency responses")
        return self._reading(observation, self.steps_for(observation))

    def response(self, measured: FrequencyResponse, frequencies: Array | None = None) -> NDArray[np.complex128]:
        """Return the response about the working point of a measured one, at its lines or other ones [response/V]."""
        axis = with_payload(self.first, self.axis, measured.payload)
        axis = axis if measured.command_is == "dac" else without_amplifier(axis)
        chain = self._chain if axis is self.axis else self._chain_of(axis)
        return axis_response.predict(chain, measured, self.delay, frequencies, axis.sensor.delay)

    def steps_for(self, run: Run) -> int:
        """Return the number of steps in a sample: with a margin what the first values need, but not too many."""

        def find() -> int:
            first = replace(self, axis=self.steps.at or self.axis, delay=self.steps.delay)
            found = first._simulate(run, None)
            return min(found.substeps * (self.margin if found.error > EXACT * self.tolerance else 1), self.finest)

        return self.finest if self.fixed else min(self.steps.of(run, find), self.finest)

    def integration_error(self, run: Run) -> float:
        """Return by how much the prediction changes with twice as many steps, rms [response]."""
        steps = self.steps_for(run)
        coarse, fine = (self._reading(run, count) for count in (steps, 2 * steps))
        return float(np.sqrt(np.mean((fine - coarse) ** 2)))

    def cut(self, run: Run) -> float:
        """Return how much the limits cut off the recorded command at most [V]."""
        return float(np.abs(self.command(run) - self._limit_command(run)).max())

    def unknown_start(self, run: Run) -> int:
        """Return how many samples at the start of a run depend on what happened before; zero if it begins settled.

        A command that moves as the record begins has moved before it, too, and so has one under which the response
        rings while it stands still. What the mode did then is unknown, and has decayed to a thousandth after this
        number of samples.
        """
        command, response, mode = self.command(run), run.measured(), self.first
        period = max(1, math.ceil(1 / (mode.natural_frequency * run.period)))
        reach, rings = float(np.ptp(command)), span(response[: period + 1]) > RINGS * span(response)
        stands = float(np.ptp(command[: period + 1])) <= STILL * reach
        if (abs(command[0]) <= 1e-3 * reach and not stands) or (stands and not rings):
            return 0
        lasts = self._decay(1e-3, mode.damping_ratio) + self.delay + self.axis.sensor.delay
        return min(math.ceil(lasts / run.period), len(command) // 2)

    def comparable(self, run: Run) -> Run:
        """Return a run with gaps (NaN) for what depends on what happened before the record."""
        unknown = self.unknown_start(run)
        if not unknown:
            return run
        response = run.measured().copy()
        response[:unknown] = np.nan
        return replace(run, columns={**run.columns, self.name: response})

    def command(self, run: Run) -> Array:
        """Return the command of this axis in a run [V], see `flexdesign.dynamics.axis.axis_run.command_of`."""
        return command_of(run, self.name, self.axis.driver.gain)

    # --- simulation ----------------------------------------------------------------------------------------------

    def _reading(self, run: Run, steps: int) -> Array:
        found, n = self._simulate(run, steps), len(run.time)
        return found.reading[0, -n:] if found.diverged is None else np.full(n, np.nan)

    def _limit_command(self, run: Run) -> Array:
        """Return the command of a run within the limits; none act on what was measured behind them."""
        return self.command(run) if is_at_stack(run) else np.clip(self.command(run), *stages.command_limits(self.axis))

    def _simulate(self, run: Run, steps: int | None) -> Response:
        own, at_stack = self.own.get(run.name, {}), is_at_stack(run)
        # Where a stage came from before a record, which is all hysteresis, may lie beyond the limits of the record.
        # A reading that is late is that of a command as late: what is between them does not change in time.
        late = (0.0 if at_stack else self.delay) + self.axis.sensor.delay
        command, delay = self._limit_command(run), late + own.get(TRIGGER, 0.0)
        # A record that began early begins later in a longer simulation: always by as many samples, so nothing jumps.
        early = math.ceil(-TRIGGERED_WITHIN[0] / run.period) if TRIGGER in own else 0
        lead, way = self._lead(run, own, float(command[0]))
        command, delay = np.concatenate([way, command, np.full(early, command[-1])]), delay + early * run.period
        more = {name: value for name, value in own.items() if name not in (TRIGGER, *REVERSALS)}
        more |= {name: self.axis.numbers[name] + more[name] for name in self.by_run if name in more}
        axis = with_payload(self.first, with_values(self.axis, more), run.payload)
        axis = without_amplifier(axis) if at_stack else axis
        return simulate(
            Stage((self._chain if axis is self.axis else self._chain_of(axis),)),
            {self.name: Loop(command)},
            run.period,
            delay=delay,
            between_samples=run.between_samples,
            tolerance=self.tolerance,
            substeps=steps,
            most_steps=self.finest,
            disturbances=self._disturbances(axis, run, len(command)),
            lead=lead,
        )

    def _lead(self, run: Run, own: Mapping[str, float], first: float) -> tuple[Lead | None, Array]:
        """Return the command before a record: in samples as long as the modes allow, then in those of the record.

        A run with numbers of its own comes from rest by way of two turning points, which is where its hysteresis,
        whatever the law, is from. The ways are so smooth that the mode hardly rings. The last one is as late as the
        record itself.
        """
        fastest = max(mode.frequency for mode in self._chain.modes)
        longest = min(1 / (STEPS_PER_PERIOD * self.first.natural_frequency), 1 / (SAMPLES_PER_PERIOD * fastest))
        period = run.period * max(1, int(longest / run.period))
        if run.name not in self.apart:
            lasts = self._decay(DECAYED, 0.5 * self.first.damping_ratio)
            return (Lead(np.full(math.ceil(lasts / period) + 1, first), period) if first else None), np.zeros(0)
        turns = [0.0, *(own.get(name, start) for name, start in self._reversals().items()), first]
        lasts = PERIODS_OF_A_WAY / self.first.natural_frequency
        samples = [max(8, math.ceil(lasts / each)) for each in (period, period, run.period)]
        ways = [a + (b - a) * smooth_way(n) for (a, b), n in zip(pairwise(turns), samples, strict=True)]
        if period == run.period:
            return None, np.concatenate(ways)
        return Lead(np.concatenate(ways[:-1]), period), ways[-1]

    def _disturbances(self, axis: AxisModel, run: Run, samples: int) -> Mapping[str, Array]:
        """Return what adds to the reading; nothing does before the record."""
        there = axis is not self.axis or self._is_disturbed
        added = stages.disturbance(self.name, axis, run.columns, run.time) if there else None
        return {} if added is None else {self.name: np.concatenate([np.zeros(samples - len(added)), added])}

    def _decay(self, share: float, damping_ratio: float) -> float:
        """Return the time after which a mode has decayed to a share [s]."""
        rate = 2 * math.pi * self.first.natural_frequency * min(damping_ratio, 1.0)
        longest = LONGEST_LEAD / self.first.natural_frequency
        return min(-math.log(share) / rate, longest) if rate > 0 else longest

    @cached_property
    def _remembers(self) -> bool:
        """Whether an effect has a memory of where the voltage had turned; that of modes and filters is short."""
        faces = (face for name in self.axis.effects for face in effects.find(name).faces)
        return any(isinstance(face, Block) and face.remembers for face in faces)

    @cached_property
    def _is_disturbed(self) -> bool:
        return stages.has_disturbance(self.axis)

    @cached_property
    def _chain(self) -> AxisChain:
        return self._chain_of(self.axis)

    def _chain_of(self, axis: AxisModel) -> AxisChain:
        # Readings in whole steps would hide small changes of a value from a fit; the rounding is noise to it.
        smooth = replace(axis, sensor=replace(axis.sensor, resolution=0.0))
        return stages.chain(self.name, smooth)


def _deviation(mean: Parameter) -> Parameter:
    """Return by how much a number of one run differs from its mean over runs; both together stay plausible."""
    low, high = (end - (mean.start or 0.0) for end in mean.plausible)
    return replace(mean, null=None, start=0.0, plausible=(low, high), screen=(), twin="")
