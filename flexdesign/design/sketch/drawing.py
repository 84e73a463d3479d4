"""A sketch in numbers: polygons, flexures and ports [m], and what makes them no mechanism."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Notch
from flexdesign.design.part import Port
from flexdesign.design.sketch import polygons

Profile = Literal["leaf", "circular", "elliptic", "parabolic", "v"]
#: Corners of a side of a notch, when a polygon approximates it.
NOTCH_CORNERS = 24
#: Length over thickness of the slenderest leaf. Rounding in finite elements grows with its fourth power: of a
#: parallelogram's stiffness it is 4e-5 at 500, 1 % at 2000, 30 % at 5000; from 6000 on the matrix cannot be factorized.
SLENDEREST = 2000.0
#: Length over thickness below which a leaf is called stout: at 2 its shear adds 78 % to the sway of its bending.
STOUTEST = 2.0


@dataclass(frozen=True, eq=False)
class Body:
    """A stout piece: its name and its corners, shape (n, 2) [m].

    Raises
    ------
    InputError
        If its outline encloses no area, or crosses itself.
    """

    name: str
    corners: Array

    def __post_init__(self) -> None:
        _require_simple(self)


@dataclass(frozen=True, eq=False)
class Flexure:
    """A thin piece between two bodies.

    Parameters
    ----------
    name
        Its name.
    bodies
        Those at its start and its end.
    start, end
        Ends of its axis [m].
    thickness
        In the plane; of a notch at its neck [m].
    profile
        ``leaf``; ``circular``, two half circles whose diameter is the length; ``elliptic``, ``parabolic`` or ``v``.
    fillet
        Radius at its roots, of a V at its neck [m].
    depth
        Of a notch, how far each side rises from the neck to the ends [m]; of a circle half the length.
    kind
        ``hinge``, or ``rod``: a beam that bends as a cantilever does, held at its end.
    """

    name: str
    bodies: tuple[str, str]
    start: Array
    end: Array
    thickness: float
    profile: Profile = "leaf"
    fillet: float = 0.0
    kind: Literal["hinge", "rod"] = "hinge"
    depth: float = 0.0

    @cached_property
    def notch(self) -> Notch | None:
        """The shape of a notch; None for a leaf."""
        half = self.length / 2
        if self.profile == "circular":
            return Notch.circular(half, half)
        if self.profile == "elliptic":
            return Notch.elliptic(half, self.depth)
        if self.profile == "parabolic":
            return Notch.parabolic(half, self.depth)
        return Notch.v(half, self.depth, self.fillet) if self.profile == "v" else None

    @property
    def end_thickness(self) -> float:
        """Thickness at its ends, without fillets [m]."""
        return self.thickness + (2 * self.notch.depth if self.notch is not None else 0.0)

    @property
    def root_fillet(self) -> float:
        """Radius of the fillets at its roots [m]."""
        return 0.0 if self.profile == "v" else self.fillet

    @property
    def length(self) -> float:
        """Distance between the ends [m]."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def axis(self) -> Array:
        """Unit vector from start to end."""
        return np.asarray((self.end - self.start) / self.length)

    @property
    def normal(self) -> Array:
        """Unit vector to the left of the axis."""
        return np.array([-self.axis[1], self.axis[0]])

    @property
    def ends(self) -> tuple[tuple[str, Array, Array], tuple[str, Array, Array]]:
        """The body, the point and the way out of the flexure at the start and at the end."""
        return (self.bodies[0], self.start, -self.axis), (self.bodies[1], self.end, self.axis)

    @cached_property
    def corners(self) -> Array:
        """Its outline [m]; of a notch chords."""
        notch = self.notch
        if notch is None:
            half = self.thickness / 2 * self.normal
            return np.array([self.start - half, self.end - half, self.end + half, self.start + half])
        along = -self.length / 2 * np.cos(np.linspace(0.0, math.pi, NOTCH_CORNERS + 1))
        up = self.thickness / 2 + notch.rise(along)
        middle = (self.start + self.end) / 2
        lower, upper = (middle + np.outer(along, self.axis) + sign * np.outer(up, self.normal) for sign in (-1.0, 1.0))
        return np.concatenate([lower, upper[::-1]])


