"""The report of a STEP file: its faces as a table and a picture, what is thin, and a design to start from."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexdesign.core.serialise import header, with_unit
from flexdesign.core.toml_files import FORMAT, quote
from flexdesign.design import bores
from flexdesign.design.faces import PORT_KINDS, SolidFace, how_to_name, in_mm, on_axis
from flexdesign.design.step_file import StepBody
from flexdesign.fem.meshing.surface import Surface, surface_of, triangle_areas
from flexdesign.fem.meshing.thin_regions import ThinRegions
from flexdesign.report import pictures
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.pictures import Picture, draw_or_explain

#: Faces that a terminal and the picture show.
MOST = 20
CAPTION = "The solid, with the numbers of its largest planes and cylinders that are seen from here"


def table(faces: Sequence[SolidFace]) -> Table:
    """Return plane and cylindrical faces, the largest first."""
    rows = []
    for face in sorted(faces, key=lambda f: -f.area):
        if face.kind not in PORT_KINDS:
            continue
        shape = face.kind if face.kind == "plane" else f"cylinder, R {1e3 * face.radius:.4g} mm"
        way = face.normal if face.kind == "plane" else face.axis or face.normal
        rows.append(
            [
                str(face.index + 1),
                shape,
                f"{1e6 * face.area:.4g}",
                _vector(way),
                in_mm(_middle(face)),
                face.name,
                face.colour,
            ]
        )
    columns = ["face", "kind", "area [mm²]", "normal or axis", "centre [mm]", "name", "colour"]
    return Table(columns, rows, "Planes and cylinders, the largest first: what a port may be")


def brief(faces: Sequence[SolidFace]) -> Table:
    """Return the largest faces for a terminal that a port may be."""
    known = sorted((face for face in faces if face.kind in PORT_KINDS), key=lambda f: -f.area)
    rows = [
        [str(face.index + 1), f"{1e6 * face.area:.4g}", f"{1e3 * face.radius:.4g}" if face.axis else "plane",
         ", ".join(f"{round(x, 2) + 0.0:g}" for x in face.axis or face.normal),
         ", ".join(f"{round(1e3 * x, 2) + 0.0:g}" for x in _middle(face)), face.name]
        for face in known[:MOST]
    ]  # fmt: skip
    more = f"; {len(known) - MOST} smaller ones are in the report" if len(known) > MOST else ""
    columns = ["face", "mm²", "R [mm]", "normal or axis", "centre [mm]", "name"]
    return Table(columns, rows, f"Planes and cylinders, the largest first{more}")


def document(
    path: Path,
    body: StepBody,
    faces: Sequence[SolidFace],
    thin: ThinRegions,
    start: str,
    progress: Callable[[str], None],
) -> Document:
    """Return the report, with a picture where it can be drawn, and the design to `start` from."""
    others = sum(face.kind not in PORT_KINDS for face in faces)
    summary = [
        f"One solid of {body.solid.Volume():.6g} mm³ with {len(faces)} faces, {others} of them neither plane nor "
        f"cylindrical; the file is in {body.unit.lower() or 'no stated unit'}.",
        *body.notes,
    ]
    return Document(f"{path.name}: faces", summary, partial(_sections, body, faces, thin, start, progress))


def _sections(
    body: StepBody, faces: Sequence[SolidFace], thin: ThinRegions, start: str, progress: Callable[[str], None]
) -> list[Section]:
    progress("drawing")

    def draw() -> tuple[list[Figure], list[Figure]]:
        size = 1e-3 * body.solid.BoundingBox().DiagonalLength
        surface = surface_of(body.solid, 1e-3 * size)
        points = surface.corners.reshape(-1, 3)
        cells = np.arange(len(points)).reshape(-1, 3)
        known = sorted((face for face in faces if face.kind in PORT_KINDS), key=lambda f: -f.area)[:MOST]
        labels = [(_before(surface, face, 5e-3 * size), str(face.index + 1)) for face in known]
        picture = Picture("faces.png", points, cells, view="oblique", labels=labels)
        return [Figure("faces.png", pictures.draw([picture])["faces.png"], CAPTION)], []

    figures, _, missing = draw_or_explain(draw, progress)
    rows = [[h.name, f"{1e3 * h.thickness:.4g} mm", f"{1e3 * h.length:.3g} x {1e3 * h.width:.3g} mm",
             in_mm(h.centre)] for h in thin.hinges]  # fmt: skip
    sections = [
        Section("Faces", missing, [table(faces)], figures),
        Section("What is thin", (), [Table(["region", "thickness", "extent", "centre [mm]"], rows)]) if rows else None,
        Section("A design to start from", code=start.rstrip()),
    ]
    return [section for section in sections if section is not None]


def result(body: StepBody, faces: Sequence[SolidFace], thin: ThinRegions) -> dict[str, Any]:
    """Return result.json's content."""
    return {
        **header("faces"),
        "volume": with_unit(body.solid.Volume() * 1e-9, "m^3"),
        "unit": body.unit,
        "notes": list(body.notes),
        "faces": [
            {
                "face": face.index + 1,
                "kind": face.kind,
                "area": with_unit(face.area, "m^2"),
                "centroid": list(face.centroid),
                "normal": list(face.normal),
                "radius": face.radius or None,
                "name": face.name,
                "colour": face.colour,
            }
            for face in faces
        ],
        "thin_regions": [
            {"name": h.name, "thickness": h.thickness, "centre": list(map(float, h.centre)), "unit": "m"}
            for h in thin.hinges
        ],
    }


