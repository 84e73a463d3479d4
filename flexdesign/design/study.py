"""A study: which design, and how closely to look at it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from flexdesign.core import toml_files
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.toml_files import Bounds, Table, in_si, is_file, whole
from flexdesign.design import changes
from flexdesign.design import design as designs
from flexdesign.design.design import Design

#: Tables and keys that belong to a design; everything else that --set names belongs to the study.
DESIGN_KEYS = ("part", "dimensions", "ports", "material", "actuator", "provenance", "plate", "derived", "active_axis")


_PLACE = Bounds("m", -1.0, 1.0)


def _point(given: object) -> tuple[float, float, float]:
    if not isinstance(given, (list, tuple)) or len(given) != 3:
        raise ValueError('expected a point x, y, z in the part\'s frame, such as ["0 mm", "20 mm", "5 mm"]')
    x, y, z = (_PLACE.read(coordinate) for coordinate in given)
    return x, y, z


class MeshSettings(Table):
    """How the meshes are graded.

    The `method` is ``extruded``, layers of prisms cut into tetrahedra, or ``wild``, isotropic tetrahedra; ``auto`` is
    extruded where the part is prismatic, which takes a fraction of the time, and wild elsewhere.

    There are `levels` meshes, or, with an `accuracy`, as many as it takes until the estimated error of every stiffness
    and amplification is that small, relative, two at least and five at most.

    The element size is `at_root` hinge thicknesses at the hinge roots on the finest mesh and grows with the distance
    from them up to `largest`; the defaults of the first two, 0.3 and 0.45 for unstructured meshes and 0.05 and 0.6 for
    extruded ones, balance the error of the roots with that of the rest. Each coarser mesh is `refinement` times as
    coarse everywhere; an extruded one at the roots by its square. Extruded parts with curved necks have their few sharp
    roots resolved four times as finely, and begin one mesh coarser where an accuracy is asked for. The unstructured
    mesher may move the surface by `envelope` hinge thicknesses, before its vertices are put back on the CAD faces.

    With `cross_check` the part is also solved in every other way that it allows, with each method and on its
    fundamental domain and whole, and the report sets the answers side by side.

    Unless `independent` is false, a part that is not meshed by pytetwild gets one mesh of it besides, as a check.
    """

    method: Literal["auto", "wild", "extruded"] = "auto"

    levels: whole(2, 5) = 3  # type: ignore[valid-type]
    accuracy: in_si("1", 1e-4, 0.2) | None = None  # type: ignore[valid-type]
    at_root: in_si("1", 0.005, 2.0) | None = None  # type: ignore[valid-type]
    growth: in_si("1", 0.05, 2.0) | None = None  # type: ignore[valid-type]
    largest: in_si("m", 1e-5, 0.1) | None = None  # type: ignore[valid-type]
    refinement: in_si("1", 1.1, 2.0) = 1.35  # type: ignore[valid-type]
    envelope: in_si("1", 1e-3, 0.05) = 0.05  # type: ignore[valid-type]
    cross_check: bool = False
    independent: bool = True


class ModeSettings(Table):
    """How many modes of each symmetry class are sought."""

    count: whole(1, 20) = 2  # type: ignore[valid-type]


class OutputSettings(Table):
    """What happens at the output, and how the actuator is set.

    `load` is the stiffness of what the output pushes against, for one more row of K_in and amplification; `stroke` the
    output motion at which stress is stated (default: all the actuator gives); `actuator_offset` how far off its axis
    the actuator pushes, for the coupling and the motion of the table. `sensor` is the point x, y, z in the part's frame
    at which a sensor looks; it is fixed to the table, and its motion is reported with the table's. `large_steps` is in
    how many steps of force large displacements are followed to full drive, on the coarsest mesh; 0 leaves them out.
    """

    load: in_si("N/m", 1.0, 1e10) | None = None  # type: ignore[valid-type]
    stroke: in_si("m", 0.0, 0.05, exclusive=True) | None = None  # type: ignore[valid-type]
    actuator_offset: in_si("m", 0.0, 0.05) = 1e-4  # type: ignore[valid-type]
    sensor: Annotated[tuple[float, float, float], BeforeValidator(_point), _PLACE] | None = None
    large_steps: whole(0, 50) = 4  # type: ignore[valid-type]


class StageSettings(Table):
    """What is asked of a whole stage besides.

    `inputs` is by axis how far each actuator parts its inputs where coupling and pictures are stated; half the free
    stroke where nothing is said.
    """

    inputs: dict[str, in_si("m", 1e-9, 1e-2)] = Field(default_factory=dict)  # type: ignore[valid-type]


class _StudyFile(Table):
    format: int
    design: str
    title: str = ""
    mesh: MeshSettings = MeshSettings()
    modes: ModeSettings = ModeSettings()
    output: OutputSettings = OutputSettings()
    stage: StageSettings = StageSettings()
    published: dict[str, dict[str, str]] = Field(default_factory=dict)
    variants: dict[str, list[str]] = Field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """A design and how it is to be validated.

    Parameters
    ----------
    file, name
        Where it was read, and the name of that file; reports go to a folder of that name.
    design
        What is validated; the study's own title, if it has one, takes the place of the design's.
    mesh, modes, output, stage
        How.
    published
        Numbers of others, as text with units, by where they come from and by the quantity's key.
    variants
        Designs that are solved besides, on the coarsest mesh, to see what makes a difference, by what they are called.
    """

    file: Path
    name: str
    design: Design
    mesh: MeshSettings
    modes: ModeSettings
    output: OutputSettings
    stage: StageSettings = field(default_factory=StageSettings)
    published: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    variants: Mapping[str, Design] = field(default_factory=dict)


def read(name: str | Path, overrides: Sequence[str] = ()) -> Study:
    """Read a study, or a design to be studied with default settings.

    Parameters
    ----------
    name
        Path of a study or design file, or the bare name of one in ``studies/`` or ``geometry/``.
    overrides
        ``table.key=value``, for design and study alike.

    Raises
    ------
    InputError
        If anything in either file or in the overrides cannot be used.
    """
    path = designs.find(name)
    of_design, of_study = _split_overrides(overrides)
    content = toml_files.read_toml(path)
    is_design = "design" not in content and any(key in content for key in DESIGN_KEYS)
    with toml_files.attribute_overrides(of_study):
        if is_design:
            remedy = f'belongs to a study, which is a file with design = "{path.stem}" and tables such as this one'
            _refuse(content, ("mesh", "modes", "output"), path, remedy)
            content = {"format": toml_files.FORMAT, "design": path.name}
        else:
            _refuse(content, DESIGN_KEYS, path, "belongs to the design that the study names; write it there")
        checked = toml_files.check(_StudyFile, toml_files.overlay(content, of_study), path)
        if is_design and checked.design != path.name:
            raise InputError(path, "design", checked.design, f"{path.name} is a design itself; name the other instead")
        design_path = path if is_design else _find_design(path, checked.design)
    design = designs.read(design_path, of_design)
    if checked.title:
        design = replace(design, title=changes.title_with_changes(checked.title, of_design))
    variants = {label: designs.read(design_path, [*of_design, *theirs]) for label, theirs in checked.variants.items()}
    return Study(
        path,
        path.stem,
        design,
        checked.mesh,
        checked.modes,
        checked.output,
        checked.stage,
        checked.published,
        variants,
    )


def of_design(design: Design, overrides: Sequence[str] = ()) -> Study:
    """Return a study of a design with default settings, changed by overrides.

    Raises
    ------
    InputError
        If an override cannot be used, or belongs to the design.
    """
    of_design, of_study = _split_overrides(overrides)
    if of_design:
        raise InputError("command line", of_design[0], None, "belongs to the design; give it to read_design")
    content = {"format": toml_files.FORMAT, "design": design.file.name}
    with toml_files.attribute_overrides(of_study):
        checked = toml_files.check(_StudyFile, toml_files.overlay(content, of_study), design.file)
    return Study(
        design.file, design.name, design, checked.mesh, checked.modes, checked.output, checked.stage, checked.published
    )


def _split_overrides(overrides: Sequence[str]) -> tuple[list[str], list[str]]:
    """Tell overrides of the design from those of the study."""
    of_design, of_study = [], []
    known = [*DESIGN_KEYS, *_StudyFile.model_fields]
    for override in overrides:
        key, equals, text = override.partition("=")
        first, *others = key.strip().split(".")
        if first in DESIGN_KEYS:
            of_design.append(override)
        elif first in known or not equals or not first:
            of_study.append(override)
        else:
            bare = "" if others else f"; if it is a dimension, write dimensions.{first}"
            remedy = f"is no key of a study or a design{suggest(first, known)}{bare}"
            raise InputError("command line", key.strip(), text.strip(), remedy)
    return of_design, of_study


def _refuse(content: Mapping[str, Any], keys: Iterable[str], path: Path, remedy: str) -> None:
    for key in keys:
        if key in content:
            raise InputError(path, key, toml_files.as_written(content[key]), remedy)


def _find_design(path: Path, design: str) -> Path:
    """Find the design that a study names: next to the study, or as `designs.find` does."""
    design_file = path.parent / design
    if is_file(design_file):
        if design_file.samefile(path):
            raise InputError(path, "design", design, "a study cannot be its own design; name the design's file")
        return design_file
    try:
        return designs.find(design)
    except InputError as error:
        raise InputError(path, "design", design, error.remedy) from error
