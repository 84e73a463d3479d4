"""The solid and the mesh in files for users' own tools."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError
from flexdesign.fem import mesh
from flexdesign.fem.mesh import TaggedMesh
from flexdesign.validation import Validation
from flexdesign.validation.stage_course import StageValidation

#: Suffixes the CAD kernel writes, and what it calls the formats.
SOLIDS = {".step": "STEP", ".stp": "STEP", ".stl": "STL", ".brep": "BREP"}


def writer(path: Path, *, stage: bool = False) -> Callable[[Any, Path], None]:
    """Return what writes the kind of file that the suffix names, given a validation and the path.

    A single tetrahedron is written on trial, so that what cannot be written is known before long work begins. A `stage`
    has a solid, but no mesh of the whole.

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
    if path.is_dir():
        raise _refusal(path, "is a folder; name a file in it")
    if not path.parent.is_dir():
        raise _refusal(path, "its folder does not exist; make it first")
    if stage and suffix not in SOLIDS:
        raise _refusal(path, f"a stage has no mesh of the whole, only a solid; known are {' '.join(SOLIDS)}")
    _written(path, _on_trial, keep=False)
    return write_solid if suffix in SOLIDS else write_mesh


def write_solid(validation: Validation | StageValidation, path: Path) -> None:
    """Write the whole CAD solid [mm]."""
    import cadquery as cq

    design = validation.study.design
    solid = cq.Workplane(design.stage().solid() if design.is_stage else design.part().solid())
    _written(path, lambda file: cq.exporters.export(solid, str(file), SOLIDS[path.suffix.lower()]))


def write_mesh(validation: Validation, path: Path) -> None:
    """Write the finest mesh of the fundamental domain [m], with displacements per unit actuator and output force."""
    finest = validation.finest
    vertices = slice(len(finest.mesh.points))  # nodes are numbered corners first
    fields = _fields(finest.solution.input_field[vertices], finest.solution.output_field[vertices])
    _written(path, lambda file: mesh.write(file, finest.mesh, fields))


def _fields(of_input: NDArray[np.float64], of_output: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
    return {"displacement_per_actuator_force_[m/N]": of_input, "displacement_per_output_force_[m/N]": of_output}


def _on_trial(file: Path) -> None:
    if file.suffix.lower() in SOLIDS:
        file.write_bytes(b"")
        return
    corners, tets = np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]])
    tagged = TaggedMesh(corners, tets, mesh.boundary(tets), np.zeros(4, dtype=np.int64))
    with contextlib.redirect_stderr(io.StringIO()):  # the library's remarks come with the real mesh
        mesh.write(file, tagged, _fields(corners, corners))


def _written(path: Path, write: Callable[[Path], None], *, keep: bool = True) -> None:
    """Write one file, and those some formats put beside it, whole or not at all."""
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as scratch:
            write(Path(scratch) / path.name)
            files = list(Path(scratch).iterdir())
            if not files:
                raise _refusal(path, "nothing was written; choose another place")
            for file in files if keep else []:
                file.replace(path.parent / file.name)
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
