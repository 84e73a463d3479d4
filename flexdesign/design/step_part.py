"""A part read from a STEP file: the design says which of its faces are ports, and finite elements do the rest.

No formulas are known of it and no members; the mesh is graded towards what is thin on the solid, and planes in which
the solid is its own mirror image are found.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator

from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Linkage, Parameter, Quantity
from flexdesign.core.model.linkage import Vector
from flexdesign.core.toml_files import STEP, Bounds, Table, as_written, check, is_file
from flexdesign.design import faces, mirror, step_file
from flexdesign.design.faces import MM, Query, SolidFace
from flexdesign.design.materials import Material
from flexdesign.design.part import Axis, Port, Role, SymmetryPlane

#: Of solids in files that only their own programs read, or that hold no closed solid.
OTHER_ENDINGS = (
    *(".sldprt", ".sldasm", ".ipt", ".iam", ".catpart", ".prt", ".par", ".f3d", ".fcstd", ".x_t", ".x_b", ".3dm"),
    *(".igs", ".iges", ".stl"),
)
ROLES: tuple[Role, ...] = ("input", "output", "ground")
_PLACE = Bounds("m", -10.0, 10.0)
_RADIUS = Bounds("m", 1e-6, 10.0)


def _vector(given: object, read: Any, example: str) -> Vector:
    if not isinstance(given, (list, tuple)) or len(given) != 3:
        raise ValueError(f"expected three numbers, such as {example}")
    x, y, z = (read(number) for number in given)
    return x, y, z


def _place(given: object) -> Vector:
    return _vector(given, _PLACE.read, '["0 mm", "20 mm", "5 mm"]')


def _direction(given: object) -> Vector:
    vector = np.array(_vector(given, float, "[0, 0, 1]"))
    length = float(np.linalg.norm(vector))
    if not length > 0 or not math.isfinite(length):
        raise ValueError("a direction must have a length")
    x, y, z = (vector / length).tolist()
    return x, y, z


def _names(given: object) -> tuple[str, ...]:
    named = [given] if isinstance(given, str) else given
    if not isinstance(named, list) or not named or not all(isinstance(name, str) and name for name in named):
        raise ValueError(
            'expected the name of a face, or a list of names, such as "top"; faces have no numbers here: '
            "`flexdesign ports` with the STEP file lists names, and of a face without one the point and normal to give "
            "instead"
        )
    return tuple(named)


class PortTable(Table):
    """Which faces are a port, and how it is held or driven.

    Faces are found by `face`, a name or several that the file gives; by `colour`, as #rrggbb; by `plane`, such as
    ``z = max``; or by a `point` near them and their outward `normal`, which a name may have besides, should it get
    lost. A bore or a shaft is found by a `point` on its axis, its `axis`, and, where several cylinders have this axis,
    its `radius`. With `interface` ``rigid`` the faces move as one body, as a bolted flange or a bore about a pin does;
    ``traction`` leaves them free to deform. Motions and moments are those about the point `about`, the middle of the
    faces where nothing is said. A port is pushed, and its motion counted, along its `direction`: the outward normal of
    a plane, or the axis of a cylinder, where nothing is said.
    """

    role: Literal["input", "output", "ground"] | None = None
    face: Annotated[tuple[str, ...], BeforeValidator(_names)] = ()
    colour: str = ""
    plane: str = ""
    point: Annotated[Vector, BeforeValidator(_place), _PLACE] | None = None
    normal: Annotated[Vector, BeforeValidator(_direction)] | None = None
    interface: Literal["traction", "rigid"] = "traction"
    about: Annotated[Vector, BeforeValidator(_place), _PLACE] | None = None
    axis: Annotated[Vector, BeforeValidator(_direction)] | None = None
    radius: Annotated[float, BeforeValidator(_RADIUS.read), _RADIUS] | None = None
    direction: Annotated[Vector, BeforeValidator(_direction)] | None = None

    @property
    def query(self) -> Query:
        """What is looked for."""
        return Query(self.face, self.colour, self.plane, self.point, self.normal, self.axis, self.radius)


@dataclass(frozen=True)
class _Placed:
    """A body with its ports where its planes of symmetry pass through the origin.

    Parameters
    ----------
    body, faces, ports, planes
        The body, its faces and ports, and the planes.
    moved
        By how much the body of the file was moved [m].
    """

    body: step_file.StepBody
    faces: tuple[SolidFace, ...]
    ports: tuple[Port, ...]
    planes: tuple[SymmetryPlane, ...] = ()
    moved: Vector = (0.0, 0.0, 0.0)


class StepPart:
    """A part of a STEP file; `load` makes a class of it for the ports of one design."""

    dimensions: ClassVar[tuple[Parameter, ...]] = ()
    source_file: ClassVar[Path]
    source_solids: ClassVar[tuple[str, ...]] = ()
    design_file: ClassVar[Path]
    port_tables: ClassVar[Mapping[str, PortTable]]
    #: What a STEP file does not contain: see `flexdesign.design.part.states`.
    left_out: ClassVar[frozenset[str]] = frozenset({"formulas", "formula_shares", "intermediates"})
    _placed: ClassVar[_Placed | None] = None

    @classmethod
    def placed(cls) -> _Placed:
        """Return the solid with what its file says of it, and its ports, where planes of symmetry are at the origin."""
        if cls._placed is None:
            body = step_file.read(cls.source_file, cls.source_solids)
            found, size = listed(body), body.solid.BoundingBox().DiagonalLength * MM
            ports = [_port(name, table, found, size, cls.design_file) for name, table in cls.port_tables.items()]
            _require_apart(ports, cls.design_file)
            cls._placed = _symmetrically_placed(_Placed(body, found, tuple(ports)))
        return cls._placed

    def notes(self) -> tuple[str, ...]:
        """Return what was done to the solid when it was read, and in which unit its file is."""
        placed = self.placed()
        unit = f"Unit of length in the file: {placed.body.unit.lower()}." if placed.body.unit else ""
        axes = " and ".join(
            f"{way / MM:+.4g} mm along {axis}" for axis, way in zip("xyz", placed.moved, strict=True) if way
        )
        moved = (
            f"The solid was moved by {axes} to be solved, so that its planes of symmetry pass through the origin."
            if axes
            else ""
        )
        return tuple(note for note in (unit, *placed.body.notes, moved) if note)

    def moved(self) -> Vector:
        """Return by how much the solid of the file was moved, planes of symmetry to the origin [m]."""
        return self.placed().moved

    def solid(self) -> Any:
        """Return the closed solid [mm]."""
        return self.placed().body.solid

    def faces(self) -> tuple[SolidFace, ...]:
        """Return the faces of the solid."""
        return self.placed().faces

    def ports(self) -> tuple[Port, ...]:
        """Return the ports, each with its faces."""
        return self.placed().ports

    def linkage(self) -> Linkage:
        """Return no members: nobody named any."""
        return Linkage({}, ())

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the coordinate planes in which solid and ports are their own mirror images."""
        return self.placed().planes

    def prismatic(self) -> Axis | None:
        """Return None: whether it is an extrusion is not stated."""
        return None

    def formulas(
        self, material: Material, actuator_stiffness: float | None, output_load: float | None
    ) -> Mapping[str, list[Quantity]]:
        """Return no formulas."""
        return {}

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return no pieces of formulas."""
        return {}

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return nothing."""
        return {}


