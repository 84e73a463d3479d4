"""Experiments, the controllers that try them, variants of the stage, and published numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from flexdesign.core import units
from flexdesign.core.errors import suggest
from flexdesign.core.toml_files import Bounds, Table, in_si
from flexdesign.dynamics.trajectories import Trajectory

#: Controllers that every study knows.
KNOWN = {
    "open loop": "the command is the reference over the secant gain",
    "feedforward": "static inverse of the model, hysteresis undone; ahead by half a sample, delay and driver's lag",
    "ziegler-nichols": "PID by the classical rule, from the ultimate gain of the model's sampled loop",
    "ziegler-nichols by experiment": "the same, from the oscillation of the simulated stage, hysteresis included",
    "robust": "PID of the smallest worst-case error integral whose sensitivity stays below a limit; alone its integral "
    "part alone sees the reference; with a feedforward the whole PID does",
}
#: Those that give a command; the others are feedbacks.
COMMANDS = ("open loop", "feedforward")
#: Keys of the file itself that the command line may change.
SETTINGS = ("title", "robust_ms", "cycled")
#: The stage as its file has it.
AS_MODELLED = "as modelled"
#: Measures by name, and their SI units.
MEASURES = {
    "loop_span": "m",
    "loop_width": "m",
    "loop_width_relative": "1",
    "secant_gain": "m/V",
    "rise_time": "s",
    "overshoot": "m",
    "settling_time": "s",
    "steady_error": "m",
    "max_error": "m",
    "max_error_relative": "1",
    "rms_error": "m",
    "lag": "s",
    "max_contour_error": "m",
    "rms_contour_error": "m",
    "coupling": "1",
    "coupled_motion": "m",
    "amplitude": "m",
}


def _gain(given: object) -> float | tuple[float]:
    """Read a proportional gain: in volts per metre, or as a bare number that needs the gain of its plant."""
    if isinstance(given, str):
        return units.from_text(given, "V/m")
    return (Bounds("1", -1e9, 1e9).read(given),)


class Gains(Table):
    """Numbers of one PID, as eq (33) of Lin et al. (2019) has them.

    `kp` is a voltage per length, or a bare number that belongs to a plant of the static gain `plant_gain`: it is then
    scaled so that the gain around the loop is the same.
    """

    plant_gain: in_si("1", 1e-9, 1e9) | None = None  # type: ignore[valid-type]
    kp: Annotated[Any, BeforeValidator(_gain)] = Field(examples=['kp = "0.05 V/um"'])
    ti: in_si("s", 0.0, 1e6, exclusive=True) = float("inf")  # type: ignore[valid-type]
    td: in_si("s", 0.0, 1e3) = 0.0  # type: ignore[valid-type]

    @field_validator("kp")
    @classmethod
    def _has_a_plant(cls, kp: Any, others: ValidationInfo) -> Any:
        has_plant = others.data.get("plant_gain") is not None
        if isinstance(kp, tuple) and not has_plant:
            raise ValueError('without a unit it needs plant_gain; or write for example kp = "0.05 V/um"')
        if not isinstance(kp, tuple) and has_plant:
            raise ValueError("has a unit, so that plant_gain means nothing; leave one of them out")
        return kp

    def in_volts(self, gain: float) -> float:
        """Return the gain for a stage of a static gain [m/V], in volts per metre."""
        if isinstance(self.kp, tuple):
            return float(self.kp[0] * (self.plant_gain or 1.0) / gain)
        return float(self.kp)


class ControllerTable(Table):
    """A PID with given numbers, axis by axis."""

    axis: Mapping[str, Gains] = Field(examples=['axis.x = { kp = "0.05 V/um", ti = "4 ms", td = "1 ms" }'])
    source: str = ""


class Variant(Table):
    """The stage with some numbers changed.

    `controllers_know` states whether feedforward and tuning are made for the changed stage or for the one they believe.
    """

    set: tuple[str, ...] = Field(examples=['set = ["axis.x.damping_ratio=0.02"]'])
    controllers_know: bool = True
    note: str = ""


class Published(Table):
    """A number that somebody printed, and which of ours it is to be compared with.

    Where `comparable` is false ours is another quantity, or one that was set to the printed one: it is listed
    for its size alone. A `bound` says that only a limit was printed.
    """

    measure: str = Field(examples=['measure = "overshoot"'])
    value: str = Field(examples=['value = "30 um"'])
    place: str = Field(examples=['place = "section 4.3, Fig 13"'])
    axis: str = ""
    controller: str = ""
    uncertainty: str = ""
    bound: Literal["", "below"] = ""
    comparable: bool = True
    note: str = ""

    @field_validator("measure")
    @classmethod
    def _require_known(cls, measure: str) -> str:
        if measure not in MEASURES:
            raise ValueError(f"is not a known measure{suggest(measure, list(MEASURES))}")
        return measure

    @field_validator("value", "uncertainty")
    @classmethod
    def _has_its_unit(cls, text: str, others: ValidationInfo) -> str:
        if text and "measure" in others.data:
            units.from_text(text, MEASURES[others.data["measure"]])
        return text

    @property
    def si(self) -> float:
        """The number in SI."""
        return units.from_text(self.value, MEASURES[self.measure])

    @property
    def half_width(self) -> float | None:
        """Its uncertainty in SI, or None."""
        return units.from_text(self.uncertainty, MEASURES[self.measure]) if self.uncertainty else None


class Experiment(Table):
    """One thing that is tried: axes that follow a command [V] or a reference [m], under some controllers."""

    name: str = Field(examples=['name = "step"'])
    title: str = ""
    note: str = ""
    axes: tuple[str, ...] = Field(examples=['axes = ["x"]'])
    command: Trajectory | None = None
    reference: Trajectory | None = None
    controllers: tuple[str, ...] = ("open loop",)
    variants: tuple[str, ...] = (AS_MODELLED,)
    published: tuple[Published, ...] = ()

    @field_validator("name")
    @classmethod
    def _can_name_files(cls, name: str) -> str:
        if not any(character.isalnum() for character in name):
            raise ValueError("needs a letter or a digit; figures are named after it")
        if len(name) > 60:
            raise ValueError("has more than 60 letters; figures are named after it")
        return name

    @field_validator("axes", "controllers", "variants")
    @classmethod
    def _each_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if not names:
            raise ValueError("names none; name one or more")
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ValueError(f"names {twice} twice; name it once")
        return names

    @field_validator("command", "reference")
    @classmethod
    def _fits(cls, given: Trajectory | None, others: ValidationInfo) -> Trajectory | None:
        if given is None:
            return None
        is_command = others.field_name == "command"
        if given.si != ("V" if is_command else "m"):
            raise ValueError(
                "is in metres, and a command is in volts; give volts, or name it reference"
                if is_command
                else "is in volts, and a reference is in metres; give micrometres, or name it command"
            )
        named = others.data.get("axes", ())
        if given.axes not in (1, len(named)):
            raise ValueError(
                f"moves {given.axes} axes, and axes names {len(named)} ({', '.join(named)}); name them all"
            )
        return given

    @model_validator(mode="after")
    def _is_one_thing(self) -> Experiment:
        if self.command is not None and self.reference is not None:
            raise ValueError("has a command and a reference; keep one of them")
        if self.command is None and self.reference is None:
            raise ValueError("has neither a command, in volts, nor a reference, in micrometres; give one of them")
        if self.command is not None and self.controllers != ("open loop",):
            raise ValueError("has controllers, which need a reference; a command in volts goes to the stage as it is")
        return self

    @property
    def trajectory(self) -> Trajectory:
        """The command or the reference."""
        found = self.command if self.command is not None else self.reference
        assert found is not None
        return found


@dataclass(frozen=True)
class Plan:
    """Experiments, with what they name.

    Parameters
    ----------
    name, title, note
        Of the file.
    experiments
        In order.
    variants, controllers
        By name, in addition to those that every study knows.
    robust_ms
        Limit of the largest sensitivity for the ``robust`` controller.
    cycled
        Whether the stage was cycled over its whole range before, and its rest is where motion counts zero; otherwise
        its piezos were never driven.
    file
        Where it was read, for messages.
    """

    name: str
    title: str
    note: str
    experiments: tuple[Experiment, ...]
    variants: Mapping[str, Variant]
    controllers: Mapping[str, ControllerTable]
    robust_ms: float
    cycled: bool
    file: str = "standard experiments"

    def variants_in_use(self) -> dict[str, Variant]:
        """Return the variants that some experiment names."""
        named = {name for experiment in self.experiments for name in experiment.variants}
        return {name: variant for name, variant in self.variants.items() if name in named}


def pieces(controller: str) -> list[str]:
    """Return what a controller such as ``"feedforward + robust"`` consists of."""
    return [piece.strip() for piece in controller.split("+")]
