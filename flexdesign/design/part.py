"""What a part must offer, and how parts are found: a part is one Python file with one class, under any folder.

The solid is in millimetres, because STEP and the CAD kernel's tolerances are; every other number is SI.
"""

from __future__ import annotations

import difflib
import functools
import hashlib
import importlib.util
import inspect
import math
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Literal, Protocol

from flexdesign.core import data_files, extras, foreign_code
from flexdesign.core.errors import InputError, import_remedy, suggest
from flexdesign.core.model import Linkage, Parameter, Quantity
from flexdesign.core.model.linkage import Vector
from flexdesign.core.toml_files import is_file
from flexdesign.design.materials import Material

Axis = Literal["x", "y", "z"]
Role = Literal["input", "output", "ground", "joint"]

#: What the engine calls on a piece, and on a part besides.
PIECE_METHODS = ("solid", "ports", "linkage", "symmetry")
METHODS = (*PIECE_METHODS, "formulas", "formula_shares", "intermediates")
#: What a part may leave out, and what it then says: nothing is known.
OPTIONAL: Mapping[str, Callable[..., Any]] = {
    "linkage": lambda _: Linkage({}, ()),
    "symmetry": lambda _: (),
    "formulas": lambda _self, _material, _actuator, _load: {},
    "formula_shares": lambda _self, _material: {},
    "intermediates": lambda _self, _material, _force: {},
}
#: What it calls on a whole stage, the first of which distinguishes it from a part.
STAGE_METHODS = ("assembly", "solid", "formulas", "springs", "arms")


@dataclass(frozen=True)
class Port:
    """A named face through which force and motion pass.

    Parameters
    ----------
    name
        ``input_left``, ``input_right``, ``output``, ``ground``.
    role
        What it is for. The actuator pushes the input ports apart, against their outward normals; the output
        moves along its outward normal; the ground is held; a joint is a face by which a piece of a stage is bonded.
    point
        A point in the middle of the face [m]: the face is found by it, and moments are taken about it.
    normal
        Outward normal of the face, a unit vector.
    faces
        Where the port is known by the places of its faces in ``solid().Faces()``; otherwise point and normal find it.
    rigid
        Whether its faces move as one body, as a bolted flange does, rather than carry an even traction.
    is_round
        Whether it is a cylinder, whose axis the normal then is, or whatever direction was given.
    """

    name: str
    role: Role
    point: Vector
    normal: Vector
    faces: tuple[int, ...] = ()
    rigid: bool = False
    is_round: bool = False


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


@dataclass(frozen=True)
class Outline:
    """The section of an extrusion with straight sides, given by its corners, so that no solid has to be built for it.

    Parameters
    ----------
    loops
        Corners of each closed contour in turn, along the two axes that follow that of the extrusion cyclically [m].
    low, high
        Where the extrusion begins and ends along its axis [m].
    """

    loops: Sequence[Sequence[tuple[float, float]]]
    low: float
    high: float


class Piece(Protocol):
    """A parametric shape that can be meshed, alone or in a stage; `dimensions` are the fields that make it."""

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
        """Return the axis along which the part is an extrusion, or None; without this method it is none.

        Such a part is meshed by layers, many times sooner at the same accuracy. What is extruded is read off the solid.
        """

    def outline(self) -> Outline | None:
        """Return the section of a prismatic part with straight sides, or None; without this method there is none.

        It must be the section of `solid`: sweeps then do without the solid, which takes longer than a planar solve.
        """


class Part(Piece, Protocol):
    """A piece with inputs, output and ground: what the engine asks of it, to compare it with theory.

    It may leave out any of these methods (`OPTIONAL`): without formulas the compliance model of its linkage is compared
    with FEM, and the sections of the report on shares and intermediate quantities say what is lacking.
    """

    def formulas(
        self, material: Material, actuator_stiffness: float | None, output_load: float | None
    ) -> Mapping[str, Sequence[Quantity]]:
        """Return the quantities of each analytic model by the model's name; each one's source names its equation.

        `actuator_stiffness` and `output_load` [N/m] ask for the quantities that hold with an actuator between the
        inputs and with a spring at the output. A validation names the neglected compliances of the first model.
        """

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return what the compliances of the first model consist of [m/N].

        Keys are those of the stiffnesses they are the inverse of (``K_in_output_free``); the pieces are named as
        ``fem.resultants`` names them (``hinge bending``).
        """

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return every intermediate quantity of the first model under an actuator force [N], output free."""


