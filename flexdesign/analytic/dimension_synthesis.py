"""A file of targets made into dimensions: what `flexdesign.analytic.reconstruction` solves, read, named and written.

A target may be a printed number, known to half a unit of its last digit only. With ``rounded = true`` each dimension
has a half-width, the sum of what these halves do to it one by one: how far all of them together move it at worst.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from flexdesign.analytic.lagrange import OPPOSED_XY, PARALLEL_XY, PRINTED_XY, PRINTED_Z, Topology
from flexdesign.analytic.prb import SOURCE
from flexdesign.analytic.reconstruction import (
    AxisTargets,
    Choices,
    Contradiction,
    CouplingTargets,
    Reconstruction,
    Targets,
    amplification_from_gain,
    reconstruct,
)
from flexdesign.core import data_files, toml_files, toml_writing, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity
from flexdesign.core.serialise import header
from flexdesign.core.toml_files import Table, in_si, whole
from flexdesign.design import materials

#: How the two kinds of axes are called.
AXES = {"xy": "X/Y", "z": "Z"}
#: What is a setting of an experiment or a model, and not a result that someone rounded.
SETTINGS = ("load_ratio", "input_stroke")
PROVENANCE = (
    "reconstructed: one realisation of the targets; that the formulas return them with these dimensions is circular by"
    " construction"
)
EQ5, EQ15, EQ17, EQ21, EQ30 = (f"{SOURCE}, eq. ({number})" for number in (5, 15, 17, 21, 30))
EQ23 = f"{SOURCE}, eqs. (23), (24)"


# --- the file


class _Axis(Table):
    output_stiffness: in_si("N/m", 1.0, 1e10)  # type: ignore[valid-type]
    input_stiffness: in_si("N/m", 1.0, 1e12)  # type: ignore[valid-type]
    load_ratio: in_si("1", 0.0, 1e6)  # type: ignore[valid-type]
    amplification: in_si("1", 1e-3, 1e4) | None = None  # type: ignore[valid-type]
    gain: in_si("1", 1e-3, 1e4) | None = None  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _one_of_them(self) -> _Axis:
        if (self.amplification is None) == (self.gain is None):
            raise ValueError("needs either an amplification, or a gain from which eq. (30) finds it, and not both")
        return self


class _Coupling(Table):
    input_stroke: in_si("m", 1e-9, 1e-2)  # type: ignore[valid-type]
    y_from_x: in_si("1", 1e-9, 1.0)  # type: ignore[valid-type]
    z_from_x: in_si("1", 1e-9, 1.0)  # type: ignore[valid-type]


class _Targets(Table):
    xy: _Axis
    z: _Axis
    coupling: _Coupling


class _Counts(Table):
    moving_amplifiers: whole(1, 1000)  # type: ignore[valid-type]
    bending_amplifiers: whole(1, 1000)  # type: ignore[valid-type]
    amplifier_share: in_si("1", 1e-3, 1.0) = 1.0  # type: ignore[valid-type]
    guide_hinges: whole(0, 1000) = 0  # type: ignore[valid-type]
    guides: whole(0, 1000) = 0  # type: ignore[valid-type]
    guide_share: in_si("1", 1e-3, 1.0) = 1.0  # type: ignore[valid-type]


class _Topologies(Table):
    xy: _Counts = _Counts(**asdict(PRINTED_XY))
    z: _Counts = _Counts(**asdict(PRINTED_Z))


class _Choices(Table):
    width: in_si("m", 1e-5, 1.0)  # type: ignore[valid-type]
    hinge_thickness: in_si("m", 1e-6, 0.1)  # type: ignore[valid-type]
    rod_thickness: in_si("m", 1e-6, 0.1)  # type: ignore[valid-type]


class _File(Table):
    format: int
    material: Any  # a name, a file or a table: see flexdesign.design.materials
    targets: _Targets
    choices: _Choices
    title: str = ""
    rounded: bool = False
    topology: _Topologies = _Topologies()
    sources: dict[str, Any] = Field(default_factory=dict)


# --- what is found


class InputNumber(NamedTuple):
    """A number of the file, as it was written, and where it comes from."""

    name: str
    text: str
    source: str


@dataclass(frozen=True)
class Sizing:
    """Targets with the dimensions that meet them.

    Parameters
    ----------
    name, title
        Name of the file, and what people call it.
    material
        Name of the material.
    given
        All numbers of the file.
    found
        The dimensions.
    quantities
        The same as quantities, each with its equation, and its half-width if the targets are rounded.
    """

    name: str
    title: str
    material: str
    given: tuple[InputNumber, ...]
    found: Reconstruction
    quantities: tuple[Quantity, ...]

    def recomputed_targets(self) -> list[tuple[Quantity, Quantity]]:
        """Return each target and what the equations give for the dimensions, which is circular by construction."""
        return list(
            zip(
                _target_quantities(self.found.targets), _target_quantities(self.found.recomputed_targets()), strict=True
            )
        )

    def topologies(self) -> list[tuple[str, Topology, Quantity]]:
        """Return ways to put the same elements together in X/Y: the targets' own and others, with the stiffness."""
        own = self.found.targets.topology_xy
        names = {own: "as the targets count"}
        names.setdefault(replace(own, bending_amplifiers=own.moving_amplifiers), "all that move bend, too")
        names.setdefault(OPPOSED_XY, "two opposed amplifiers")
        names.setdefault(PARALLEL_XY, "four amplifiers in parallel")
        return [
            (name, topology, Quantity("K", self.found.axis("X/Y", topology).stiffness, "N/m", "N/mm", "X/Y", EQ21))
            for topology, name in names.items()
        ]

    def to_toml(self) -> str:
        """Return the dimensions as a file: those of the stage, and for each amplifier those that its design takes."""
        return "\n".join(_lines(self)) + "\n"

    def result(self) -> dict[str, Any]:
        """Return everything as result.json has it."""
        return {
            **header("sizing"),
            "title": self.title,
            "provenance": PROVENANCE,
            "material": self.material,
            "given": [given._asdict() for given in self.given],
            "quantities": [quantity.to_json() for quantity in self.quantities],
            "topologies": [{**k.to_json(), "topology": name, **asdict(t)} for name, t, k in self.topologies()],
            "returned": [
                {**back.to_json(), "target": asked.to_json()["value"]} for asked, back in self.recomputed_targets()
            ],
        }


