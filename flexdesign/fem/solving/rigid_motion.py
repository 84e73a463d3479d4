"""How a port moves as a rigid body, and with it every point that is fixed to it.

The six motions of a port (`ports`) are those of the rigid body that does the same work as its face under any force and
moment. A point at r from the port's own moves, rotations being small, by

    u(r) = u + theta x r,    theta(r) = theta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.solving.statics import PortCompliance

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RigidMotion:
    """A small motion of a rigid body, at one of its points.

    Parameters
    ----------
    translation
        u of the point along x, y, z, shape (3,) [m].
    rotation
        theta of the body about x, y, z, right-handed, shape (3,) [rad].
    """

    translation: FloatArray
    rotation: FloatArray

    def at(self, lever: FloatArray) -> RigidMotion:
        """Return the motion of the point that lies at `lever`, shape (3,) [m], from this one.

        Examples
        --------
        A microradian about z lifts a point 1 m away along x by a micrometre:

        >>> RigidMotion(np.zeros(3), np.array([0.0, 0.0, 1e-6])).at(np.array([1.0, 0.0, 0.0])).translation.tolist()
        [0.0, 1e-06, 0.0]
        """
        return RigidMotion(self.translation + np.cross(self.rotation, lever), self.rotation)

    @property
    def centre(self) -> FloatArray:
        """Where from this point the axis of rotation lies nearest, theta x u / |theta|^2, shape (3,) [m].

        Examples
        --------
        What moves by a micrometre along y while it turns by a microradian about z turns about a point 1 m away along x:

        >>> RigidMotion(np.array([0.0, 1e-6, 0.0]), np.array([0.0, 0.0, 1e-6])).centre.tolist()
        [-1.0, 0.0, 0.0]
        """
        return np.cross(self.rotation, self.translation) / float(self.rotation @ self.rotation)

    def times(self, factor: float) -> RigidMotion:
        """Return a multiple of the motion."""
        return RigidMotion(factor * self.translation, factor * self.rotation)


def off_axis_loads(extension: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the loads of a unit actuator force whose line of action lies off the ports' points.

    Parameters
    ----------
    extension
        Those of one on the axis, over the rows of the compliance: three forces, three moments for each port.
    offset
        By how much the line is moved aside, shape (3,) [m].
    """
    loads = extension.reshape(-1, 6).copy()
    loads[:, 3:] += np.cross(offset, loads[:, :3])
    return loads.ravel()


def of_output(compliance: PortCompliance, loads: FloatArray) -> RigidMotion:
    """Return the motion of the output, at its port's point, under loads over the rows of the compliance."""
    motion = (compliance.matrix @ loads)[compliance.output_rows]
    return RigidMotion(motion[:3], motion[3:])
