"""What to simulate: experiments, the controllers that try them, variants of the stage, and published numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, model_validator

from flexdesign import files, shipped, units
from flexdesign.errors import InputError, suggest
from flexdesign.files import Table, in_si
from flexdesign.part import is_file
from flexdesign.trajectory import Trajectory

#: Controllers that every study knows.
KNOWN = {
    "open loop": "the command is the reference over the secant gain",
    "feedforward": "the command that the model's inverse gives, the loop's delay and half a sample ahead",
    "ziegler-nichols": "PID by the classical rule, from the ultimate gain of the model's sampled loop",
    "robust": "PID of the smallest worst-case error integral whose sensitivity stays below a limit",
}
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
    return (units.from_text(given, "1"),)


class Gains(Table):
    """Numbers of one PID, as eq (33) of Lin et al. (2019) has them.

    `kp` is a voltage per length, or a bare number that belongs to a plant of the static gain `plant_gain`: it is then
    scaled so that the gain around the loop is the same.
    """

    kp: Annotated[Any, BeforeValidator(_gain)]
    plant_gain: in_si("1", 1e-9, 1e9) | None = None  # type: ignore[valid-type]
    ti: in_si("s", 0.0, 1e6, exclusive=True) = float("inf")  # type: ignore[valid-type]
    td: in_si("s", 0.0, 1e3) = 0.0  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _has_a_plant(self) -> Gains:
        if isinstance(self.kp, tuple) and self.plant_gain is None:
            raise ValueError('kp without a unit needs plant_gain beside it; or write it as kp = "0.05 V/um"')
        if not isinstance(self.kp, tuple) and self.plant_gain is not None:
            raise ValueError("plant_gain belongs to a kp without a unit; leave one of them out")
        return self

    def in_volts(self, gain: float) -> float:
        """Return the gain for a stage of a static gain [m/V], in volts per metre."""
        if isinstance(self.kp, tuple):
            return float(self.kp[0] * (self.plant_gain or 1.0) / gain)
        return float(self.kp)


class ControllerTable(Table):
    """A PID with given numbers, axis by axis."""

    axis: Mapping[str, Gains]
    source: str = ""


class Variant(Table):
    """The stage with some numbers changed.

    `controllers_know` tells whether feedforward and tuning are made for the changed stage or for the one they believe.
    """

    set: tuple[str, ...]
    controllers_know: bool = True
    note: str = ""


class Published(Table):
    """A number that somebody printed, and which of ours it is to be compared with.

    Where `comparable` is false ours is another quantity, set beside it for its size alone.
    """

    measure: str
    value: str
    place: str
    axis: str = ""
    controller: str = ""
    uncertainty: str = ""
    comparable: bool = True
    note: str = ""

    @model_validator(mode="after")
    def _is_a_measure(self) -> Published:
        if self.measure not in MEASURES:
            raise ValueError(f"measure {self.measure!r} is not known{suggest(self.measure, list(MEASURES))}")
        for text in (self.value, *([self.uncertainty] if self.uncertainty else [])):
            units.from_text(text, MEASURES[self.measure])
        return self

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

    name: str
    title: str = ""
    note: str = ""
    axes: tuple[str, ...]
    command: Trajectory | None = None
    reference: Trajectory | None = None
    controllers: tuple[str, ...] = ("open loop",)
    variants: tuple[str, ...] = (AS_MODELLED,)
    published: tuple[Published, ...] = ()

    @model_validator(mode="after")
    def _is_one_thing(self) -> Experiment:
        if (self.command is None) == (self.reference is None):
            raise ValueError("give a command, in volts, or a reference, in micrometres: one of them")
        for name, si in (("command", "V"), ("reference", "m")):
            given: Trajectory | None = getattr(self, name)
            if given is not None and given.si != si:
                raise ValueError(f"a {name} is given in {'volts' if si == 'V' else 'micrometres'}")
            if given is not None and given.axes not in (1, len(self.axes)):
                raise ValueError(f"the {name} moves {given.axes} axes, and {len(self.axes)} are named")
        if self.command is not None and self.controllers != ("open loop",):
            raise ValueError("controllers need a reference; a command in volts goes to the stage as it is")
        return self

    @property
    def trajectory(self) -> Trajectory:
        """The command or the reference."""
        found = self.command if self.command is not None else self.reference
        assert found is not None
        return found


class _File(Table):
    format: int
    title: str = ""
    note: str = ""
    robust_ms: in_si("1", 1.05, 5.0) = 1.6  # type: ignore[valid-type]
    cycled: bool = True
    variants: Any = None
    controllers: Any = None
    experiment: Any


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
        By name, beside those that every study knows.
    robust_ms
        Limit of the largest sensitivity for the ``robust`` controller.
    cycled
        Whether the stage was cycled over its whole range before, and its rest is where motion counts zero; otherwise
        its piezos were never driven.
    """

    name: str
    title: str
    note: str
    experiments: tuple[Experiment, ...]
    variants: Mapping[str, Variant]
    controllers: Mapping[str, ControllerTable]
    robust_ms: float
    cycled: bool

    def variants_in_use(self) -> dict[str, Variant]:
        """Return the variants that some experiment names."""
        named = {name for experiment in self.experiments for name in experiment.variants}
        return {name: variant for name, variant in self.variants.items() if name in named}


