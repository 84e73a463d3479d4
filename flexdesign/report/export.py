"""The solid and the mesh in files for users' own tools."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flexdesign.errors import InputError
from flexdesign.fem import mesh
from flexdesign.validation import Validation

#: Suffixes the CAD kernel writes.
SOLIDS = (".step", ".stp", ".stl", ".brep")


def writer(path: Path) -> Callable[[Validation, Path], None]:
    """Return what writes the kind of file that the suffix names.

    Raises
    ------
    InputError
        If there is no such kind, or no such folder.
    """
    import meshio

    if not path.parent.is_dir():
        raise InputError("command line", "--export", str(path), "its folder does not exist")
    if path.suffix.lower() in SOLIDS:
        return write_solid
    if path.suffix.lower() in meshio.extension_to_filetypes:
        return write_mesh
    known = " ".join([*SOLIDS, ".vtu", ".msh", ".inp", ".xdmf"])
    raise InputError("command line", "--export", str(path), f"unknown kind of file; known are {known}")


def write_solid(validation: Validation, path: Path) -> None:
    """Write the whole CAD solid [mm]."""
    import cadquery as cq

    cq.exporters.export(cq.Workplane(validation.study.design.part().solid()), str(path))


def write_mesh(validation: Validation, path: Path) -> None:
    """Write the finest mesh of the fundamental domain [m], with displacements per unit actuator and output force."""
    solution = validation.finest.solution
    fields = {
        "displacement per actuator force [m/N]": solution.input_field,
        "displacement per output force [m/N]": solution.output_field,
    }
    mesh.write(path, validation.finest.mesh, fields)