def design(part: str, faces: Sequence[SolidFace], solids: Sequence[str] = (), bodies: Sequence[int | None] = ()) -> str:
    """Return a design to start from, with ground and output.

    They are two bores if there is a natural pair of them (`bores.pair`), or else outer plane faces of the two `bodies`,
    as `hinge_cuts.bodies_of` numbers them, that lie farthest apart along an axis, or else the two outermost plane
    faces along the longest way. What else may be a port stands below as comments, and so does what is missing.
    """
    planes = _across_hinges(faces, bodies) or _outermost_planes(faces)
    low, high = (np.array(corner) * 1e-3 for corner in _box(faces))
    known = bores.of_faces(faces, float(np.linalg.norm(high - low)))
    found = bores.pair(known, float((high - low).max()))
    meant = [f"solids = [{', '.join(map(quote, solids))}]"] if solids else []
    lines = [f"format = {FORMAT}", f"part = {quote(part)}", *meant, 'material = "Al 7075-T6"']
    if found is not None:
        ports = sorted((bore.face for bore in found), key=lambda face: tuple(on_axis(face).round(9)))
        lines += ["", "# Two bores, each about a rigid pin or bolt that holds it all round."]
        others = [*planes, *(bore.face for bore in known if bore not in found)]
    else:
        ports, others = list(planes), [bore.face for bore in known]
    for name, face in zip(("ground", "output"), ports, strict=False):
        lines += ["", *_port(name, face, faces)]
    if len(ports) < 2:
        lines += [
            "",
            "# Ground and output are plane or cylindrical faces, and this solid has no two planes: split a face",
        ]
        lines += ["# in the CAD program, or cut a plane."]
    if others:
        lines += ["", "# Other faces that may be ports:"]
    for face in others[:MOST]:
        lines += ["#", *(f"# {line}" for line in _port("NAME", face, faces))]
    return "\n".join(lines) + "\n"


def _across_hinges(faces: Sequence[SolidFace], bodies: Sequence[int | None]) -> list[SolidFace]:
    """Return the outer plane faces of the two bodies that lie farthest apart along an axis, if there are two."""
    on = {body: [face for face, its in zip(faces, bodies, strict=True) if its == body] for body in {*bodies} - {None}}
    centres = {
        body: np.average([face.centroid for face in its], axis=0, weights=[face.area for face in its])
        for body, its in on.items()
    }
    ways = [
        (centres[further][axis] - centres[body][axis], body, further, axis)
        for body, further in itertools.permutations(on, 2)
        for axis in range(3)
    ]
    for _, body, further, axis in sorted(ways, reverse=True):
        low = [face for face in on[body] if face.kind == "plane" and face.normal[axis] < -0.99]
        high = [face for face in on[further] if face.kind == "plane" and face.normal[axis] > 0.99]
        if low and high:
            return [min(low, key=lambda f: f.centroid[axis]), max(high, key=lambda f: f.centroid[axis])]
    return []


def _outermost_planes(faces: Sequence[SolidFace]) -> list[SolidFace]:
    """Return the two outermost plane faces along the longest way; fewer if there are no two."""
    planes = [face for face in faces if face.kind == "plane"]
    if len(planes) < 2:
        return planes
    centres = np.array([face.centroid for face in planes])
    axis = int(np.argmax(np.ptp(centres, axis=0)))
    along = [f for f in planes if abs(f.normal[axis]) > 0.99] or planes
    ground = min(along, key=lambda f: f.centroid[axis])
    others = [[f for f in some if f is not ground] for some in (along, planes)]
    return [ground, max(others[0] or others[1], key=lambda f: f.centroid[axis])]


def _port(name: str, face: SolidFace, faces: Sequence[SolidFace]) -> list[str]:
    """Return the table of a port; what sits in a bore or on a shaft is rigid."""
    interface = "rigid" if face.axis else "traction"
    return [f"[ports.{name}]", *how_to_name(face, faces), f'interface = "{interface}"']


def _box(faces: Sequence[SolidFace]) -> tuple[Sequence[float], Sequence[float]]:
    """Return the low and the high corner of the box about all faces [mm]."""
    boxes = [face.shape.BoundingBox() for face in faces]
    low = [min(getattr(box, key) for box in boxes) for key in ("xmin", "ymin", "zmin")]
    return low, [max(getattr(box, key) for box in boxes) for key in ("xmax", "ymax", "zmax")]


def _before(surface: Surface, face: SolidFace, distance: float) -> tuple[float, float, float]:
    """Return a point before the largest triangle of a face [m], so that the face does not hide a text there."""
    corners = surface.corners[surface.owners == face.index]
    one, two, three = corners[np.argmax(triangle_areas(corners))]
    outward = np.cross(two - one, three - one)
    x, y, z = (one + two + three) / 3 + distance * outward / np.linalg.norm(outward)
    return float(x), float(y), float(z)


def _middle(face: SolidFace) -> Sequence[float]:
    """Return where a face is: its centre, or that of a cylinder on its axis, which a port's table asks for [m]."""
    return on_axis(face).tolist() if face.axis else face.centroid


def _vector(vector: Sequence[float]) -> str:
    return ", ".join(f"{round(x, 4) + 0.0:g}" for x in vector)