def is_step(name: str) -> bool:
    """Tell whether a design's `part` is a STEP file."""
    return name.lower().endswith(STEP)


def is_other_solid(name: str) -> bool:
    """Tell whether a design's `part` is a file of a CAD program that is no STEP file."""
    return name.lower().endswith(OTHER_ENDINGS)


def listed(body: step_file.StepBody) -> tuple[SolidFace, ...]:
    """Return the faces of a body."""
    return faces.of_solid(body.solid, body.names, body.colours)


def load(name: str, tables: Mapping[str, Any], design_file: Path, solids: Sequence[str | int] = ()) -> type[StepPart]:
    """Return the class of a part: the STEP file `name` next to the design, with the ports of the design.

    Parameters
    ----------
    name
        Of the file.
    tables
        The table of each port, by its name.
    design_file
        The design.
    solids
        Names or numbers of the solids that are meant, where the file holds several; by default all.

    Raises
    ------
    InputError
        If the file or a port cannot be used.
    """
    path = design_file.parent / name
    if not is_file(path):
        known = sorted(p.name for p in design_file.parent.glob("*") if is_step(p.name))
        raise InputError(design_file, "part", name, f"no such file next to the design{suggest(name, known)}")
    checked = {}
    for port, table in tables.items():
        checked[port] = check(PortTable, table, design_file, f"ports.{port}") if table else PortTable()
        _require_role(port, checked[port], design_file)
    roles = [_role(port, table) for port, table in checked.items()]
    if "ground" not in roles:
        remedy = (
            'the body is held nowhere; name the faces that are, such as [ports.ground] with plane = "z = min" '
            f"(`flexdesign ports {name}` lists the faces)"
        )
        raise InputError(design_file, "ports", ", ".join(checked) or None, remedy)
    if roles.count("output") != 1:
        remedy = "exactly one port must have the role output: the faces whose motion is sought"
        raise InputError(design_file, "ports", ", ".join(checked), remedy)
    digest = hashlib.sha256(repr((str(path.resolve()), design_file, solids, checked)).encode()).hexdigest()[:8]
    title = "".join(word.capitalize() for word in re.split(r"\W+|_", path.stem) if word) or "Step"
    content = {
        "source_file": path,
        "source_solids": tuple(map(str, solids)),
        "design_file": design_file,
        "port_tables": checked,
        "_placed": None,
    }
    cls: type[StepPart] = type(title, (StepPart,), content | {"digest": digest})
    return cls