def find(name: str | Path) -> Path:
    """Find a file of targets: a path, or a bare name looked up in studies/, here and as shipped.

    Raises
    ------
    InputError
        If there is no such file; the message suggests the nearest names.
    """
    return data_files.find(name, "file of targets", "[targets.", "TARGETS")


def size(name: str | Path, overrides: Sequence[str] = ()) -> Sizing:
    """Read targets and find the dimensions that meet them.

    Parameters
    ----------
    name
        Path of the file, or the bare name of one in ``studies/``.
    overrides
        ``table.key=value``, such as ``targets.xy.amplification=6``; of amplification and gain the one that is set takes
        the place of the other.

    Raises
    ------
    InputError
        If anything in the file or the overrides cannot be used, or the targets contradict each other.
    """
    path = find(name)
    content = toml_files.read_toml(path)
    with toml_files.attribute_overrides(overrides):
        content = _without_rivals(toml_files.overlay(content, overrides), overrides)
        checked = toml_files.check(_File, content, path)
        material = materials.find(checked.material, path)
        written = _written(content)
        given = _input_numbers(checked.sources, written, overrides, path)
        problem = _Problem(checked, Choices(material.youngs_modulus, **checked.choices.model_dump()), written, path)
        found = problem.solve({})
        values = problem.dimension_quantities(found)
        if checked.rounded:
            values = [replace(q, half_width=half) for q, half in zip(values, problem.half_widths(), strict=True)]
    title = checked.title or path.stem.replace("_", " ")
    return Sizing(path.stem, title, material.name, given, found, tuple(values))


