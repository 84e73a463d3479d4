"""Causes of coupling against hand calculation, on a rigid table that springs hold beside its point."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign.design.assembly import Assembly, Axis, Body, Box
from flexdesign.fem import cross_axis_coupling
from flexdesign.fem.cross_axis_coupling import ABBE_ARM, ACTUATOR_OFFSET, LOAD_OFFSET, MISMATCH, SENSOR_TILT, Cause
from flexdesign.fem.solving.port_shapes import rigid_motions
from flexdesign.fem.superelements.assembled_stage import AssembledStage

FloatArray = NDArray[np.float64]

#: Springs that hold the table at its centre [N/m] and against rotation [N m/rad].
K, C = np.array([3e4, 3e4, 5e4]), np.array([40.0, 50.0, 60.0])
#: The table's point lies this far above its centre, and actuators push at this height [m].
HEIGHT, PUSH = 6e-3, 4e-3
#: Two actuators for x, either side of the centre, and one for y and z each; where they push, and which way.
ACTUATORS = {
    "right": ((0.02, 0.01, PUSH), (1.0, 0.0, 0.0)),
    "left": ((-0.02, -0.01, PUSH), (-1.0, 0.0, 0.0)),
    "across": ((0.0, 0.02, PUSH), (0.0, 1.0, 0.0)),
    "below": ((0.0, 0.0, -0.02), (0.0, 0.0, 1.0)),
}


class Table:
    """A stage of one rigid body: what the causes ask of an assembled stage, its unknowns the body's six motions."""

    def __init__(self) -> None:
        axes = {
            "x": Axis((1.0, 0.0, 0.0), {"right": 1.0, "left": -1.0}),
            "y": Axis((0.0, 1.0, 0.0), {"across": 1.0}),
            "z": Axis((0.0, 0.0, 1.0), {"below": 1.0}),
        }
        body = Body("table", (Box((0.0, 0.0, 0.0), (0.04, 0.04, 0.012)),))
        self.assembly = Assembly((body,), (), "table", (0.0, 0.0, HEIGHT))
        object.__setattr__(self.assembly, "axes", axes)  # their actuators push here without an element between
        self.size, self.stiffness = 6, np.diag([*K, *C])

    def motion(self, _: str, point: FloatArray) -> FloatArray:
        rows = np.zeros((6, 6))
        rows[:3], rows[3:, 3:] = rigid_motions(np.asarray(point), np.zeros(3)), np.eye(3)
        return rows

    @property
    def table(self) -> FloatArray:
        return self.motion("table", np.array(self.assembly.point))

    def extension(self, element: str, offset: FloatArray | None = None) -> FloatArray:
        place, way = (np.array(each) for each in ACTUATORS[element])
        return np.asarray(way @ self.motion("table", place + (0.0 if offset is None else offset))[:3])

    def drive(self, axis: str) -> FloatArray:
        drives = self.assembly.axes[axis].drives
        return np.asarray(sum(sign * self.extension(name) for name, sign in drives.items()))


@pytest.fixture(scope="module")
def found() -> dict[str, Cause]:
    return {cause.name: cause for cause in cross_axis_coupling.causes(cast(AssembledStage, Table()))}


def per_travel(tilt_per_force: float) -> float:
    """Return the table's tilt about y per travel along x, if two unit forces tilt it by so much [rad/m]."""
    return tilt_per_force / (2 / K[0] + HEIGHT * tilt_per_force)


#: Two unit forces along x at the height PUSH turn the table about y.
TILT = 2 * PUSH / C[1]


def test_without_a_cause_the_point_goes_straight(found: dict[str, Cause]) -> None:
    """The two actuators of x lie point-symmetric to the centre, so that no moment about z is left."""
    assert found["none"].largest < 1e-12


def test_abbe_arm_along_the_axis_lifts_the_table_that_tilts(found: dict[str, Cause]) -> None:
    """A table that turns about y by theta is lower by theta a at a place a farther along x: the arm ALONG the axis."""
    arm = ABBE_ARM / np.sqrt(3.0)
    assert found["Abbe arm"].coupling["x"]["z"] == pytest.approx(-arm * per_travel(TILT), rel=1e-9)
    assert found["Abbe arm"].coupling["x"]["y"] == pytest.approx(0.0, abs=1e-12)  # it does not turn about x or z


def test_unequal_actuators_turn_the_table_about_z_and_leave_its_point(found: dict[str, Cause]) -> None:
    """The stronger one adds a moment about z, and the point lies on that axis; only the tilt about y is seen, in x."""
    assert found["unequal actuators"].coupling["x"]["y"] == pytest.approx(0.0, abs=1e-12)


def test_eccentric_load_turns_the_table_and_moves_its_point_aside(found: dict[str, Cause]) -> None:
    """A push along z at (b, b) beside the axis turns the table by b/C about x and -b/C about y; the point is higher."""
    b = LOAD_OFFSET / np.sqrt(2.0)
    travel = 1 / K[2]
    assert found["eccentric load"].coupling["z"]["x"] == pytest.approx(-b / C[1] * HEIGHT / travel, rel=1e-9)
    assert found["eccentric load"].coupling["z"]["y"] == pytest.approx(-b / C[0] * HEIGHT / travel, rel=1e-9)


def test_actuator_off_its_axis_adds_a_moment(found: dict[str, Cause]) -> None:
    """That of z, moved by b along y and z, turns the table about x by b/C_x and moves its point along y by -h b/C_x."""
    b = ACTUATOR_OFFSET / np.sqrt(2.0)
    # The whole drive acts, and what the offset adds.
    assert found["actuator off its axis"].coupling["z"]["y"] == pytest.approx(-b / C[0] * HEIGHT * K[2], rel=1e-9)


def test_tilted_sensor_sees_its_tilt(found: dict[str, Cause]) -> None:
    assert all(value == SENSOR_TILT for others in found["tilted sensor"].coupling.values() for value in others.values())


def test_what_is_assumed_is_said(found: dict[str, Cause]) -> None:
    assert f"{100 * MISMATCH:g} %" in found["unequal actuators"].assumed
    assert "as far in x as in y and z" in found["Abbe arm"].assumed


def test_arms_draw_by_half_the_square_over_their_length() -> None:
    drawn = cross_axis_coupling.coupling_by_arms(1e-4, {("y", "x"): 0.05, ("z", "x"): 0.1, ("x", "z"): 0.05}, "x")
    assert drawn == pytest.approx({"y": 1e-7, "z": 5e-8}, rel=1e-12)