def _role(port: str, table: PortTable) -> Role | None:
    """Return the role of a port; where it is not stated, the one its name begins with."""
    return table.role or next((role for role in ROLES if port.startswith(role)), None)


def _require_role(port: str, table: PortTable, file: Path) -> None:
    if _role(port, table) is None:
        remedy = 'is missing; write role = "ground", "input" or "output", or let the port\'s name begin with it'
        raise InputError(file, f"ports.{port}.role", None, remedy)
    ways = [key for key in ("face", "colour", "plane") if getattr(table, key)]
    if table.axis is not None:
        ways += ["axis"] if ways else []
    elif table.radius is not None:
        raise InputError(
            file, f"ports.{port}.radius", f"{1e3 * table.radius:g} mm", "give the axis of the cylinder, too"
        )
    if len(ways) > 1:
        raise InputError(file, f"ports.{port}", " and ".join(ways), "name the faces in one way only")
    if not ways and (table.point is None or (table.normal is None and table.axis is None)):
        remedy = (
            'names no face; give face = "name", colour = "#rrggbb", plane = "z = max", point and normal, or of a '
            "cylinder point and axis"
        )
        raise InputError(file, f"ports.{port}", None, remedy)


def _port(name: str, table: PortTable, found: tuple[SolidFace, ...], size: float, file: Path) -> Port:
    way = next((key for key in ("face", "colour", "plane") if getattr(table, key)), "point")
    chosen = faces.find(table.query, found, (file, f"ports.{name}.{way}"), size)
    areas = np.array([face.area for face in chosen])
    of_cylinder = chosen[0].axis is not None
    places = [faces.on_axis(face) if of_cylinder else np.array(face.centroid) for face in chosen]
    middle = _triple(areas @ np.array(places) / areas.sum())
    role = _role(name, table)
    assert role is not None
    return Port(
        name,
        role,
        table.about or middle,
        table.direction or chosen[0].axis or chosen[0].normal,
        faces=tuple(face.index for face in chosen),
        rigid=table.interface == "rigid",
        is_round=chosen[0].kind == "cylinder",
    )


def _symmetrically_placed(placed: _Placed) -> _Placed:
    """Return a body moved so that each plane in which it is its own mirror image passes through the origin."""
    import cadquery as cq

    size = placed.body.solid.BoundingBox().DiagonalLength * MM
    centre = np.array(cq.Shape.centerOfMass(placed.body.solid).toTuple()) * MM
    planes = mirror.planes_of(*_moved(placed, -centre))
    within = np.isin(range(3), [plane.index for plane in planes])
    away = np.where(within & (np.abs(centre) > mirror.BALANCED * size), -centre, 0.0)
    solid, found, ports = _moved(placed, away) if away.any() else (placed.body.solid, placed.faces, placed.ports)
    # Rounding must not lift a port off the plane that halves it.
    places = [np.where(within & (np.abs(port.point) < mirror.ALIKE * size), 0.0, port.point) for port in ports]
    ports = tuple(replace(port, point=_triple(place)) for port, place in zip(ports, places, strict=True))
    return _Placed(replace(placed.body, solid=solid), found, ports, planes, _triple(away))


def _triple(values: NDArray[np.float64]) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


def _moved(placed: _Placed, away: NDArray[np.float64]) -> tuple[Any, tuple[SolidFace, ...], tuple[Port, ...]]:
    """Return solid, faces and ports moved by a vector [m]."""
    import cadquery as cq

    body = replace(placed.body, solid=placed.body.solid.translate(cq.Vector(*(away / MM))))
    ports = [replace(port, point=_triple(np.array(port.point) + away)) for port in placed.ports]
    return body.solid, listed(body), tuple(ports)


def _require_apart(ports: list[Port], file: Path) -> None:
    """Raise InputError if two ports have a face in common."""
    owner: dict[int, str] = {}
    for port in ports:
        for face in port.faces:
            if face in owner:
                remedy = f"has face {face + 1} in common with {owner[face]}; a face belongs to one port"
                raise InputError(file, f"ports.{port.name}", as_written(port.name), remedy)
            owner[face] = port.name