@dataclass(frozen=True)
class _Problem:
    """The content of a file, solved as often as its rounded numbers are moved."""

    checked: _File
    choices: Choices
    written: Mapping[str, object]
    path: Path

    @property
    def axes(self) -> dict[str, _Axis]:
        return {"xy": self.checked.targets.xy, "z": self.checked.targets.z}

    def solve(self, changes: Mapping[str, float]) -> Reconstruction:
        """Return the dimensions, some targets moved by so much [SI]."""
        try:
            xy, z = (self._axis(key, axis, changes) for key, axis in self.axes.items())
            coupling = CouplingTargets(**_with_changes(self.checked.targets.coupling, "targets.coupling", changes))
            counts = (Topology(**each.model_dump()) for each in (self.checked.topology.xy, self.checked.topology.z))
            return reconstruct(Targets(xy, z, coupling, *counts), self.choices)
        except Contradiction as error:
            raise self._contradiction(error) from None

    def _axis(self, key: str, axis: _Axis, changes: Mapping[str, float]) -> AxisTargets:
        numbers = _with_changes(axis, f"targets.{key}", changes)
        if (gain := numbers.pop("gain")) is not None:
            k_in, k = numbers["input_stiffness"], numbers["output_stiffness"]
            numbers["amplification"] = amplification_from_gain(k_in, k, gain)
        return AxisTargets(**numbers)

    def _contradiction(self, error: Contradiction) -> InputError:
        """Return the contradiction with its place in the file."""
        table = "" if error.field.startswith("topology") else "targets." if "." in error.field else "choices."
        field = table + error.field.replace("topology_", "topology.")
        if field.endswith(".amplification") and field not in self.written:
            field = field.replace(".amplification", ".gain")
        return InputError(self.path, field, toml_files.as_written(self.written.get(field)), error.remedy)

    def dimension_quantities(self, found: Reconstruction) -> list[Quantity]:
        """Return the dimensions as quantities."""
        return list(_quantities(found, {k: "stated" if axis.gain is None else EQ30 for k, axis in self.axes.items()}))

    def half_widths(self) -> list[float]:
        """Return for each quantity how far half a unit of the targets' last digits moves it, all together at worst."""
        total = np.zeros(len(self.dimension_quantities(self.solve({}))))
        for key, given in self.written.items():
            if (half := _half_unit(given, key, self.checked)) is None:
                continue
            try:
                ends = [
                    [q.value for q in self.dimension_quantities(self.solve({key: sign * half}))] for sign in (-1, 1)
                ]
            except InputError as error:
                remedy = f"half a unit of its last digit contradicts the other targets already ({error.remedy})"
                raise InputError(self.path, key, toml_files.as_written(given), remedy) from None
            total += np.abs(np.subtract(ends[0], ends[1])) / 2
        return [float(half) for half in total]


def _written(content: Mapping[str, Any]) -> dict[str, object]:
    """Return the numbers of a file as they stand there, by dotted name."""
    written: dict[str, object] = {"material": toml_files.as_written(content["material"]) or "a table of its own"}
    for table in ("targets", "topology", "choices"):
        for name, value in content.get(table, {}).items():
            inner = value if isinstance(value, Mapping) else {"": value}
            written |= {f"{table}.{name}.{key}".rstrip("."): each for key, each in inner.items()}
    return written


def _input_numbers(
    sources: Mapping[str, object], written: Mapping[str, object], overrides: Sequence[str], path: Path
) -> tuple[InputNumber, ...]:
    """Return the numbers with their sources; what was overridden no longer comes from where the file says."""
    for name, source in sources.items():
        if not isinstance(source, str):
            raise InputError(path, f"sources.{name}", toml_files.as_written(source), f'expected text: "{name}" = "..."')
        if name not in written and not name.endswith((".gain", ".amplification")):
            remedy = f"is the source of no number of this file{suggest(name, list(written))}"
            raise InputError(path, f"sources.{name}", toml_files.as_written(source), remedy)
    known = {**sources, **{override.partition("=")[0].strip(): "command line" for override in overrides}}
    return tuple(InputNumber(name, str(text), str(known.get(name, "not stated"))) for name, text in written.items())


