"""A study: which design, and how closely to look at it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from flexdesign import design as designs
from flexdesign.design import Design, Table, in_si
from flexdesign.errors import InputError

#: Tables and keys that belong to a design; everything else that --set names belongs to the study.
DESIGN_KEYS = ("part", "dimensions", "material", "actuator", "provenance")


class MeshSettings(Table):
    """How the meshes are graded.

    The element size is `at_root` hinge thicknesses at the hinge roots on the finest mesh and grows with the distance
    from them up to `largest`. Each coarser mesh is `refinement` times as coarse everywhere. The mesher may move the
    surface by `envelope` hinge thicknesses, before its vertices are put back on the CAD faces.
    """

    levels: Annotated[int, Field(ge=2, le=5)] = 3
    at_root: Annotated[float, Field(gt=0.01, le=2.0)] = 0.3
    growth: Annotated[float, Field(ge=0.05, le=2.0)] = 0.45
    largest: in_si("m", lower=1e-5, upper=1.0) | None = None  # type: ignore[valid-type]
    refinement: Annotated[float, Field(ge=1.1, le=2.0)] = 1.35
    envelope: Annotated[float, Field(gt=1e-3, le=0.05)] = 0.05


class ModeSettings(Table):
    """How many modes of each symmetry class are sought."""

    count: Annotated[int, Field(ge=1, le=20)] = 2


class OutputSettings(Table):
    """At which output motion stress is stated (default: all the actuator gives), and how far off axis it may push."""

    stroke: in_si("m", exclusive=True) | None = None  # type: ignore[valid-type]
    actuator_offset: in_si("m") = 1e-4  # type: ignore[valid-type]


class _StudyFile(Table):
    format: int
    design: str = ""
    title: str = ""
    mesh: MeshSettings = MeshSettings()
    modes: ModeSettings = ModeSettings()
    output: OutputSettings = OutputSettings()


@dataclass(frozen=True)
class Study:
    """A design and how it is to be validated.

    Parameters
    ----------
    name
        Name of its file; reports go to a folder of that name.
    design
        What is validated.
    mesh, modes, output
        How.
    """

    name: str
    design: Design
    mesh: MeshSettings
    modes: ModeSettings
    output: OutputSettings


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
    of_design = [o for o in overrides if o.partition("=")[0].strip().split(".")[0] in DESIGN_KEYS]
    of_study = [o for o in overrides if o not in of_design]
    content: dict[str, Any] = designs.read_toml(path)
    if "part" in content:
        content = {"format": designs.FORMAT, "design": str(path)}
    content = designs.overlay(content, of_study)
    checked = designs.check(_StudyFile, content, path)
    if checked.format != designs.FORMAT:
        raise InputError(path, "format", checked.format, f"this version reads format = {designs.FORMAT}")
    if not checked.design:
        raise InputError(path, "design", None, "is missing: name a design, such as bridge_amplifier")
    beside = path.parent / checked.design
    design_path = beside if beside.is_file() else designs.find(checked.design)
    return Study(path.stem, designs.read(design_path, of_design), checked.mesh, checked.modes, checked.output)
