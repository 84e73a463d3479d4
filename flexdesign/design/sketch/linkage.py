"""A drawing as members between nodes: flexures, slender bodies, blocks, and what flexures run into.

A body is a node, rigid, with two exceptions. One that joins two flexures, has no port and is slender is an arm: a beam
between their ends, as thick as its area over its length. One that an actuator pushes between two flexures bends
between them: a block, on either side of the middle.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Linkage, Member, Root
from flexdesign.core.model.linkage import Vector
from flexdesign.design.sketch import polygons
from flexdesign.design.sketch.drawing import Body, Drawing, Flexure
from flexdesign.design.sketch.section import Section

#: Steps along a chord at which a body must enclose it to be a beam along it.
STEPS = 9


def linkage(section: Section) -> Linkage:
    """Return the linkage of a drawing's section."""
    drawing = section.drawing
    nodes: dict[str, Vector] = {}
    places: dict[tuple[str, str], str] = {}  # the node of a body at which a flexure ends
    stout: list[Member] = []
    for body in drawing.bodies.values():
        if (arm := _arm(body, drawing)) is not None:
            pieces = [arm]
        else:
            pieces = _halves(body, drawing)
            nodes[body.name] = _space(_place(body, drawing))
        for piece in pieces:
            nodes |= {node: at for node, at in zip(piece.nodes, (piece.start, piece.end), strict=True)
                      if node not in nodes}  # fmt: skip
        stout += pieces
        for flexure, _, _ in drawing.attached.get(body.name, []):
            own = f"{body.name}:{flexure.name}"
            places[body.name, flexure.name] = own if own in nodes else body.name
    thin = [_flexure_member(flexure, section, places) for flexure in drawing.flexures.values()]
    ports = {port.name: drawing.carriers[port.name] for port in drawing.ports}
    return Linkage(nodes, (*thin, *stout), ports)


def _place(body: Body, drawing: Drawing) -> Array:
    """Return where the node of a body lies: at its first port, or in its centroid."""
    ports = [port for port in drawing.ports if drawing.carriers[port.name] == body.name]
    return np.array(ports[0].point[:2]) if ports else polygons.area_moments(body.corners)[1]


def _arm(body: Body, drawing: Drawing) -> Member | None:
    """Return a slender body between two flexures as a beam; None if it is none."""
    ends = drawing.attached.get(body.name, [])
    if len(ends) != 2 or body.name in drawing.carriers.values():
        return None
    (one, start, _), (two, end, _) = ends
    length = math.dist(start, end)
    thickness = polygons.area_moments(body.corners)[0] / length if length > 0 else math.inf
    between = start + np.linspace(0, 1, STEPS + 2)[1:-1, None] * (end - start)
    if thickness >= length or not polygons.contains(body.corners, between).all():
        return None
    names = (f"{body.name}:{one.name}", f"{body.name}:{two.name}")
    return Member(body.name, "arm", names, _space(start), _space(end), thickness, drawing.thickness)


def _halves(body: Body, drawing: Drawing) -> list[Member]:
    """Return the halves of a block that an actuator pushes between two flexures; none if it is no such block."""
    ports = [port for port in drawing.ports if drawing.carriers[port.name] == body.name]
    ends = drawing.attached.get(body.name, [])
    if len(ports) != 1 or ports[0].role != "input" or len(ends) != 2:
        return []
    area, centre, _ = polygons.area_moments(body.corners)
    middle, normal = np.array(ports[0].point[:2]), np.array(ports[0].normal[:2])
    along = np.array([-normal[1], normal[0]])
    reach = [float((point - middle) @ along) for _, point, _ in ends]
    if not reach[0] * reach[1] < 0:
        return []
    foot = centre + ((middle - centre) @ along) * along  # on the line through the centroid, across from the port
    thickness = area / float(np.ptp(body.corners @ along))
    return [
        Member(
            f"{body.name}:{number}", "block", (f"{body.name}:{flexure.name}", body.name),
            _space(foot + far * along), _space(foot), thickness, drawing.thickness,
        )
        for number, ((flexure, _, _), far) in enumerate(zip(ends, reach, strict=True), 1)
    ]  # fmt: skip


def _flexure_member(flexure: Flexure, section: Section, places: dict[tuple[str, str], str]) -> Member:
    """Return a flexure as a member with its roots."""
    drawing = section.drawing
    first, second = (places[body, flexure.name] for body in flexure.bodies)
    roots = (_root(flexure, 0, section), _root(flexure, 1, section))
    round_ = flexure.profile == "circular"
    member = Member(
        flexure.name, flexure.kind, (first, second), _space(flexure.start), _space(flexure.end),
        flexure.thickness, drawing.thickness, flexure.root_fillet,
        flexure.length / 2 if round_ else math.inf, roots, notch=None if round_ else flexure.notch,
    )  # fmt: skip
    if flexure.kind == "rod":
        others = [each for each, _, _ in drawing.attached[flexure.bodies[0]] if each is not flexure]
        if len(others) == 1:
            hinge = (others[0].start + others[0].end) / 2
            return replace(member, lever=float((hinge - flexure.start) @ flexure.normal))
    return member


def _root(flexure: Flexure, number: int, section: Section) -> Root | None:
    """Return what a flexure runs into at its start (0) or its end (1); None where it ends within its body.

    A ray into the body gives its depth; rays to both sides along the body's side give the extent of the section there.
    """
    name, point, way = flexure.ends[number]
    corners = section.drawing.bodies[name].corners
    if polygons.contains(corners, point):
        return None
    begin = point + polygons.TOLERANCE * way
    depth = polygons.distance(polygons.sides(corners), begin, way) + polygons.TOLERANCE
    foot_right, foot_left = section.drawing.feet(flexure, number)
    along = (foot_left - foot_right) / np.linalg.norm(foot_left - foot_right)
    left, right = (polygons.distance(section.segments, begin, sign * along) for sign in (1, -1))
    overhang, side = min(left, right), 1 if left < right else -1
    behind = [
        other for other, at, inward in section.drawing.attached[name]
        if inward @ way < -1 + 1e-9 and math.dist(at, point + depth * way) < 1e3 * polygons.TOLERANCE
        and other.kind == flexure.kind
    ]  # fmt: skip
    slender = _arm(section.drawing.bodies[name], section.drawing) is not None
    if flexure.kind == "rod" or slender:
        return Root("end", left + right)
    if behind:
        return Root("block", depth / 2, overhang, side)  # type: ignore[arg-type]
    if depth > left + right or overhang < flexure.end_thickness / 2:
        return Root("end", left + right)
    twins = [
        abs(float((at - point) @ flexure.normal))
        for other in section.drawing.flexures.values() if other is not flexure
        for _, at, inward in other.ends
        if inward @ way > 1 - 1e-9 and abs(float((at - point) @ way)) < 1e3 * polygons.TOLERANCE
    ]  # fmt: skip
    height = min(twins) / 2 if twins and min(twins) < max(left, right) else max(left, right)
    return Root("flank", depth, overhang, side, height)  # type: ignore[arg-type]


def _space(point: Array) -> Vector:
    return (float(point[0]), float(point[1]), 0.0)
