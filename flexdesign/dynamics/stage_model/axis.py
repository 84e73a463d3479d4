"""One axis of a stage: mechanics, actuator, driver, sensor, what else acts on it, and how well all that is known."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields

from flexdesign import effects
from flexdesign.core.model import PIEZO
from flexdesign.dynamics.stage_model.response_units import ResponseUnits

#: How far a stated natural frequency may be from that of mass and stiffness, relative: each may be off by half a unit
#: in the third digit, 0.5 %, and half of mass's and stiffness's errors add to the frequency's own.
AGREEMENT = 0.01
#: Decades of decay after which a mode has rung down.
DECAY_DECADES = 3.0


class Contradiction(ValueError):
    """Numbers of one axis that cannot be true together.

    Parameters
    ----------
    field
        The field of the axis that the remedy speaks of.
    remedy
        What is wrong, and what to do about it.
    """

    def __init__(self, field: str, remedy: str) -> None:
        self.field, self.remedy = field, remedy
        super().__init__(f"{field} {remedy}")


@dataclass(frozen=True)
class Mode:
    """A further mode of an axis, in addition to the main one.

    Parameters
    ----------
    frequency, damping_ratio
        Undamped natural frequency [Hz] and damping ratio [1].
    share
        The part of the static response it carries [1]; negative where it moves the output against the drive.
    """

    frequency: float
    damping_ratio: float
    share: float


@dataclass(frozen=True)
class Driver:
    """The voltage amplifier.

    Parameters
    ----------
    gain
        Voltage at the stack per command [V/V].
    bandwidth
        -3 dB frequency with the stack connected [Hz].
    slew
        Fastest change of the voltage at the stack [V/s].
    limits
        Lowest and highest voltage at the stack [V]; None if nothing limits it.
    """

    gain: float = 1.0
    bandwidth: float = math.inf
    slew: float = math.inf
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Sensor:
    """The position sensor; its numbers are in the unit of the response.

    Parameters
    ----------
    bandwidth
        -3 dB frequency [Hz].
    noise
        Standard deviation of a reading at rest.
    resolution
        Step between neighbouring readings.
    range
        Lowest and highest reading; None if unknown.
    linearity
        Half-width of the calibration's error; not simulated, but used where measurements are compared.
    source
        Where these numbers come from.
    delay
        How late readings are [s].
    """

    bandwidth: float = math.inf
    noise: float = 0.0
    resolution: float = 0.0
    range: tuple[float, float] | None = None
    linearity: float = 0.0
    source: str = ""
    delay: float = 0.0


@dataclass(frozen=True)
class ActuatorData:
    """What drives an axis: piezo stacks, each as its data sheet has it, or the applicable values of another actuator.

    Parameters
    ----------
    free_stroke, voltage_range
        Extension when nothing holds it [`stroke_si`], None if unknown, and the voltages between which it is reached
        [V].
    stiffness, contact_stiffness
        Of the stack alone, and of both its seats together, in series with it [N/m].
    capacitance
        [F].
    preload
        Compressive force at rest [N].
    count
        How many stacks work in parallel on this axis.
    stroke_si
        SI unit of the free stroke: a length, or the unit of the axis' response.
    kind
        One of `flexdesign.core.model.ACTUATORS`; empty if not stated.
    """

    free_stroke: float | None = None
    voltage_range: tuple[float, float] | None = None
    stiffness: float | None = None
    capacitance: float | None = None
    preload: float | None = None
    contact_stiffness: float | None = None
    count: int = 1
    stroke_si: str = "m"
    kind: str = ""


@dataclass(frozen=True)
class AxisModel:
    """One axis, in SI.

    Parameters
    ----------
    natural_frequency, damping_ratio
        Of the main mode, undamped [Hz] and [1]. It carries the part of the static response that `modes` leave.
    gain
        k_v of eq (26): the coefficient of the voltage [response/V], not the secant of the loop; signed. NaN if unknown:
        such a model can be written, for people to complete, but not read.
    response
        SI unit of what is measured: ``"m"``, ``"rad"``, or ``"V"`` for an electronic analogue.
    unit
        That in which people want to read it, such as ``"mrad"``; empty for the usual ones.
    mass, stiffness
        Lumped at the output [kg], [N/m]; together they give `natural_frequency`. Both or none.
    modes
        Further modes.
    effects
        Effects by name, each with the values of all its parameters.
    driver, sensor, actuator
        What the axis is driven and seen by.
    input_stiffness, amplification
        At the actuator with the output free [N/m], and output motion per extension [1], signed; from FEM.
    uncertainty
        Relative standard deviations by the names that `numbers` has.
    assumed
        Names of the numbers that nobody measured or computed.
    fitted
        Measures of experiments that its numbers were set to give: what is printed of those cannot test them.
    sources
        Where numbers come from, by their names or those of their tables.

    Raises
    ------
    Contradiction
        If mass comes without stiffness, both disagree with the natural frequency, or the modes leave nothing to the
        main one.
    """

    natural_frequency: float
    damping_ratio: float
    gain: float
    response: str = "m"
    unit: str = ""
    mass: float | None = None
    stiffness: float | None = None
    modes: tuple[Mode, ...] = ()
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    driver: Driver = Driver()
    sensor: Sensor = Sensor()
    actuator: ActuatorData | None = None
    input_stiffness: float | None = None
    amplification: float | None = None
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    fitted: tuple[str, ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.mass is None or self.stiffness is None:
            for name, other in (("mass", self.stiffness), ("stiffness", self.mass)):
                if other is not None:
                    raise Contradiction(name, "is missing; give mass and stiffness, or natural_frequency alone")
        else:
            lumped = lumped_frequency(self.mass, self.stiffness)
            if abs(self.natural_frequency / lumped - 1) > AGREEMENT:
                remedy = f"disagrees with mass and stiffness, which give {lumped:.5g} Hz; change those, or leave it out"
                raise Contradiction("natural_frequency", remedy)
        if self.main_share <= 0:
            given = f"{100 * (1 - self.main_share):.4g} %"
            raise Contradiction("modes", f"carry {given} of the response; something must be left to the main mode")

    @property
    def response_units(self) -> ResponseUnits:
        """The SI unit of the response, which knows in which units sizes of it are written."""
        return ResponseUnits(self.response, self.unit)

    @property
    def driven_by(self) -> str:
        """The class of its actuator, by which remedies differ: as stated, or a stack where numbers of one are.

        Empty where the model says neither, as it may then be anything that turns volts into motion.
        """
        if self.actuator is None:
            return ""
        of_stacks = ("stiffness", "contact_stiffness", "capacitance", "preload")
        is_stack = any(getattr(self.actuator, name) is not None for name in of_stacks)
        return self.actuator.kind or (PIEZO if is_stack else "")

    @property
    def absent(self) -> tuple[str, ...]:
        """What every piezo stack, sensor or driver has and this axis has not: it is assumed to be none, in words.

        Empty for an axis that is not said to have a stack.
        """
        if self.driven_by != PIEZO:
            return ()
        there = {
            "hysteresis": any(effects.find(name).is_hysteresis for name in self.effects),
            "creep": "creep" in self.effects,
            "sensor noise": self.sensor.noise > 0,
            "driver bandwidth": math.isfinite(self.driver.bandwidth) or "driver_bandwidth" in self.effects,
        }
        return tuple(name for name, has in there.items() if not has)

    @property
    def main_share(self) -> float:
        """The part of the static response that the main mode carries [1]."""
        return 1.0 - math.fsum(mode.share for mode in self.modes)

    @property
    def settling_time(self) -> float:
        """How long the main mode takes to decay by three decades [s].

        >>> round(AxisModel(118.3, 0.0242, 2e-6).settling_time, 3)
        0.384
        """
        rate = 2 * math.pi * self.natural_frequency * min(max(self.damping_ratio, 1e-3), 1.0)
        return DECAY_DECADES * math.log(10) / rate

    def prior(self, names: Collection[str]) -> dict[str, tuple[float, float]]:
        """Return what is known of some numbers: value and standard deviation, SI.

        The natural frequency may be known through mass and stiffness: relative errors of both, halved and added in
        squares.

        >>> AxisModel(100.0, 0.02, 2e-6, uncertainty={"gain": 0.1}).prior(["gain", "damping_ratio"])
        {'gain': (2e-06, 2e-07)}
        """
        relative = dict(self.uncertainty)
        lumped = [relative[part] for part in ("mass", "stiffness") if part in relative]
        if lumped:
            relative.setdefault("natural_frequency", 0.5 * math.hypot(*lumped))
        known = {name: (self.numbers[name], relative[name]) for name in names if name in relative}
        return {
            name: (value, abs(value) * sigma)
            for name, (value, sigma) in known.items()
            if value
            and sigma
            and name not in self.assumed
            and not name.endswith(".rest")  # each record begins elsewhere
        }

    def still_assumed(self, known: Collection[str]) -> tuple[str, ...]:
        """Return what stays assumed once some numbers are known; of a whole table the numbers that are left."""
        left: list[str] = []
        for name in self.assumed:
            members = [number for number in self.numbers if number == name or number.startswith(f"{name}.")]
            named = any(member in known for member in members)
            left += [member for member in members if member not in known] if named else [name]
        return tuple(left)

    @property
    def numbers(self) -> dict[str, float]:
        """Every single number by its dotted name: ``gain``, ``modes.1.share``, ``bouc_wen.a``, ``sensor.noise``."""
        return dict(self._numbers())

    def _numbers(self) -> Iterator[tuple[str, float]]:
        tables: list[tuple[str, object]] = [("", self)]
        tables += [(f"modes.{i}.", mode) for i, mode in enumerate(self.modes, start=1)]
        tables += [("driver.", self.driver), ("sensor.", self.sensor)]
        tables += [("actuator.", self.actuator)] if self.actuator else []
        for prefix, table in tables:
            for each in fields(table):  # type: ignore[arg-type]
                value = getattr(table, each.name)
                if isinstance(value, (int, float)):
                    yield prefix + each.name, float(value)
        for effect, values in self.effects.items():
            for name, value in values.items():
                yield f"{effect}.{name}", value


def lumped_frequency(mass: float, stiffness: float) -> float:
    """Return the natural frequency [Hz] of a mass [kg] on a spring [N/m].

    >>> round(lumped_frequency(0.0342, 18.3e3), 2)
    116.42
    """
    return math.sqrt(stiffness / mass) / (2 * math.pi)