@dataclass(frozen=True, eq=False)
class Drawing:
    """A mechanism in numbers.

    Parameters
    ----------
    bodies, flexures
        Its pieces, by their names.
    ports
        Its faces; the body of each by the port's name in `carriers`.
    carriers
        Body by port.
    thickness
        Of the plate [m].

    Raises
    ------
    InputError
        If it is no mechanism: the first thing that is wrong with it.
    """

    bodies: dict[str, Body]
    flexures: dict[str, Flexure]
    ports: tuple[Port, ...]
    carriers: dict[str, str]
    thickness: float

    def __post_init__(self) -> None:
        for flexure in self.flexures.values():
            self._require_ends(flexure)
        self._require_apart()
        self._require_grounded()

    def carried_by(self, role: str) -> list[str]:
        """Return the bodies that carry the ports of a role."""
        return list(dict.fromkeys(self.carriers[port.name] for port in self.ports if port.role == role))

    def stout_leaves(self) -> list[Flexure]:
        """Return the hinges without notch that are no beams: shear and bodies give way about as much as they bend."""
        leaves = [f for f in self.flexures.values() if f.kind == "hinge" and f.profile == "leaf"]
        return [leaf for leaf in leaves if leaf.length < STOUTEST * leaf.thickness]

    def is_spring(self, flexure: Flexure) -> bool:
        """Tell whether a flexure is a leaf longer than one of its bodies."""
        extents = (polygons.extent(self.bodies[name].corners) for name in flexure.bodies)
        return flexure.profile == "leaf" and flexure.length > min(extents)

    def feet(self, flexure: Flexure, number: int) -> Array:
        """Return where the sides of a flexure meet the body at its start (0) or end (1): right, left, (2, 2) [m].

        Where the body's side is not square to the flexure, one side of it reaches the body behind its end, one before.
        A side that runs past the body is infinitely far from it.
        """
        name, point, way = flexure.ends[number]
        corners = self.bodies[name].corners
        found = []
        for side in (-1, 1):
            corner = point + side * flexure.end_thickness / 2 * flexure.normal
            if not polygons.on_boundary(corners, corner):
                on = -1 if polygons.contains(corners, corner) else 1
                reach = polygons.distance(polygons.sides(corners), corner, on * way)
                corner = corner + on * reach * way if math.isfinite(reach) else np.full(2, np.inf)
            found.append(corner)
        return np.array(found)

    @cached_property
    def attached(self) -> dict[str, list[tuple[Flexure, Array, Array]]]:
        """By body what ends at it: the flexure, its end there [m], and the way on into the body."""
        found: dict[str, list[tuple[Flexure, Array, Array]]] = defaultdict(list)
        for flexure in self.flexures.values():
            for body, point, way in flexure.ends:
                found[body].append((flexure, point, way))
        return dict(found)

    def _require_ends(self, flexure: Flexure) -> None:
        """Refuse a flexure without size, or one that does not end at its bodies."""
        field = f"flexure.{flexure.name}"
        if flexure.thickness <= 0:
            raise InputError("design", f"{field}.thickness", _mm(flexure.thickness), "must be more than 0 mm")
        if flexure.length <= 10 * polygons.TOLERANCE:
            raise InputError("design", field, _mm(flexure.length), "its two ends coincide; move one of them")
        if flexure.profile == "leaf" and flexure.length > SLENDEREST * flexure.thickness:
            least = _um(flexure.length / SLENDEREST)
            remedy = (
                f"is too thin on {_mm(flexure.length)} of length: below {least} rounding takes more than 1 % of its "
                "stiffness; check the unit, or make it thicker or shorter"
            )
            raise InputError("design", f"{field}.thickness", _um(flexure.thickness), remedy)
        _require_notch(flexure, field)
        if flexure.profile != "v" and (flexure.fillet < 0 or flexure.fillet > 0.45 * flexure.length):
            remedy = f"allowed: 0 mm to {_mm(0.45 * flexure.length)}, so that two fillets fit on its length"
            raise InputError("design", f"{field}.fillet", _mm(flexure.fillet), remedy)
        if flexure.bodies[0] == flexure.bodies[1]:
            raise InputError("design", f"{field}.between", flexure.bodies[0], "is named twice; name two bodies")
        for number, (name, point, _) in enumerate(flexure.ends):
            corners = self.bodies[name].corners
            if polygons.on_boundary(corners, point):
                if not (np.abs(self.feet(flexure, number) - point).max() < flexure.length + flexure.end_thickness):
                    wide = f"{_mm(flexure.end_thickness)} thick at its end {_at(point)}"
                    remedy = f"reaches past the side of the body {name}; make the body wider there, or move the flexure"
                    raise InputError("design", field, wide, remedy)
                continue
            if not polygons.contains(corners, point):
                remedy = f"ends outside the body {name}; let it end on the body's boundary"
                raise InputError("design", field, _at(point), remedy)
            if flexure.kind == "hinge":
                remedy = f"ends within the body {name}, as only a rod may; let it end on the body's boundary"
                raise InputError("design", field, _at(point), remedy)

    def _require_apart(self) -> None:
        """Refuse pieces that run into each other."""
        for one, two in combinations(self.flexures.values(), 2):
            if polygons.overlap(one.corners, two.corners):
                remedy = f"overlaps the flexure {two.name}; move one of them, or make it thinner"
                raise InputError("design", f"flexure.{one.name}", _at((one.start + one.end) / 2), remedy)
        for one_body, other in combinations(self.bodies.values(), 2):
            shared = polygons.overlap(one_body.corners, other.corners)
            if shared or polygons.touch(one_body.corners, other.corners):
                remedy = f"{'overlaps' if shared else 'touches'} the body {other.name}; draw them apart, or as one body"
                raise InputError("design", f"body.{one_body.name}", _at(one_body.corners.mean(axis=0)), remedy)
        for flexure in self.flexures.values():
            for body in self.bodies.values():
                if body.name not in flexure.bodies and polygons.overlap(flexure.corners, body.corners):
                    remedy = f"runs into the body {body.name}, which it does not join; move one of them"
                    raise InputError("design", f"flexure.{flexure.name}", _at(flexure.start), remedy)

    def _require_grounded(self) -> None:
        """Refuse a body that no chain of flexures joins to the ground, and one that moves by itself."""
        reached = set(self.carried_by("ground"))
        waiting = list(reached)
        while waiting:
            for flexure, _, _ in self.attached.get(waiting.pop(), []):
                new = set(flexure.bodies) - reached
                reached |= new
                waiting += new
        for name in self.bodies:
            if name not in reached:
                remedy = "is joined to the ground by no chain of flexures; add a flexure, or leave the body out"
                raise InputError("design", f"body.{name}", None, remedy)
        for name, motion in self.idle():
            remedy = (
                f"moves by itself while input, output and ground stand still ({motion}); hold it by another flexure"
            )
            raise InputError("design", f"body.{name}", None, remedy)

    def idle(self) -> Sequence[tuple[str, str]]:
        """Return bodies that move by themselves were all hinges pivots, and how: internal mobility.

        Bodies with ports are held. A hinge then binds two motions of its middle, a rod all three; what motion no
        constraint binds is internal mobility, which nothing but the hinges' own stiffness opposes. A leaf longer than a
        body that it joins is no pivot but a spring, such as those of a serpentine: it binds all three, too. A body on a
        single hinge moves by itself, however long that is.
        """
        free = [name for name in self.bodies if name not in self.carriers.values()]
        if not free:
            return []
        for name in free:
            if len(ends := self.attached[name]) == 1 and ends[0][0].kind == "hinge":
                return [(name, f"{ends[0][0].name} alone joins it")]
        size = max(float(np.ptp(body.corners)) for body in self.bodies.values())
        rows = []
        for flexure in self.flexures.values():
            middle, row = (flexure.start + flexure.end) / 2, np.zeros((3, 3 * len(free)))
            for name, sign in zip(flexure.bodies, (-1.0, 1.0), strict=True):
                if name in free:
                    dx, dy = (middle - self.bodies[name].corners.mean(axis=0)) / size
                    place = 3 * free.index(name)
                    row[:, place : place + 3] = sign * np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
            rows.append(row if flexure.kind == "rod" or self.is_spring(flexure) else row[:2])
        _, values, shapes = np.linalg.svd(np.concatenate(rows))
        rank = int((values > 1e-9 * values[0]).sum())
        if rank == 3 * len(free):
            return []
        shape = np.abs(shapes[rank:]).max(axis=0).reshape(-1, 3)
        found = int(shape.max(axis=1).argmax())
        turning = shape[found, 2] >= shape[found].max() - 1e-9
        return [(free[found], "it turns" if turning else "it shifts")]


