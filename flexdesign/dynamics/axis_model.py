"""One axis of a stage as a model that a fit can move: its numbers by name, and what they predict of a recorded run.

The command of a run is simulated open loop, as it was recorded. A fit differentiates the prediction by finite
differences, so that the number of steps in a sample may not change from one trial to the next: it is found once for
each run, from the error estimate, and kept by all models that come of the first one by new values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.dynamics import stage as stages
from flexdesign.dynamics.chain import AxisChain
from flexdesign.dynamics.simulate import Loop, Response, Stage, simulate
from flexdesign.errors import InputError, suggest
from flexdesign.model import Effect, Observation, Parameter
from flexdesign.runs import AXES, Run
from flexdesign.stage_model import AxisModel
from flexdesign.stage_model import fields as units_of

Array = NDArray[np.float64]
#: Error that a prediction may have, relative to its span: far below the noise of any sensor.
TOLERANCE = 1e-7
#: The number of steps found at the first values is multiplied by this, as other values may ask for more.
MARGIN = 2
#: Below this share of the tolerance a prediction is exact, and needs no margin.
EXACT = 1e-3
#: A mode at half its damping has decayed to this share of the first command's response before a record begins.
SETTLED = 1e-4
#: A response that moves by more than this share of its span, while its command stands still, rings from before.
RINGS = 0.05
#: A command that moves less than this share of its span in the first period of the mode stands still.
STILL = 0.01
#: Periods of the mode after which it is taken to have settled, however small its damping.
LONGEST_LEAD = 1000.0
#: How late commands act, as the stage model's file calls it; a number of the stage, not of the axis.
DELAY = "controller.delay"
#: No controller is later than this [s].
LONGEST_DELAY = 0.05
#: The stroke for which the catalogue states plausible values of what is measured per length [m].
CATALOGUE_STROKE = 1e-4


class Steps:
    """The number of steps in a sample for each run, found when it is first asked for; safe among threads.

    Parameters
    ----------
    at, delay
        The numbers with which it is found; by default those of the first model that has these steps.
    """

    def __init__(self, at: AxisModel | None = None, delay: float = 0.0) -> None:
        self.at, self.delay = at, delay
        self._found: dict[Observation, int] = {}
        self._lock = Lock()

    def of(self, run: Observation, find: Callable[[], int]) -> int:
        """Return the number for a run; `find` is called the first time."""
        with self._lock:
            if run not in self._found:
                self._found[run] = find()
            return self._found[run]


@dataclass(frozen=True, eq=False)
class AxisDynamics:
    """The signal chain of one axis, a `flexdesign.model.Model` of runs; immutable.

    Parameters
    ----------
    name
        The axis.
    axis
        Its numbers.
    volts
        Largest command that is expected [V]; with the gain it gives the stroke, on which plausible ranges hang.
    tolerance
        Error allowed in a prediction, relative to its span.
    origin
        The numbers about which ranges are plausible: those of the first model; by default `axis`.
    steps
        Numbers of steps found so far; by default none.
    delay
        How late commands act [s].
    """

    name: str
    axis: AxisModel
    volts: float = 100.0
    tolerance: float = TOLERANCE
    origin: AxisModel | None = None
    steps: Steps = field(default_factory=Steps, repr=False)
    delay: float = 0.0

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
        return abs(self.first.gain * self.first.driver.gain) * self.volts

    def parameters(self) -> tuple[Parameter, ...]:
        """Return every number that the prediction depends on, named as in `AxisModel.numbers`, and the delay.

        The mass is none of them: it follows from stiffness and natural frequency.
        """
        numbers = {**self.axis.numbers, DELAY: self.delay}
        made = [*self._mechanics(), *self._electronics()]
        for name, values in self.axis.effects.items():
            made += self._effect(effects.find(name), name, values)
        return tuple(replace(each, start=numbers.get(each.name, each.start)) for each in made)

    def replace(self, values: Mapping[str, float]) -> AxisDynamics:
        """Return the model with some values changed, SI; a new natural frequency keeps the stiffness."""
        own = {name: value for name, value in values.items() if name != DELAY}
        return replace(self, axis=changed(self.axis, own), origin=self.first, delay=values.get(DELAY, self.delay))

    def refined(self, tolerance: float | None = None) -> AxisDynamics:
        """Return the model with steps found anew at its present values, perhaps for another tolerance."""
        return replace(self, tolerance=tolerance or self.tolerance, steps=Steps(self.axis, self.delay))

    def with_effect(self, effect: Effect) -> AxisDynamics:
        """Return the model with an effect of the catalogue added, at its start values scaled to this stroke.

        Raises
        ------
        InputError
            If the axis has it already, the catalogue does not, or it is a number of driver or sensor.
        """
        if effect.name in units_of.ELSEWHERE:
            raise InputError("model", effect.name, None, f"is {units_of.ELSEWHERE[effect.name]}; change that")
        if effect.name not in effects.names():
            raise InputError("model", effect.name, None, f"is no effect{suggest(effect.name, effects.names())}")
        if effect.name in self.axis.effects:
            raise InputError("model", effect.name, None, f"acts on axis {self.name} already")
        # Plausible ranges do not depend on the values given here.
        blank = {p.name: p.start if p.start is not None else 0.0 for p in effect.parameters}
        starts = {p.name.rpartition(".")[2]: p.start for p in self._effect(effect, effect.name, blank)}
        values = {name: blank[name] if start is None else start for name, start in starts.items()}
        axis, origin = (replace(a, effects={**a.effects, effect.name: values}) for a in (self.axis, self.first))
        return AxisDynamics(self.name, axis, self.volts, self.tolerance, origin, delay=self.delay)

    def predict(self, observation: Observation) -> Array:
        """Return the reading that the recorded command gives [response], n values; NaN where the motion runs away.

        A record that begins at another command than zero is preceded by that command, held until the mode has
        settled.

        Raises
        ------
        TypeError
            If the observation is no `Run`.
        """
        if not isinstance(observation, Run):
            raise TypeError("an axis predicts runs")
        reading, _ = self._reading(observation, self.steps_for(observation))
        return reading

    def steps_for(self, run: Run) -> int:
        """Return the number of steps in a sample: with a margin what the first values need."""

        def find() -> int:
            first = replace(self, axis=self.steps.at or self.axis, delay=self.steps.delay)
            found = first._simulated(run, None)
            return found.substeps * (MARGIN if found.error > EXACT * self.tolerance else 1)

        return self.steps.of(run, find)

    def integration_error(self, run: Run) -> float:
        """Return by how much the prediction changes with twice as many steps, rms [response]."""
        steps = self.steps_for(run)
        coarse, fine = (self._reading(run, count)[0] for count in (steps, 2 * steps))
        return float(np.sqrt(np.mean((fine - coarse) ** 2)))

    def cut(self, run: Run) -> float:
        """Return how much the limits cut off the recorded command at most [V]."""
        return self._reading(run, self.steps_for(run))[1]

    def unknown_start(self, run: Run) -> int:
        """Return how many samples at the start of a run depend on what happened before; zero if it begins settled.

        A command that moves as the record begins has moved before it, too, and so has one under which the response
        rings while it stands still. What the mode did then is unknown, and has decayed to a thousandth after so many
        samples.
        """
        command, response, mode = self.command(run), run.measured(), self.first
        period = max(1, math.ceil(1 / (mode.natural_frequency * run.period)))
        span, rings = float(np.ptp(command)), float(np.ptp(response[: period + 1])) > RINGS * float(np.ptp(response))
        stands = float(np.ptp(command[: period + 1])) <= STILL * span
        if (abs(command[0]) <= 1e-3 * span and not stands) or (stands and not rings):
            return 0
        lasts = self._decay(1e-3, mode.damping_ratio) + self.delay
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
        """Return the command of this axis in a run [V]."""
        return run.columns[command_column(run, self.name)]

    # --- simulation ----------------------------------------------------------------------------------------------

    def _reading(self, run: Run, steps: int) -> tuple[Array, float]:
        found = self._simulated(run, steps)
        if found.diverged is not None:
            return np.full(len(run.time), np.nan), math.nan
        return found.reading[0, -len(run.time) :], float(np.abs(found.cut).max())

    def _simulated(self, run: Run, steps: int | None) -> Response:
        command = self.command(run)
        if command[0] != 0:
            lead = math.ceil(self._decay(SETTLED, 0.5 * self.first.damping_ratio) / run.period)
            command = np.concatenate([np.full(lead, command[0]), command])
        return simulate(
            Stage((self._chain(),), limits={self.name: stages.limits(self.axis)}),
            {self.name: Loop(command)},
            run.period,
            delay=self.delay,
            between_samples=run.between_samples,
            tolerance=self.tolerance,
            substeps=steps,
        )

    def _decay(self, share: float, damping_ratio: float) -> float:
        """Return the time after which a mode has decayed to a share [s]."""
        rate = 2 * math.pi * self.first.natural_frequency * min(damping_ratio, 1.0)
        longest = LONGEST_LEAD / self.first.natural_frequency
        return min(-math.log(share) / rate, longest) if rate > 0 else longest

    def _chain(self) -> AxisChain:
        # Readings in whole steps would hide small changes of a value from a fit; the rounding is noise to it.
        smooth = replace(self.axis, sensor=replace(self.axis.sensor, resolution=0.0))
        return stages.chain(self.name, smooth)

    # --- parameters ----------------------------------------------------------------------------------------------

    def _mechanics(self) -> list[Parameter]:
        first = self.first
        si, unit = f"{first.response}/V", f"{units_of.RESPONSES[first.response][1]}/V"
        low, high = sorted((0.1 * first.gain, 10 * first.gain))
        made = [
            _frequency("natural_frequency", "natural frequency of the main mode", first.natural_frequency),
            _damping("damping_ratio", "damping ratio of the main mode"),
            Parameter("gain", si, unit, "response per voltage, before hysteresis", plausible=(low, high)),
        ]
        for i, mode in enumerate(first.modes, start=1):
            made += [
                _frequency(f"modes.{i}.frequency", "natural frequency of a further mode", mode.frequency),
                _damping(f"modes.{i}.damping_ratio", "damping ratio of a further mode"),
                Parameter(f"modes.{i}.share", "1", "%", "part of the static response", 0.0, plausible=(-1.0, 1.0)),
            ]
        return made

    def _electronics(self) -> list[Parameter]:
        low, high = sorted((0.1 * self.first.driver.gain, 10 * self.first.driver.gain))
        made = [Parameter("driver.gain", "1", "", "voltage at the stack per command", plausible=(low, high))]
        acting = (("driver.bandwidth", "driver_bandwidth"), ("driver.slew", "driver_slew"))
        for name, effect in (*acting, ("sensor.bandwidth", "sensor_bandwidth")):
            made.append(replace(effects.find(effect).parameters[0], name=name))
        return [*made, Parameter(DELAY, "s", "ms", "how late commands act", 0.0, plausible=(0.0, LONGEST_DELAY))]

    def _effect(self, effect: Effect, name: str, values: Mapping[str, float]) -> list[Parameter]:
        """Return the parameters of an effect in the units of this response, ranges and starts scaled to its stroke."""
        first = self.first.effects.get(name, values)
        power, _ = units_of.POWER_LAWS.get(name, ("", ()))
        exponent = first.get(power, 1.0)
        fields = units_of.effect(name, self.first.response, exponent)
        own = self._hysteresis(exponent).get(name, {})
        made = []
        for p in effect.parameters:
            scale = (self.stroke / CATALOGUE_STROKE) ** _powers_of_length(p.si)
            low, high, start = own.get(p.name, (p.plausible[0] * scale, p.plausible[1] * scale, p.start))
            if start is not None and p.name not in own:
                start *= scale
            number = fields[p.name]
            made.append(
                replace(p, name=f"{name}.{p.name}", si=number.si, unit=number.unit, plausible=(low, high), start=start)
            )
        return made

    def _hysteresis(self, exponent: float) -> dict[str, dict[str, tuple[float, float, float]]]:
        """Return low, high and start of what sets the size and the bend of a loop, scaled to gain, voltage and stroke.

        A Bouc-Wen loop takes up to the whole gain, and bends into saturation within a thousandth to a thousand times
        the voltage range; the start is a tenth of the gain, bent at the voltage itself. It rests within the stroke.
        """
        gain, volts, stroke = self.stroke / self.volts, self.volts, self.stroke
        rate, stiff = stroke ** (1 - exponent) / volts, stroke**-exponent
        return {
            "bouc_wen": {
                "a": (1e-4 * gain, 2.0 * gain, 0.1 * gain),
                "b": (1e-3 * rate, 1e3 * rate, rate),
                "c": (-10.0 * rate, 10.0 * rate, 0.0),
                "rest": (-stroke, stroke, 0.0),
            },
            "hysteretic_spring": {"gamma": (0.0, 10.0 * stiff, stiff), "delta": (-10.0 * stiff, 10.0 * stiff, 0.0)},
        }


def changed(axis: AxisModel, values: Mapping[str, float]) -> AxisModel:
    """Return an axis with some of its numbers replaced, by their dotted names, SI.

    A new natural frequency keeps the stiffness and changes the mass; of a further mode all numbers are its own.

    Raises
    ------
    KeyError
        If the axis has no such number.
    """
    own: dict[str, Any] = {}
    tables: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        table, _, key = name.rpartition(".")
        if name not in axis.numbers and table not in axis.effects:
            raise KeyError(name)
        if table:
            tables.setdefault(table, {})[key] = value
        else:
            own[name] = value
    if axis.stiffness is not None and "natural_frequency" in own:
        own["mass"] = axis.stiffness / (2 * math.pi * own["natural_frequency"]) ** 2
    modes = tuple(replace(mode, **tables.pop(f"modes.{i}", {})) for i, mode in enumerate(axis.modes, start=1))
    driver, sensor = (replace(getattr(axis, key), **tables.pop(key, {})) for key in ("driver", "sensor"))
    acting = {name: {**given, **tables.get(name, {})} for name, given in axis.effects.items()}
    return replace(axis, **own, modes=modes, driver=driver, sensor=sensor, effects=acting)


def of_axis(run: Run, name: str, axis: AxisModel) -> Run:
    """Return what a run holds of one axis: its command and its response.

    Raises
    ------
    InputError
        If the axis is none that runs know, or the run lacks its command or response, or has it in another unit.
    """
    if name not in AXES:
        raise InputError("model", f"axis.{name}", None, f"runs hold the axes {', '.join(AXES)}; name it one of these")
    if name not in run.responses:
        there = f"there is {', '.join(run.responses)}"
        raise InputError(run.name, name, None, f"the run has no response of axis {name}; {there}: leave the run out")
    if run.si[name] != axis.response:
        remedy = f"the model's axis {name} responds in {axis.response} (the unit of its gain); correct one of the two"
        raise InputError(run.name, name, f"in {run.si[name]}", remedy)
    column = command_column(run, name)
    return replace(run, columns={column: run.columns[column], name: run.columns[name]})


def command_column(run: Run, name: str) -> str:
    """Return the name of the column that commands an axis: u, or ux and so on.

    Raises
    ------
    InputError
        If there is none.
    """
    for column in ("u", f"u{name}"):
        if column in run.columns:
            return column
    there = f"there is {', '.join(run.commands)}"
    raise InputError(run.name, f"u{name}", None, f"the run has no command of axis {name}; {there}: leave the run out")


def _frequency(name: str, meaning: str, value: float) -> Parameter:
    return Parameter(name, "Hz", "Hz", meaning, plausible=(value / 3, 3 * value), scale="log")


def _damping(name: str, meaning: str) -> Parameter:
    return Parameter(name, "1", "", meaning, plausible=(1e-4, 2.0), scale="log")


def _powers_of_length(si: str) -> int:
    """Return the power of the metre in a unit of the catalogue.

    >>> [_powers_of_length(si) for si in ("m/V", "1/m^2", "1/V", "Hz")]
    [1, -2, 0, 0]
    """
    return {"m": 1, "m/V": 1, "1/m": -1, "1/m^2": -2, "1/m^3": -3}.get(si, 0)
