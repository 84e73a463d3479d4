"""How the table moves besides its own way: parasitic motion, all six degrees of freedom, and what it turns about.

The table is what the output port carries. The sensor looks at a point that is fixed to it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Quantity
from flexdesign.design.part import in_file
from flexdesign.design.study import Study
from flexdesign.fem.solving import rigid_motion
from flexdesign.fem.solving.rigid_motion import RigidMotion
from flexdesign.fem.solving.statics import PortCompliance

FloatArray = NDArray[np.float64]

#: The points whose motion is reported, and its six components: the name's ending, SI unit and the unit people read.
POINTS = ("table", "sensor")
COMPONENTS = (
    *((f"u_{axis}", "m", "um") for axis in "xyz"),
    *((f"theta_{axis}", "rad", "urad") for axis in "xyz"),
)


def coupling(c: PortCompliance, offset: float) -> list[Quantity]:
    """Parasitic motion of the output per output travel: on axis, and with the actuator off axis by `offset` [m]."""
    pieces = []
    travel = c.c12
    normal = c.output.reshape(-1, 6)[np.any(c.output.reshape(-1, 6), axis=1)][0, :3]
    for label, place in actuator_places(offset):
        motion = rigid_motion.of_output(c, rigid_motion.off_axis_loads(c.extension, place))
        boundary = f"actuator {label}"
        for i in np.flatnonzero(normal == 0):
            pieces.append(Quantity(f"coupling_{'xyz'[i]}", motion.translation[i] / travel, "1", "%", boundary))
        tilt = float(np.linalg.norm(motion.rotation)) / abs(travel)
        pieces.append(Quantity("tilt", tilt, "rad/m", "urad/um", boundary))
    return pieces


def six_degrees(study: Study, c: PortCompliance, *, off_axis: bool) -> list[Quantity]:
    """Return the rigid-body motion of the table, and of the sensor's point if the study names one.

    Parameters
    ----------
    study
        What was asked.
    c
        The compliance between the ports.
    off_axis
        Whether it holds the motions of every symmetry class, so that the actuator can be moved off its axis.

    Returns
    -------
    list
        For each point and place of the actuator six quantities, u_x to u_z and theta_x to theta_z.
    """
    output = next(port for port in study.design.part().ports() if port.role == "output")
    levers = {"table": np.zeros(3)}
    if study.output.sensor is not None:
        levers["sensor"] = np.array(study.output.sensor) - np.array(output.point)
    found = []
    for label, place in actuator_places(study.output.actuator_offset if off_axis else 0.0):
        motion, drive = _drive(study, c, place)
        for point, lever in levers.items():
            there = motion.at(lever)
            values = [*there.translation.tolist(), *there.rotation.tolist()]
            for (name, si, unit), value in zip(COMPONENTS, values, strict=True):
                found.append(Quantity(f"{point}_{name}", value, si, unit, f"{drive}, actuator {label}"))
    return found


def rotation_centres(study: Study, c: PortCompliance) -> list[Quantity]:
    """Return the centre of rotation of the output: the point of its axis of rotation that is nearest to its port.

    Returns
    -------
    list
        Three coordinates, as the part's file has them, under the drive with the actuator on its axis; of a joint under
        a moment about each axis. None where the output does not turn.
    """
    if c.has_input:
        motion, drive = _drive(study, c, np.zeros(3))
        motions = {f"{drive}, actuator on axis": motion}
    else:
        moments = np.eye(len(c.output))[c.output_rows][3:]
        motions = {f"moment about {axis}": rigid_motion.of_output(c, m) for axis, m in zip("xyz", moments, strict=True)}
    part = study.design.part()
    output = next(port for port in part.ports() if port.role == "output")
    found = []
    for boundary, motion in motions.items():
        if np.any(motion.rotation):
            for axis, datum, away in zip("xyz", in_file(part, output.point), motion.centre.tolist(), strict=True):
                found.append(Quantity(f"centre_{axis}", datum + away, "m", "mm", boundary, datum=datum))
    return found


def _drive(study: Study, c: PortCompliance, place: FloatArray) -> tuple[RigidMotion, str]:
    """Return the table's motion under full voltage, or per newton without an actuator, and the drive in words.

    An actuator off its axis parts the inputs by e = f . q, with f its unit loads: its force is s / (f C f + 1/k).
    """
    loads, actuator = rigid_motion.off_axis_loads(c.extension, place), study.design.actuator
    unit = rigid_motion.of_output(c, loads)
    if actuator is None:
        return unit, "1 N of actuator force"
    force = actuator.free_stroke / (float(loads @ c.matrix @ loads) + 1 / actuator.installed_stiffness)
    return unit.times(force), "full voltage"


def actuator_places(offset: float) -> Sequence[tuple[str, FloatArray]]:
    """Return where the actuator pushes, in words and as a shift [m]: on its axis, and `offset` off it in y and z."""
    places = [("on axis", np.zeros(3))]
    if offset > 0:
        for axis in (1, 2):
            places.append((f"{offset * 1e3:g} mm off axis in {'xyz'[axis]}", offset * np.eye(3)[axis]))
    return places