def _without_rivals(content: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return the content without the gain of an axis whose amplification was overridden, and the other way round."""
    rivals = {"gain": "amplification", "amplification": "gain"}
    for override in overrides:
        if place := re.fullmatch(r"targets\.(\w+)\.(gain|amplification)", override.partition("=")[0].strip()):
            content["targets"][place[1]].pop(rivals[place[2]], None)
    return content


def _with_changes(table: Table, place: str, changes: Mapping[str, float]) -> dict[str, Any]:
    return {
        name: value if value is None else value + changes.get(f"{place}.{name}", 0.0)
        for name, value in table.model_dump().items()
    }


def _half_unit(given: object, key: str, checked: _File) -> float | None:
    """Return half a unit of a target's last digit [SI]; None for what is no rounded target."""
    table, *names = key.split(".")
    digits = re.match(r"\s*\+?\d*\.?\d+(?:[eE][+-]?\d+)?", str(given))
    if table != "targets" or names[-1] in SETTINGS or not digits:
        return None
    number = Decimal(digits[0].strip())
    value: float = getattr(getattr(checked.targets, names[0]), names[1])
    return 0.5 * 10.0 ** int(number.as_tuple().exponent) * value / float(number)


def _quantities(found: Reconstruction, origins: Mapping[str, str]) -> Iterator[Quantity]:
    """Yield the dimensions in the order in which one follows from the other, each with its equation."""
    bridges = {"xy": found.xy, "z": found.z}
    rods = {"xy": found.rod_compliance_xy, "z": found.rod_compliance_z}
    targets = {"xy": found.targets.xy, "z": found.targets.z}
    eq17 = {key: EQ17 if axis.load_ratio == 1 else f"{EQ17}, load generalised" for key, axis in targets.items()}
    for key, axis in targets.items():
        yield Quantity("lambda", axis.amplification, "1", "", AXES[key], origins[key])
    yield Quantity("travel", found.travel, "m", "um", "X", "lambda times the input stroke")
    yield Quantity("L_1", found.chain_length_y, "m", "mm", "chains, X to Y", EQ23)
    yield Quantity("L_2", found.chain_length_z, "m", "mm", "chains, X to Z", EQ23)
    yield Quantity("K_b", found.amplifier_stiffness, "N/m", "N/mm", "amplifiers", f"{EQ21}, Z")
    yield Quantity("K_r", found.hinge_stiffness, "N*m/rad", "N*mm/rad", "hinges", f"{EQ21}, X/Y")
    yield Quantity("l_x", found.xy.arm_span, "m", "mm", "amplifiers", EQ5)
    yield Quantity("l_h", found.xy.hinge_length, "m", "mm", "hinges", "E w t^3 / (12 K_r), w and t chosen")
    for key, bridge in bridges.items():
        yield Quantity("l_y", bridge.arm_offset, "m", "mm", AXES[key], eq17[key])
        yield Quantity("c_rod", rods[key], "m/N", "um/N", AXES[key], eq17[key])
        yield Quantity("l_1", bridge.rod_length, "m", "mm", AXES[key], f"{EQ15}, w and l_3 chosen")


def _target_quantities(targets: Targets) -> Iterator[Quantity]:
    """Yield targets as quantities, with the equations that give them forwards."""
    for name, axis in (("X/Y", targets.xy), ("Z", targets.z)):
        yield Quantity("K", axis.output_stiffness, "N/m", "N/mm", name, EQ21)
        yield Quantity("K_in", axis.input_stiffness, "N/m", "N/um", name, EQ17)
        yield Quantity("lambda", axis.amplification, "1", "", name, EQ17)
    yield Quantity("coupling", targets.coupling.y_from_x, "1", "%", "X to Y", EQ23)
    yield Quantity("coupling", targets.coupling.z_from_x, "1", "%", "X to Z", EQ23)


#: What a design has of an amplifier, and the paper's symbols.
_DIMENSIONS = {
    "arm_span": "l_x", "arm_offset": "l_y", "hinge_length": "l_h", "hinge_thickness": "t, chosen",
    "width": "w, chosen", "rod_length": "l_1", "rod_thickness": "l_3, chosen",
}  # fmt: skip


def _lines(sizing: Sizing) -> Iterator[str]:
    """Yield the file of dimensions, line by line."""

    def length(name: str, value: float, meaning: str) -> str:
        return toml_writing.with_comment(f'{name} = "{value / units.factor("mm", "m"):.6g} mm"', meaning, 32)

    found = sizing.found
    yield f"# Dimensions by flexdesign size from the targets {sizing.name}. They are no whole design: the targets say"
    yield "# nothing of the thickness of the arms and the size of the blocks."
    yield f"format = {toml_files.FORMAT}"
    yield f"title = {toml_files.quote(f'{sizing.title}, reconstructed')}"
    yield f"material = {toml_files.quote(sizing.material)}"
    yield f"provenance = {toml_files.quote(PROVENANCE)}"
    yield from ("", "[stage]")
    yield length("chain_length_y", found.chain_length_y, "L_1")
    yield length("chain_length_z", found.chain_length_z, "L_2")
    for key, bridge in (("xy", found.xy), ("z", found.z)):
        yield from ("", f"[amplifier.{key}.dimensions]")
        yield from (length(name, getattr(bridge, name), meaning) for name, meaning in _DIMENSIONS.items())
