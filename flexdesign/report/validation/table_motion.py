"""The section on how the table moves: six degrees of freedom at the table and the sensor, and parasitic motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flexdesign.core.model import Quantity
from flexdesign.design.part import in_file
from flexdesign.fem import quantities
from flexdesign.report.document import Section, Table
from flexdesign.report.wording import name_of
from flexdesign.workflows.validation import Validation

#: How the six components are written.
SIGNS = {f"{kind}_{axis}": f"{sign}_{axis}" for kind, sign in (("u", "u"), ("theta", "θ")) for axis in "xyz"}


def section(validation: Validation) -> Section:
    """Return the section."""
    if not validation.has_input:
        return Section("Motion of the table")
    text = [_points(validation), _symmetry(validation)]
    tables = [*_six_degrees(validation), _parasitic(validation), *rotation_centres(validation)]
    return Section("Motion of the table", text, tables)


def rotation_centres(validation: Validation) -> list[Table]:
    """Return the table of the centres of rotation that the meshes determine; none without one.

    Where hardly anything turns, the centre is far away, and its error exceeds its distance and the part.
    """
    ports = {port.role: np.array(port.point) for port in validation.study.design.part().ports()}
    size = max(float(np.linalg.norm(point - ports["output"])) for point in ports.values())
    output = in_file(validation.study.design.part(), ports["output"].tolist())
    found = [q for q in validation.further if q.name.startswith("centre_")]
    rows = []
    for boundary in dict.fromkeys(q.boundary for q in found):
        centre = [q for q in found if q.boundary == boundary]
        distance = float(np.linalg.norm(np.subtract([q.value for q in centre], output)))
        if all(q.half_width is not None and q.half_width < max(distance, size) for q in centre):
            rows.append([boundary, *("0" if q.value == 0 else q.formatted() for q in centre)])
    caption = "Centre of rotation of the output: the point of its axis of rotation that is nearest to the port"
    return [Table(["", "x", "y", "z"], rows, caption)] if rows else []


def _six_degrees(validation: Validation) -> list[Table]:
    """Return a table for each point: components by where the actuator pushes."""
    tables = []
    for point in quantities.POINTS:
        found = [q for q in validation.further if q.name.startswith(f"{point}_")]
        if found:
            drive = found[0].boundary.partition(",")[0]
            names = {f"{point}_{component}": sign for component, sign in SIGNS.items()}
            tables.append(_by_place(found, names, f"{_point_text(validation, point)}, {drive}"))
    return tables


def _parasitic(validation: Validation) -> Table:
    found = [q for q in validation.further if q.name.startswith("coupling") or q.name == "tilt"]
    return _by_place(found, {q.name: name_of(q) for q in found}, "Parasitic motion per travel")


def _by_place(found: Sequence[Quantity], names: Mapping[str, str], caption: str) -> Table:
    """Return quantities, named in words, in rows, and where the actuator pushes in columns."""
    places = dict.fromkeys(_place(quantity) for quantity in found)
    cells = {(q.name, _place(q)): "0" if q.value == 0 else q.formatted() for q in found}
    rows = [[words, *(cells[name, place] for place in places)] for name, words in names.items()]
    return Table(["", *places], rows, caption)


def _place(quantity: Quantity) -> str:
    """Return where the actuator pushes, which a boundary names last."""
    return quantity.boundary.rpartition(", ")[2]


def _point_text(validation: Validation, point: str) -> str:
    if point == "table":
        return "The table, at the middle of the output's face"
    sensor = validation.study.output.sensor or (0.0, 0.0, 0.0)
    return "The sensor's point, ({})".format(", ".join(f"{1e3 * x:g}" for x in sensor)) + " mm"


def _points(validation: Validation) -> str:
    looks = "The sensor's point is fixed to the table" if validation.study.output.sensor else ""
    return (
        "The six motions are those of the rigid body that follows the output's face; rotations are about the axes x, "
        f"y, z, right-handed. {looks or 'A study that names output.sensor gets those of that point, too'}. "
        "Displacements are small. The numbers for an actuator off its axis come from the meshes that were solved for "
        "every symmetry class: of three or more, the coarser ones. A 0 without digits is zero by symmetry."
    )


def _symmetry(validation: Validation) -> str:
    if validation.domain.thin is not None and not validation.domain.planes:
        return "The part has no symmetry planes: what is zero by symmetry shows as the mesh's own asymmetry."
    lost = [plane.axis for plane in validation.study.design.part().symmetry() if plane not in validation.domain.planes]
    if not lost:
        return (
            "Linear coupling of a symmetric part is zero while the actuator pushes on its axis, and stays zero where "
            "it is off the axis within a symmetry plane. The second-order coupling, which grows with the square of "
            "travel, is not in a linear solve."
        )
    remaining = ", ".join(f"{plane.axis} = 0" for plane in validation.domain.planes)
    left = f"; {remaining} remains" if remaining else ", so that the part as a whole has none"
    kind, planes = "plane" if len(lost) == 1 else "planes", " and ".join(f"{axis} = 0" for axis in lost)
    return (
        f"The crystal's axes lie askew to the part's symmetry {kind} {planes}{left}. The part moves sideways or tilts "
        "even where the actuator pushes on its axis. What was solved is meshed as its own mirror image only roughly; "
        "that adds a coupling of its own."
    )
