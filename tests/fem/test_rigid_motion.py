"""Six degrees of freedom of a port: imposed rigid motions, a cantilever's tip, and an actuator off its axis."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from flexdesign.core.model import Quantity, by_key
from flexdesign.design.part import Port
from flexdesign.design.study import Study
from flexdesign.fem import quantities
from flexdesign.fem.solving import port_compliance, rigid_motion
from flexdesign.fem.solving.rigid_motion import RigidMotion
from flexdesign.fem.solving.statics import PortCompliance
from flexdesign.report.validation import table_motion
from flexdesign.workflows.validation import Validation
from studies.verification.solids import CORK, Solid, beam
from tests.fem.solids import RING_PATCHES, ring, solve

LENGTH, HEIGHT, WIDTH = 60e-3, 4e-3, 5e-3
STIFFNESS = CORK.youngs_modulus * WIDTH * HEIGHT**3 / 12  # E I of bending in y
# What direct solvers leave.
SOLVED = 1e-8


def test_an_imposed_rigid_motion_is_found_at_the_port_and_at_the_sensor() -> None:
    """u(x) = a + w x (x - p) has, at every point, the motion that the field itself has there."""
    solid = beam(LENGTH, HEIGHT, WIDTH, (6, 2, 2), wobble=2e-4)
    body, point = solid.body, np.array(solid.ports[0].point)
    translation, rotation = np.array([3e-6, -2e-6, 5e-6]), np.array([1e-4, -3e-4, 2e-4])
    field = translation + np.cross(rotation, body.positions - point)
    motion = port_compliance.port_space(body, solid.domain, solid.ports).loads["output"].T @ field.ravel()
    found = RigidMotion(motion[:3], motion[3:])
    np.testing.assert_allclose(found.translation, translation, rtol=1e-9)
    np.testing.assert_allclose(found.rotation, rotation, rtol=1e-9)
    sensor = np.array([80e-3, 12e-3, -7e-3])
    there = found.at(sensor - point)
    np.testing.assert_allclose(there.translation, translation + np.cross(rotation, sensor - point), rtol=1e-9)
    np.testing.assert_array_equal(there.rotation, found.rotation)


def test_the_tip_of_a_cantilever_turns_by_f_l_squared_over_2_e_i() -> None:
    """Without lateral contraction the turn is exact: by reciprocity it is the deflection under a pure moment.

    A sensor on a rigid arm beyond the tip moves by the arm times the turn more; what shear adds is the tip's alone.
    """
    solved = solve(beam(LENGTH, HEIGHT, WIDTH, (12, 2, 2)))
    compliance = PortCompliance(solved.matrix, solved.space.extension, solved.space.output)
    tip = rigid_motion.of_output(compliance, np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])).times(2.0)  # 2 N along y
    turn = 2.0 * LENGTH**2 / (2 * STIFFNESS)
    assert tip.rotation[2] == pytest.approx(turn, rel=SOLVED)
    assert np.abs(tip.rotation[:2]).max() < 1e-4 * turn  # the lattice of tetrahedra is not quite its own mirror image
    shear = 2.0 * LENGTH / (5 / 6 * CORK.shear_modulus * HEIGHT * WIDTH)
    bending = 2.0 * LENGTH**3 / (3 * STIFFNESS)
    assert bending < tip.translation[1] < bending + 1.1 * shear
    arm = 15e-3
    assert tip.at(np.array([arm, 0.0, 0.0])).translation[1] == pytest.approx(tip.translation[1] + arm * turn, rel=1e-9)


def test_a_cantilever_turns_about_its_middle_under_a_moment() -> None:
    """At the tip u = M L^2 / 2 E I and theta = M L / E I, about both axes across: the centre lies L / 2 away."""
    solid = beam(LENGTH, HEIGHT, WIDTH, (12, 2, 2))
    solved = solve(solid)
    compliance = PortCompliance(solved.matrix, solved.space.extension, solved.space.output)
    part = SimpleNamespace(ports=lambda: solid.ports)
    study = cast(Study, SimpleNamespace(design=SimpleNamespace(part=lambda: part)))
    tip = next(port.point for port in solid.ports if port.role == "output")
    found = by_key(quantities.rotation_centres(study, compliance))
    for moment in "yz":
        centre = [found[f"centre_{axis}_moment_about_{moment}"].value for axis in "xyz"]
        assert np.subtract(centre, tip) == pytest.approx([-LENGTH / 2, 0.0, 0.0], rel=SOLVED, abs=1e-4 * LENGTH)
        assert [found[f"centre_{axis}_moment_about_{moment}"].datum for axis in "xyz"] == pytest.approx(tip)


def test_a_centre_that_the_meshes_do_not_determine_is_not_reported() -> None:
    """Its error exceeds both its distance from the port and the size of the part."""
    ports = (
        Port("out", "output", (0.0, 0.02, 0.0), (0.0, 1.0, 0.0)),
        Port("base", "ground", (0.0, 0.0, 0.0), (0, -1, 0)),
    )
    part = SimpleNamespace(ports=lambda: ports)
    design = SimpleNamespace(part=lambda: part)
    far, near = [50.0, 60.0, 0.0], [0.0, 0.01, 0.0]
    further = [
        Quantity(f"centre_{axis}", x, "m", "mm", f"moment about {moment}", half_width=error)
        for moment, centre, error in (("x", far, 80.0), ("y", near, 1e-4), ("z", ports[0].point, 1e-4))
        for axis, x in zip("xyz", centre, strict=True)
    ]
    validation = cast(Validation, SimpleNamespace(study=SimpleNamespace(design=design), further=further))
    (table,) = table_motion.rotation_centres(validation)
    assert [row[0] for row in table.rows] == ["moment about y", "moment about z"]


def test_an_actuator_off_its_axis_pushes_as_ports_do_that_are_defined_there() -> None:
    """The same forces through ports whose points lie where the line of action went: the table moves alike."""
    offset = np.array([0.0, 0.7e-3, 0.0])
    on_axis = ring()
    moved = tuple(
        replace(port, point=tuple(np.add(port.point, offset))) if port.role == "input" else port
        for port in on_axis.ports
    )
    found = []
    for given, place in ((on_axis.ports, offset), (moved, np.zeros(3))):
        solved = solve(Solid(on_axis.mesh, on_axis.domain, given, on_axis.material))
        compliance = PortCompliance(solved.matrix, solved.space.extension, solved.space.output)
        loads = rigid_motion.off_axis_loads(compliance.extension, place)
        found.append((rigid_motion.of_output(compliance, loads), loads @ compliance.matrix @ loads))
    (first, gave), (second, expected) = found
    np.testing.assert_allclose(first.translation, second.translation, rtol=SOLVED, atol=1e-20)
    np.testing.assert_allclose(first.rotation, second.rotation, rtol=SOLVED, atol=1e-18)
    assert gave == pytest.approx(expected, rel=SOLVED)


def test_an_actuator_off_the_symmetry_plane_tilts_the_table_and_the_plane_tells_how() -> None:
    """Off axis in z, the table leaves its plane: it moves along z and turns about x and no other way besides y."""
    quarter = ring()
    solved, whole = solve(quarter), solve(quarter.whole(RING_PATCHES))
    motions = []
    for each in (solved, whole):
        compliance = PortCompliance(each.matrix, each.space.extension, each.space.output)
        loads = rigid_motion.off_axis_loads(compliance.extension, np.array([0.0, 0.0, 1e-4]))
        motions.append(rigid_motion.of_output(compliance, loads))
    by_class, at_once = motions
    assert by_class.translation[0] == 0 and by_class.rotation[1] == 0 and by_class.rotation[2] == 0
    assert by_class.translation[2] != 0 and by_class.rotation[0] != 0
    np.testing.assert_allclose(by_class.translation, at_once.translation, rtol=SOLVED, atol=1e-16)
    np.testing.assert_allclose(by_class.rotation, at_once.rotation, rtol=SOLVED, atol=1e-14)
