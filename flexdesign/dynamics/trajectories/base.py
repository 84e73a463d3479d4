"""What all trajectories share: levels in volts or metres, the choice of a shape, sampling."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self, get_args

import numpy as np
from pydantic import (
    BeforeValidator,
    InstanceOf,
    ModelWrapValidatorHandler,
    PlainSerializer,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from flexdesign.core import toml_files, units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import suggest
from flexdesign.core.toml_files import Bounds

#: More samples than this are a slip in the period, not a wish.
MOST_SAMPLES = 100_000_000


@dataclass(frozen=True)
class Level:
    """A number in SI that is either a voltage or a length, or either per second; `si` says which."""

    value: float
    si: str

    def __str__(self) -> str:
        unit = {"m": "um", "m/s": "um/s"}.get(self.si, self.si)
        return f"{self.value / units.factor(unit, self.si):.9g} {unit}"


def _level(given: object) -> Level:
    return given if isinstance(given, Level) else _either(given, ("V", "m"), '"60 V" or "40 um"')


def _velocity(given: object) -> Level:
    velocity = given if isinstance(given, Level) else _either(given, ("m/s", "V/s"), '"10 um/s" or "5 V/s"')
    if not velocity.value > 0:
        raise ValueError("must be more than zero; the order of the points gives the direction")
    return velocity


def _either(given: object, kinds: tuple[str, ...], example: str) -> Level:
    for si in kinds:
        try:
            return Level(units.from_text(given, si), si)
        except ValueError:
            continue
    raise ValueError(f"expected a finite number with its unit, for example {example}")


#: A voltage or a length: ``"60 V"``, ``"40 um"``.
AnyLevel = Annotated[InstanceOf[Level], BeforeValidator(_level), PlainSerializer(str)]
#: A velocity, in metres or volts per second.
AnyVelocity = Annotated[InstanceOf[Level], BeforeValidator(_velocity), PlainSerializer(str)]
_DURATION, _PAUSE = Bounds("s", 0.0, 1e7, exclusive=True), Bounds("s", 0.0, 1e7)
_FREQUENCY, _CYCLES = Bounds("Hz", 0.0, 1e9, exclusive=True), Bounds("1", 0.0, 1e9, exclusive=True)
#: A time that something takes.
Duration = Annotated[float, BeforeValidator(_DURATION.read), _DURATION]
#: A time that may be zero.
Pause = Annotated[float, BeforeValidator(_PAUSE.read), _PAUSE]
Frequency = Annotated[float, BeforeValidator(_FREQUENCY.read), _FREQUENCY]
#: How often something is done; need not be whole.
Cycles = Annotated[float, BeforeValidator(_CYCLES.read), _CYCLES]

_SHAPES: dict[str, type[Trajectory]] = {}


def shapes() -> tuple[str, ...]:
    """Return the names of all shapes."""
    return tuple(_SHAPES)


class Trajectory(toml_files.Table):
    """What is commanded over time, in volts or metres.

    ``Trajectory`` as the type of a field in a file's schema reads a table of any shape: ``shape = "sine"`` and that
    shape's keys; `files.as_text` writes it back. A new shape is a subclass; its ``shape`` is a ``Literal`` of its name.

    It waits at its first level for the time `rest`, and then moves. Where it jumps, the sample at the jump is already
    the new level.
    """

    rest: Pause = 0.0

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if "shape" in cls.model_fields:
            _SHAPES[get_args(cls.model_fields["shape"].annotation)[0]] = cls

    @model_validator(mode="wrap")
    @classmethod
    def _of_its_shape(cls, given: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if cls is not Trajectory or isinstance(given, Trajectory):
            return handler(given)
        return _read(given)  # type: ignore[return-value]

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = sorted({level.si.removesuffix("/s") for level in self.levels()})
        if len(kinds) > 1:
            raise ValueError("mixes volts and metres; give every level in units of the same kind")
        return self

    def levels(self) -> tuple[Level, ...]:
        """Return every number of this trajectory that is in volts or metres."""
        values = (getattr(self, name) for name in type(self).model_fields)
        return tuple(value for value in values if isinstance(value, Level))

    @property
    def si(self) -> str:
        """``V`` or ``m``."""
        return self.levels()[0].si

    @property
    def axes(self) -> int:
        """How many axes it moves."""
        return 1

    @property
    def duration(self) -> float:
        """Time from the first sample to the last, `rest` included [s]."""
        return float(self.rest + self._moving())

    def _moving(self) -> float:
        """Return the duration without `rest` [s]."""
        raise NotImplementedError

    def _at(self, time: Array) -> Array:
        """Return the levels at n moments, counted from the end of `rest` and not negative [s]; n or axes x n values."""
        raise NotImplementedError

    def _fastest(self) -> float:
        """Return the highest frequency that samples must follow [Hz]; for a dwell, that of which it is half a cycle."""
        return 0.0

    def with_folder(self, folder: Path) -> Self:
        """Return this trajectory with the files it names looked up in `folder`, where they are not absolute."""
        return self

    def sampled(self, period: float) -> Array:
        """Return the samples at 0, `period`, 2 `period`, ... [V or m].

        Parameters
        ----------
        period
            Sampling period [s].

        Returns
        -------
        n values, or axes x n where there are several axes; n is round(duration / period) + 1.

        Raises
        ------
        ValueError
            If the period is not positive, too long to follow this trajectory, or gives more than 1e8 samples.
        """
        if not 0 < period < math.inf:
            raise ValueError(f"a sampling period is more than zero, found {period!r} s")
        if self._fastest() * 2 * period > 1 + 1e-9:
            longest = units.to_text(0.5 / self._fastest(), "ms", si="s")
            found = units.to_text(period, "ms", si="s")
            raise ValueError(
                f"a sampling period of {found} cannot follow this trajectory: sample every {longest} or less"
            )
        if not self.duration / period < MOST_SAMPLES:
            count = f"{self.duration / period:.0e}"
            raise ValueError(f"a sampling period of {period:g} s gives {count} samples; choose a longer one")
        time = period * np.arange(round(self.duration / period) + 1)
        return self._at(np.maximum(time - self.rest, 0.0))


def _read(given: Any) -> Trajectory:
    """Return the trajectory that a table describes; every error is placed at one key of it."""
    if not isinstance(given, Mapping):
        raise ValueError(f'expected a table such as {{ shape = "sine", ... }}; shapes: {", ".join(_SHAPES)}')
    name = given.get("shape")
    if name is None:
        raise _error("shape", None, f"is missing; known: {', '.join(_SHAPES)}")
    if not isinstance(name, str) or name not in _SHAPES:
        raise _error("shape", name, f"is not a known shape{suggest(str(name), list(_SHAPES))}")
    shape = _SHAPES[name]
    fields = shape.model_fields
    for key in given:
        if key not in fields:
            raise _error(key, given[key], f"is not a key of a {name}{suggest(key, list(fields))}")
    for key, field in fields.items():
        if field.is_required() and key not in given:
            required = ", ".join(name for name, field in fields.items() if field.is_required())
            raise _error(key, None, f"is missing; a {name} needs {required}")
    try:
        return shape.model_validate(given)
    except ValidationError as error:
        raise _first_failure(error) from None


def _first_failure(error: ValidationError) -> Exception:
    """Return the first failure within a shape, at the key it belongs to; entries of lists are counted from 1."""
    first = error.errors()[0]
    message = "is missing" if first["type"] == "missing" else first["msg"].removeprefix("Value error, ")
    if not first["loc"]:
        return ValueError(message)
    key, *inner = first["loc"]
    entry = ".".join(str(int(piece) + 1) for piece in inner)
    value = None if first["type"] == "missing" else first["input"]
    return _error(str(key), value, f"entry {entry}: {message}" if entry else message)


def _error(key: str, value: object, message: str) -> ValidationError:
    # Handed over as a value, because brackets in the text itself would be taken for places to fill in.
    kind = PydanticCustomError("trajectory", "{message}", {"message": message})
    details = InitErrorDetails(type=kind, loc=(key,), input=value)
    return ValidationError.from_exception_data("Trajectory", [details])