def _require_notch(flexure: Flexure, field: str) -> None:
    """Refuse a notch without a depth, a depth of what has none, and a V without an arc."""
    if flexure.profile in ("leaf", "circular"):
        if flexure.depth:
            what = "a leaf has none" if flexure.profile == "leaf" else "that of a circular notch is half its length"
            raise InputError("design", f"{field}.depth", _mm(flexure.depth), f"{what}; leave it out")
        return
    if flexure.depth <= 0:
        remedy = f"must be more than 0 mm: how far each side of the {flexure.profile} notch rises from neck to end"
        raise InputError("design", f"{field}.depth", _mm(flexure.depth), remedy)
    if flexure.profile != "v" and flexure.fillet:
        remedy = "only a leaf has fillets at its roots, and a v one at its neck; leave it out"
        raise InputError("design", f"{field}.fillet", _mm(flexure.fillet), remedy)
    try:
        flexure.notch  # noqa: B018
    except ValueError as error:
        raise InputError("design", f"{field}.fillet", _mm(flexure.fillet), str(error)) from None


def _require_simple(body: Body) -> None:
    field = f"body.{body.name}"
    gaps = np.linalg.norm(body.corners - np.roll(body.corners, 1, axis=0), axis=1)
    if (gaps < 10 * polygons.TOLERANCE).any():
        at = body.corners[int(gaps.argmin())]
        raise InputError("design", field, _at(at), "two neighbouring corners coincide; the body has no size there")
    if polygons.crosses_itself(body.corners):
        raise InputError("design", field, None, "its outline crosses itself; put its corners in their order around it")
    if polygons.area_moments(body.corners)[0] < 1e-12:
        raise InputError("design", field, None, "its corners enclose no area; move them apart")


def _mm(length: float) -> str:
    return f"{1e3 * length:.6g} mm"


def _um(length: float) -> str:
    return f"{1e6 * length:.6g} um"


def _at(point: Array) -> str:
    x, y = (round(1e3 * float(value), 6) + 0.0 for value in point)  # to a nanometre; not -0
    return f"({x:.6g} mm, {y:.6g} mm)"