def read(name: str | Path, axes: Sequence[str], overrides: Sequence[str] = ()) -> Plan:
    """Read a study of experiments.

    Parameters
    ----------
    name
        Its path, or the bare name of one in ``studies/``.
    axes
        Axes that the stage model has; every experiment must do with them.
    overrides
        ``table.key=value``.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    path = find(name)
    content = files.read_toml(path)
    with files.attributed(overrides):
        found = files.check(_File, files.overlay(content, overrides), path)
    if not isinstance(found.experiment, list) or not found.experiment:
        raise InputError(path, "experiment", None, "expected one table or more: [[experiment]]")
    plan = Plan(
        path.stem,
        found.title or path.stem,
        found.note,
        tuple(_experiment(given, n, path) for n, given in enumerate(found.experiment, start=1)),
        {name: files.check(Variant, t, path, at) for name, at, t in _tables(found.variants, path, "variants")},
        {name: _controller(t, path, at) for name, at, t in _tables(found.controllers, path, "controllers")},
        found.robust_ms,
        found.cycled,
    )
    _check(plan, axes, path)
    return plan


def _tables(given: Any, path: Path, at: str) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield name, place and content of the tables within a table."""
    for name, table in _table(given or {}, path, at).items():
        yield name, f"{at}.{name}", _table(table, path, f"{at}.{name}")


def _table(given: Any, path: Path, at: str) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise InputError(path, at, files.as_written(given), f"expected a table: [{at}]")
    return given


def _controller(given: Mapping[str, Any], path: Path, at: str) -> ControllerTable:
    gains = {
        name: files.check(Gains, table, path, place)
        for name, place, table in _tables(given.get("axis"), path, f"{at}.axis")
    }
    return files.check(ControllerTable, {**given, "axis": gains}, path, at)


def _experiment(given: Any, number: int, path: Path) -> Experiment:
    """Read one experiment, its published numbers one by one, so that a refusal can name its place."""
    at = f"experiment {number}"
    table = dict(_table(given, path, at))
    listed = table.pop("published", [])
    if not isinstance(listed, list):
        raise InputError(path, f"{at}.published", None, "expected a list of tables: published = [{ ... }, { ... }]")
    published = tuple(
        files.check(Published, _table(entry, path, f"{at}.published {n}"), path, f"{at}.published {n}")
        for n, entry in enumerate(listed, start=1)
    )
    found = files.check(Experiment, table, path, at)
    return _placed(found.model_copy(update={"published": published}), path.parent)


def _placed(experiment: Experiment, folder: Path) -> Experiment:
    """Return an experiment whose files are looked up beside the study."""
    moved = {
        key: given.beside(folder) for key in ("command", "reference") if (given := getattr(experiment, key)) is not None
    }
    return experiment.model_copy(update=moved)


def _check(plan: Plan, axes: Sequence[str], path: Path) -> None:
    known = [*KNOWN, *plan.controllers]
    variants = [AS_MODELLED, *plan.variants]
    names = [experiment.name for experiment in plan.experiments]
    for number, experiment in enumerate(plan.experiments, start=1):
        at = f"experiment {number} ({experiment.name})"
        if names.index(experiment.name) != number - 1:
            raise InputError(path, f"{at}.name", experiment.name, "is used twice; give each experiment its own name")
        for axis in experiment.axes:
            if axis not in axes:
                raise InputError(
                    path, f"{at}.axes", axis, f"is not an axis of the stage model{suggest(axis, list(axes))}"
                )
        for controller in experiment.controllers:
            for piece in pieces(controller):
                if piece not in known:
                    remedy = f"is not a known controller{suggest(piece, known)}"
                    raise InputError(path, f"{at}.controllers", piece, remedy)
                missing = [
                    a for a in experiment.axes if piece in plan.controllers and a not in plan.controllers[piece].axis
                ]
                if missing:
                    remedy = f"has no gains for axis {missing[0]}; add [controllers.{piece}.axis.{missing[0]}]"
                    raise InputError(path, f"{at}.controllers", piece, remedy)
        for variant in experiment.variants:
            if variant not in variants:
                raise InputError(path, f"{at}.variants", variant, f"is not a known variant{suggest(variant, variants)}")


def pieces(controller: str) -> list[str]:
    """Return what a controller such as ``"feedforward + robust"`` consists of."""
    return [piece.strip() for piece in controller.split("+")]


def find(name: str | Path) -> Path:
    """Find a study of experiments: a path, or a bare name looked up in studies/, here and as shipped.

    Raises
    ------
    InputError
        If there is no such file; the message suggests the nearest names.
    """
    path = Path(name)
    if is_file(path):
        return path
    folders = [base / "studies" for base in (Path(), shipped.root())]
    if path.suffix != ".toml" and len(path.parts) == 1:
        for folder in folders:
            if is_file(folder / f"{name}.toml"):
                return folder / f"{name}.toml"
    known = sorted({file.stem for folder in folders for file in folder.glob("*.toml") if _has_experiments(file)})
    remedy = f"no such study of experiments{suggest(path.stem, known)}"
    raise InputError("command line", "STUDY", files.as_written(str(name)), remedy)


def _has_experiments(file: Path) -> bool:
    try:
        return "[[experiment]]" in file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False
