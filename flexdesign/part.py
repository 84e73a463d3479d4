"""What a part must offer, and how parts are found: a part is one Python file with one class, under any folder.

The solid is in millimetres, because STEP and the CAD kernel's tolerances are; every other number is SI.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Literal, Protocol

from flexdesign import shipped
from flexdesign.errors import InputError
from flexdesign.materials import Material
from flexdesign.model import Linkage, Parameter, Quantity
from flexdesign.model.linkage import Vector

Axis = Literal["x", "y", "z"]

#: What the engine calls on a part.
METHODS = ("solid", "ports", "linkage", "symmetry", "formulas", "formula_shares", "intermediates")


@dataclass(frozen=True)
class Port:
    """A named face through which force and motion pass.

    Parameters
    ----------
    name
        ``input_left``, ``input_right``, ``output``, ``ground``.
    role
        What it is for. The actuator pushes the input ports apart, against their outward normals; the output
        moves along its outward normal; the ground is held.
    point
        A point in the middle of the face [m]: the face is found by it, and moments are taken about it.
    normal
        Outward normal of the face, a unit vector.
    """

    name: str
    role: Literal["input", "output", "ground"]
    point: Vector
    normal: Vector


@dataclass(frozen=True)
class SymmetryPlane:
    """A coordinate plane in which a part is its own mirror image.

    Parameters
    ----------
    axis
        The axis normal to the plane, which passes through the origin. The half with positive coordinates is kept.
    swaps
        Ports that the mirror exchanges, e.g. ``{"input_left": "input_right"}``, the second being the one kept.
    """

    axis: Axis
    swaps: Mapping[str, str]

    @property
    def index(self) -> int:
        """0, 1 or 2 for x, y or z."""
        return "xyz".index(self.axis)


class Part(Protocol):
    """A parametric shape: what the engine asks of it. `dimensions` are the fields that a design must give."""

    dimensions: ClassVar[tuple[Parameter, ...]]

    def solid(self) -> Any:
        """Return one closed CAD solid (a CadQuery ``Shape``), in millimetres."""

    def ports(self) -> tuple[Port, ...]:
        """Return the named faces."""

    def linkage(self) -> Linkage:
        """Return hinges, arms and rods as members between nodes."""

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the planes in which geometry *and* ports mirror onto themselves; empty if there are none."""

    def prismatic(self) -> Axis | None:
        """Return the axis along which the part is an extrusion, if it is one."""

    def formulas(self, material: Material, actuator_stiffness: float | None) -> Mapping[str, Sequence[Quantity]]:
        """Return the quantities of each analytic model by the model's name; each one's source names its equation.

        The first model is the one whose neglected compliances a validation names.
        """

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return what the compliances of the first model consist of [m/N].

        Keys are those of the stiffnesses they are the inverse of (``K_in_output_free``); the pieces are named as
        ``fem.resultants`` names them (``hinge bending``).
        """

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return every intermediate quantity of the first model under an actuator force [N], output free."""


def find(name: str, folder: Path) -> Path:
    """Find the file of the part `name`: a path, or a name looked up beside the design, in ./geometry, as shipped.

    Raises
    ------
    InputError
        If there is no such file.
    """
    places = [folder, Path("geometry"), shipped.root() / "geometry"]
    candidates = [folder / name] if name.endswith(".py") else [place / f"{name}.py" for place in places]
    for candidate in candidates:
        if shipped.is_file(candidate):
            return candidate
    looked = ", ".join(dict.fromkeys(str(c.parent) for c in candidates))
    known = sorted({p.stem for place in places if place.is_dir() for p in place.glob("*.py")})
    raise InputError("part", "part", name, f"no such part in {looked}{shipped.suggest(name, known)}")


def load(name: str, folder: Path | None = None) -> type[Part]:
    """Load the class of the part `name`.

    Raises
    ------
    InputError
        If the file is missing, fails to run, or holds no part.
    """
    path = find(name, folder or Path())
    module = _run(path)
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and value.__module__ == module.__name__ and hasattr(value, "dimensions")
    ]
    if len(classes) != 1:
        raise InputError(path, "", None, f"expected one class with `dimensions`, found {len(classes)}")
    missing = [m for m in ("solid", "ports", "linkage", "symmetry", "formulas") if not hasattr(classes[0], m)]
    if missing:
        raise InputError(path, classes[0].__name__, None, f"the part lacks {', '.join(missing)}()")
    return classes[0]


def source_hash(part: type[Part]) -> str:
    """Return the hash of the file a part came from; it travels with results."""
    return hashlib.sha256(Path(sys.modules[part.__module__].__file__ or "").read_bytes()).hexdigest()[:16]


def _run(path: Path) -> ModuleType:
    name = f"flexdesign_part_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(path, "", None, "cannot be loaded as a Python module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except InputError:
        raise
    except Exception as error:
        del sys.modules[name]
        raise InputError(path, "", None, f"the part file fails with {type(error).__name__}: {error}") from error
    return module
