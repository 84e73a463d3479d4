"""The solid and the mesh in files for users' own tools."""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.whole_files import written_whole
from flexdesign.design.design import Design
from flexdesign.design.part import extrusion_axis
from flexdesign.fem import quantities
from flexdesign.fem.meshing import mesh
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.workflows.validation import Validation
from flexdesign.workflows.validation.validate_stage import StageValidation

#: Suffixes the CAD kernel writes, and what it calls the formats; a DXF holds the section of an extrusion.
SOLIDS = {".step": "STEP", ".stp": "STEP", ".stl": "STL", ".brep": "BREP", ".dxf": "DXF"}
#: The field of a mesh that every part has.
OF_OUTPUT = "displacement_per_output_force_[m/N]"


def writers(
    names: Sequence[str], folder: Path, *, stage: bool = False
) -> list[tuple[Path, Callable[[Any, Path], None]]]:
    """Return where files go and what writes them: a bare name goes into the report's folder, which may not exist yet.

    Raises
    ------
    InputError
        As `writer` does.
    """
    found = []
    for name in names:
        path = Path(name)
        inside = len(path.parts) == 1
        place = folder / path if inside else path
        if place.is_dir():
            raise _refusal(path, "is a folder; name a file in it")
        found.append((place, writer(path, stage=stage, inside=inside)))
    return found


def writer(path: Path, *, stage: bool = False, inside: bool = False) -> Callable[[Any, Path], None]:
    """Return what writes the kind of file that the suffix names, given a validation and the path.

    A single tetrahedron is written on trial, so that what cannot be written is known before long work begins. A `stage`
    has a solid, but no mesh of the whole. Of what goes `inside` the report's folder, which is made later, the trial is
    in a temporary folder.

    Raises
    ------
    InputError
        If there is no such kind, or no file can be written there.
    """
    import meshio

    suffix = path.suffix.lower()
    if suffix not in SOLIDS and suffix not in meshio.extension_to_filetypes:
        known = " ".join([*SOLIDS, ".vtu", ".vtk", ".msh", ".inp"])
        raise _refusal(path, f"unknown kind of file; known are {known}")
    if path.is_dir() and not inside:
        raise _refusal(path, "is a folder; name a file in it")
    if not path.parent.is_dir():
        raise _refusal(path, "its folder does not exist; make it first")
    if stage and suffix not in SOLIDS:
        raise _refusal(path, f"a stage has no mesh of the whole, only a solid; known are {' '.join(SOLIDS)}")
    if inside:
        try:
            with tempfile.TemporaryDirectory() as scratch:
                _written(Path(scratch) / path.name, _on_trial, keep=False)
        except OSError as error:
            remedy = f"no file can be kept there for a while ({error.strerror or error}); set TMPDIR to another folder"
            raise InputError("environment", "TMPDIR", os.environ.get("TMPDIR"), remedy) from error
    else:
        _written(path, _on_trial, keep=False)
    return write_solid if suffix in SOLIDS else write_mesh


def write_solid(validation: Validation | StageValidation, path: Path) -> None:
    """Write the whole CAD solid [mm]."""
    import cadquery as cq

    design = validation.study.design
    if path.suffix.lower() == ".dxf":
        solid = _section(design)
    else:
        solid = cq.Workplane(design.stage().solid() if design.is_stage else design.part().solid())
    _written(path, lambda file: cq.exporters.export(solid, str(file), SOLIDS[path.suffix.lower()]))


def _section(design: Design) -> Any:
    """Return the end face of an extrusion, in its own plane, for a cutter [mm].

    Raises
    ------
    InputError
        If the design is no extrusion.
    """
    import cadquery as cq

    axis = None if design.is_stage else extrusion_axis(design.part())
    if axis is None:
        raise InputError(
            "command line", "--export", ".dxf", "only a part that is an extrusion has a section; take .step"
        )
    face = cq.Workplane(design.part().solid()).faces(f">{axis.upper()}")
    return cq.Workplane(face.workplane().plane).newObject(face.vals())


def write_mesh(validation: Validation, path: Path) -> None:
    """Write the finest mesh of the fundamental domain [m], with displacements and von Mises stress.

    Displacements are per unit actuator and output force; displacement and stress are also those at which the report
    states stress: full voltage and preload, or what the study says. A part without inputs has those per output force.
    """
    finest = validation.finest
    vertices = slice(len(finest.mesh.points))  # nodes are numbered corners first
    solution = finest.solution
    if not validation.has_input:
        fields: Mapping[str, Array] = {OF_OUTPUT: solution.output_field[vertices]}
        _written(path, lambda file: mesh.write(file, finest.mesh, fields))
        return
    force, _ = quantities.stated_force(validation.study, finest.solution)
    fields = _fields(
        force, solution.input_field[vertices], solution.output_field[vertices], solution.von_mises[vertices]
    )
    _written(path, lambda file: mesh.write(file, finest.mesh, fields))


def _fields(force: float, of_input: Array, of_output: Array, stress: Array) -> Mapping[str, Array]:
    return {
        "displacement_[m]": force * of_input,
        "von_mises_stress_[Pa]": force * stress,
        "displacement_per_actuator_force_[m/N]": of_input,
        OF_OUTPUT: of_output,
    }


def _on_trial(file: Path) -> None:
    if file.suffix.lower() in SOLIDS:
        file.write_bytes(b"")
        return
    corners, tets = np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]])
    tagged = TaggedMesh(corners, tets, mesh.boundary(tets), np.zeros(4, dtype=np.int64))
    with contextlib.redirect_stderr(io.StringIO()):  # the library's remarks come with the real mesh
        mesh.write(file, tagged, _fields(1.0, corners, corners, np.zeros(4)))


def _written(path: Path, write: Callable[[Path], None], *, keep: bool = True) -> None:
    """Write one file, and those some formats put next to it, whole or not at all."""
    try:
        with written_whole(path.parent) as scratch:
            write(scratch / path.name)
            if not (files := list(scratch.iterdir())):
                raise _refusal(path, "nothing was written; choose another place")
            for file in files if not keep else []:
                file.unlink()
    except InputError:
        raise
    except OSError as error:
        remedy = f"cannot be written ({error.strerror or error}); choose another place"
        raise _refusal(path, remedy) from error
    except Exception as error:  # each format's writer has errors of its own
        remedy = f"a mesh cannot be written as {path.suffix} ({error or type(error).__name__}); choose .vtu or .msh"
        raise _refusal(path, remedy) from error


def _refusal(path: Path, remedy: str) -> InputError:
    return InputError("command line", "--export", str(path), remedy)