def find(name: str, folder: Path) -> Path:
    """Find the file of the part `name`: a path, or a name looked up next to the design, in ./geometry, as shipped.

    Raises
    ------
    InputError
        If there is no such file.
    """
    places = [folder, Path("geometry"), data_files.root() / "geometry"]
    candidates = [folder / name] if name.endswith(".py") else [place / f"{name}.py" for place in places]
    for candidate in candidates:
        if is_file(candidate):
            return candidate
    looked = ", ".join(dict.fromkeys(str(c.parent) for c in candidates))
    known = sorted({p.stem for place in places if place.is_dir() for p in place.glob("*.py")})
    raise InputError("part", "part", name, f"no such part in {looked}{suggest(name, known)}")


def load(name: str, folder: Path | None = None, methods: Sequence[str] = METHODS) -> type[Any]:
    """Load the class of the part or stage `name`, or of a piece, which has the fewer `methods` `PIECE_METHODS`.

    Whatever its methods raise later becomes an InputError that names the file and the line.

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
        found = ", ".join(c.__name__ for c in classes) or "none"
        raise InputError(path, "", None, f"a part file holds one class with `dimensions`, this one: {found}")
    (cls,) = classes
    if is_stage(cls):
        methods = STAGE_METHODS
    left_out = [method for method in OPTIONAL if methods == METHODS and not hasattr(cls, method)]
    for method in left_out:
        _require_no_misspelling(cls, method, path)
        setattr(cls, method, OPTIONAL[method])
    setattr(cls, "left_out", frozenset(left_out))  # noqa: B010
    missing = [method for method in methods if not callable(getattr(cls, method, None))]
    if missing:
        raise InputError(path, cls.__name__, None, f"the part lacks {', '.join(f'{m}()' for m in missing)}; add it")
    if not _all_are(cls.dimensions, Parameter):
        raise InputError(path, f"{cls.__name__}.dimensions", None, "must be a tuple of flexdesign.Parameter")
    for method in (*methods, "prismatic", "outline"):
        function = inspect.getattr_static(cls, method, None)
        if inspect.isfunction(function):
            setattr(cls, method, _guard(function, f"{cls.__name__}.{method}()", path))
    return cls


def states(part: Piece, method: str) -> bool:
    """Tell whether a part has one of the methods that it may leave out."""
    return hasattr(part, method) and method not in getattr(part, "left_out", ())


def _require_no_misspelling(cls: type[Any], method: str, path: Path) -> None:
    """Raise InputError if a part lacks an optional method and has one of nearly its name."""
    others = [name for name in vars(cls) if name not in METHODS and not name.startswith("_")]
    if closest := difflib.get_close_matches(method, others, n=1, cutoff=0.75):
        raise InputError(path, cls.__name__, None, f"the part lacks {method}(); rename {closest[0]} if it is meant")


def is_stage(cls: type[Any]) -> bool:
    """Tell whether a class is a stage rather than one part."""
    return callable(getattr(cls, STAGE_METHODS[0], None))


def examine(part: Part) -> None:
    """Check what a part says of itself, before anything is built.

    Raises
    ------
    InputError
        If ports, linkage or symmetry cannot be used, or one of them fails.
    """
    ports, linkage, planes, axis = part.ports(), part.linkage(), part.symmetry(), extrusion_axis(part)

    def require(fact: bool, method: str, value: object, remedy: str) -> None:
        if not fact:
            raise InputError(file_of(type(part)), f"{type(part).__name__}.{method}()", value, remedy)

    require(_all_are(ports, Port), "ports", None, "must return a tuple of flexdesign.Port")
    names = [port.name for port in ports]
    for port in ports:
        require(names.count(port.name) == 1, "ports", port.name, "two ports have this name")
        unit = math.isclose(math.hypot(*port.normal), 1.0, abs_tol=1e-9)
        require(unit, "ports", port.normal, f"the normal of {port.name} must be a unit vector")
    for role in ("output", "ground"):
        found = ", ".join(sorted({port.role for port in ports})) or None
        require(any(port.role == role for port in ports), "ports", found, f"there is no port with the role {role}")
    require(isinstance(linkage, Linkage), "linkage", None, "must return a flexdesign.Linkage")
    hinges = linkage.of_kind("hinge")
    require(bool(hinges) or not linkage.members, "linkage", None,
            "there is no member of the kind hinge, towards which the mesh is graded; name one, or leave linkage() out, "
            "and thin regions are found on the solid")  # fmt: skip
    for hinge in hinges:
        sizes = (hinge.length, hinge.thickness, hinge.width)
        require(all(0 < size < math.inf for size in sizes), "linkage", sizes, f"{hinge.name} has no size")
    require(_all_are(planes, SymmetryPlane), "symmetry", None, "must return a tuple of flexdesign.SymmetryPlane")
    require(axis in ("x", "y", "z", None), "prismatic", axis, "the axis must be x, y or z, or None")
    outline = straight_outline(part)
    require(outline is None or (isinstance(outline, Outline) and axis is not None), "outline", None,
            "must return a flexdesign.Outline or None, and only where prismatic() names an axis")  # fmt: skip
    axes = [plane.axis for plane in planes]
    for plane in planes:
        require(plane.axis in ("x", "y", "z"), "symmetry", plane.axis, "the axis must be x, y or z")
        require(axes.count(plane.axis) == 1, "symmetry", plane.axis, "two planes have this axis")
        for name in (*plane.swaps, *plane.swaps.values()):
            require(name in names, "symmetry", name, f"swaps a port that does not exist{suggest(name, names)}")
        both = [name for name in plane.swaps if name in plane.swaps.values()]
        require(not both, "symmetry", ", ".join(both), "state each pair once: the port that is kept as the second")
        held = [port.name for port in ports if port.role == "ground" and port.name in plane.swaps]
        require(not held, "symmetry", ", ".join(held), "a ground port must be its own mirror image")


def extrusion_axis(part: Piece) -> Axis | None:
    """Return the axis along which a part declares itself an extrusion, or None."""
    declared: Callable[[], Axis | None] | None = getattr(part, "prismatic", None)
    return declared() if declared is not None else None


def straight_outline(part: Piece) -> Outline | None:
    """Return the section that a part states by its corners, or None."""
    outline: Callable[[], Outline | None] | None = getattr(part, "outline", None)
    return outline() if outline is not None else None


def in_file(part: Piece, point: Sequence[float]) -> tuple[float, ...]:
    """Return where the file of a part has a point [m]: what is read from a file may have been moved, see `StepPart`."""
    moved = part.moved() if hasattr(part, "moved") else (0.0, 0.0, 0.0)
    return tuple(float(x - away) for x, away in zip(point, moved, strict=True))


def file_of(part: type[Any]) -> Path:
    """Return the file a part or a stage came from."""
    if (source := getattr(part, "source_file", None)) is not None:
        return Path(source)
    return Path(sys.modules[part.__module__].__file__ or "")


def source_hash(part: type[Piece]) -> str:
    """Return the hash of the file a part came from, and of what its design draws of it; it travels with results."""
    return hashlib.sha256(file_of(part).read_bytes() + sketch_text(part).encode()).hexdigest()[:16]


def sketch_text(part: type[Any]) -> str:
    """Return what a design draws of its part itself, as text; empty for a part that its file describes completely."""
    return str(getattr(part, "drawn_as", ""))


def reason(error: BaseException, path: Path) -> str:
    """Say in one line what a part file raised, and in which of its lines."""
    if isinstance(error, SyntaxError):
        text, lines = error.msg, [error.lineno]
    else:
        frames = traceback.extract_tb(error.__traceback__)
        text, lines = str(error), [frame.lineno for frame in frames if Path(frame.filename).name == path.name]
    place = f" ({path.name}, line {lines[-1]})" if lines else ""
    return f"{type(error).__name__}: {' '.join(text.split())}".removesuffix(": ") + place


def _guard(function: Callable[..., Any], field: str, path: Path) -> Callable[..., Any]:
    """Return a method whose failure is an InputError; of `solid`, whose answer is a shape."""

    @functools.wraps(function)
    def method(*arguments: Any, **options: Any) -> Any:
        try:
            answer = function(*arguments, **options)
        except InputError:
            raise
        except Exception as error:
            failed = f"fails with {reason(error, path)}; correct the part, or change the dimensions it fails with"
            remedy = extras.remedy(error) or failed
            raise InputError(path, field, None, remedy) from error
        if function.__name__ == "solid" and not hasattr(answer, "Solids"):
            remedy = "must return a CadQuery shape; the shape of a Workplane is its .val()"
            raise InputError(path, field, "None" if answer is None else type(answer).__name__, remedy)
        return answer

    return method


def _all_are(values: object, kind: type) -> bool:
    return isinstance(values, (tuple, list)) and all(isinstance(value, kind) for value in values)


def _run(path: Path) -> ModuleType:
    name = f"flexdesign_part_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    try:
        foreign_code.admit(path, "part")
    except PermissionError as error:
        raise InputError(path, "", None, str(error)) from None
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(path, "", None, "cannot be loaded as a Python module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, (InputError, KeyboardInterrupt)):
            raise
        remedy = import_remedy(error) or extras.remedy(error) or f"fails with {reason(error, path)}; correct it"
        raise InputError(path, "", None, f"the part file {remedy}") from error
    return module
