"""What commands of one axis may be: voltage, slew, current, bandwidth and sampling, each with where it comes from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from flexdesign.core.errors import InputError
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.axis.axis_model import COMPARED_TOLERANCE, AxisDynamics
from flexdesign.dynamics.stage_model import StageModel

#: Commands are whole multiples of this [V], so that a file holds exactly what was checked.
COMMAND_GRID = 1e-6
#: Commands reach beyond the highest resonance, and stay below Nyquist's frequency, by this ratio: it leaves room for
#: what lies above the one, and for the corner of a filter below the other.
ROOM = 1.25


@dataclass(frozen=True)
class Limits:
    """What the commands of an axis keep to.

    Parameters
    ----------
    low, high
        Lowest and highest command [V].
    slew
        Fastest change of the command [V/s]; infinite if nothing limits it.
    bandwidth
        No tone lies above it, and no edge is faster than its rise time, 0.35 / bandwidth [Hz].
    rate
        Samples per second [Hz].
    capacitance
        What a volt of the command charges: all stacks, times the driver's gain [F]; None if unknown.
    origin
        Where each of these comes from, in words.
    """

    low: float
    high: float
    slew: float
    bandwidth: float
    rate: float
    capacitance: float | None = None
    origin: Mapping[str, str] = field(default_factory=dict)

    @property
    def home(self) -> float:
        """Where every command begins and ends: zero, or the end of the range next to it [V]."""
        return min(max(0.0, self.low), self.high)

    @property
    def span(self) -> float:
        """Width of the range [V]."""
        return self.high - self.low

    @property
    def step(self) -> float:
        """Largest change from one sample to the next, less what rounding to the grid may add [V]."""
        return self.slew / self.rate - 2 * COMMAND_GRID

    def level(self, share: float) -> float:
        """Return a level, from 0 at the low end of the range to 1 at the high one [V]."""
        return self.low + share * self.span

    def current(self, slew: float) -> float | None:
        """Return the driver's current while the command changes so fast [A]; None if no capacitance is known."""
        return None if self.capacitance is None else self.capacitance * slew

    def dynamics(self, model: StageModel, name: str) -> AxisDynamics:
        """Return an axis as it is simulated on the bench, its stroke that of the limits."""
        max_command = max(abs(self.low), abs(self.high))
        return AxisDynamics(name, model.axes[name], max_command, COMPARED_TOLERANCE, delay=model.controller.delay)


def of_axis(
    model: StageModel,
    name: str,
    *,
    volts: tuple[float, float] | None = None,
    slew: float | None = None,
    current: float | None = None,
    bandwidth: float | None = None,
    rate: float | None = None,
) -> Limits:
    """Return what the commands of an axis keep to: the narrower of what model and user say.

    Parameters
    ----------
    model, name
        The stage and its axis.
    volts, slew, current, bandwidth, rate
        What the user states [V, V/s, A, Hz, Hz]; None where the model is to say.

    Raises
    ------
    InputError
        If no voltage range is known, what is asked lies outside of the model's, a current is stated of an unknown
        capacitance, sampling or bandwidth do not reach above the resonance, or the slew limit is finer than the grid
        of the commands.
    """
    axis, origin = model.axes[name], dict[str, str]()
    low, high, origin["volts"] = _volts(model, name, volts)
    capacitance = None
    if axis.actuator is not None and axis.actuator.capacitance is not None:
        capacitance = axis.actuator.capacitance * axis.actuator.count * abs(axis.driver.gain)
    rate, origin["rate"] = (rate, "--rate") if rate else (model.controller.rate, "controller.rate")
    slew, origin["slew"] = _slew(model, name, slew, current, capacitance)
    if slew / rate < 100 * COMMAND_GRID:
        remedy = f"allows {slew / rate:.2g} V per sample, less than commands resolve; allow more, or sample slower"
        raise _refused(model, origin["slew"], f"{slew:g} V/s", remedy)
    highest = max([axis.natural_frequency, *(mode.frequency for mode in axis.modes)])
    wanted, most = ROOM * highest, rate / (2 * ROOM)
    if most < wanted:
        fast = math.ceil(2 * ROOM * wanted - 1e-6)
        remedy = f"is too slow to see the resonance at {highest:.4g} Hz; sample at {fast} Hz or more"
        raise _refused(model, origin["rate"], f"{rate:g} Hz", remedy)
    if bandwidth is not None and not wanted <= bandwidth <= most:
        what = f"the resonance is at {highest:.4g} Hz, the sampling rate {rate:g} Hz"
        remedy = f"commands must reach from {wanted:.4g} Hz to at most {most:.4g} Hz ({what}); choose between"
        raise _refused(model, "--bandwidth", f"{bandwidth:g} Hz", remedy)
    origin["bandwidth"] = "--bandwidth" if bandwidth else f"{1 / (2 * ROOM):g} of the sampling rate"
    return Limits(low, high, slew, bandwidth or most, rate, capacitance, origin)


def slew_is_missing(model: StageModel, name: str, limits: Limits) -> InputError:
    """Return the error of a bench of which nobody said how fast its voltage may change: stacks crack, drivers trip."""
    known = 'or --current "50 mA"'
    if limits.capacitance is None:
        known += f' and axis.{name}.actuator.capacitance (--set axis.{name}.actuator.capacitance="3.6 uF")'
    remedy = (
        f'is missing: no command is written while nothing says how fast the voltage may change; give --slew "2000 V/s" '
        f"{known}; --slew none if nothing limits it"
    )
    return _refused(model, f"axis.{name}.driver.slew", None, remedy)


def _refused(model: StageModel, field: str, value: str | None, remedy: str) -> InputError:
    """Return the error of a limit: an option of the command line begins with two hyphens, a field of the model not."""
    return InputError(
        "command line" if field[:2] == "--" else f"{model.name or 'stage model'}.toml", field, value, remedy
    )


def _volts(model: StageModel, name: str, stated: tuple[float, float] | None) -> tuple[float, float, str]:
    """Return the lowest and the highest command [V], and where they come from."""
    low, high = stages.command_limits(model.axes[name])
    if stated is not None:
        first, last = stated
        if first >= last or first < low or last > high:
            remedy = (
                f"lies outside of {low:g} V to {high:g} V, what driver and actuator of axis {name} allow; stay within"
            )
            remedy = "the first must be the lower one" if first >= last else remedy
            raise _refused(model, "--volts", f"{first:g} V {last:g} V", remedy)
        return first, last, "--volts"
    if not math.isfinite(high - low):
        remedy = (
            'is missing, so no voltage is known to be safe; write voltage_range = ["0 V", "150 V"], or give --volts'
        )
        raise _refused(model, f"axis.{name}.actuator.voltage_range", None, remedy)
    return low, high, f"axis.{name}.actuator.voltage_range and driver.limits"


def _slew(
    model: StageModel, name: str, slew: float | None, current: float | None, capacitance: float | None
) -> tuple[float, str]:
    """Return the fastest change of a command [V/s], and where it comes from."""
    driver = model.axes[name].driver
    limits = {f"axis.{name}.driver.slew": driver.slew / abs(driver.gain)}
    if slew is not None:
        limits["--slew"] = slew
    if current is not None:
        if capacitance is None:
            remedy = 'is missing, so a current says nothing of the slew; write capacitance = "3.6 uF", or give --slew'
            raise _refused(model, f"axis.{name}.actuator.capacitance", None, remedy)
        limits["--current"] = current / capacitance
    slowest = min(limits, key=lambda key: limits[key])
    return limits[slowest], slowest
