"""The output port as a spring in six directions, ground held and inputs free.

With C the compliance between the six motions of the output port, K = C^-1 is what a neighbour feels that holds the
face. Its diagonal is force over motion with the other five motions held; 1 / C_ii is that with the others free. They
differ where motions are coupled, as shear and bending are unless taken about the centre of the joint.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Quantity
from flexdesign.design.part import Port
from flexdesign.fem.solving.port_compliance import MOTIONS
from flexdesign.fem.solving.statics import PortCompliance

FloatArray = NDArray[np.float64]

#: How a stiffness along a motion is called, by whether it turns and is along the port's normal.
KINDS = {(False, True): "axial", (False, False): "shear", (True, True): "torsion", (True, False): "bending"}
HELD, FREE = "other motions held", "other motions free"


def matrices(c: PortCompliance) -> tuple[FloatArray, FloatArray]:
    """Return stiffness and compliance of the output port, shapes (6, 6), SI."""
    compliance = c.matrix[c.output_rows, c.output_rows]
    scale = 1 / np.sqrt(np.diag(compliance))  # metres and radians side by side
    stiffness = np.linalg.inv(compliance * np.outer(scale, scale)) * np.outer(scale, scale)
    return (stiffness + stiffness.T) / 2, compliance


def port_stiffness(c: PortCompliance) -> list[Quantity]:
    """Return the six stiffnesses of the output port, with the other motions held and free."""
    stiffness, compliance = matrices(c)
    found = []
    for boundary, values in ((HELD, np.diag(stiffness)), (FREE, 1 / np.diag(compliance))):
        for motion, value in zip(MOTIONS, values.tolist(), strict=True):
            si, unit = ("N m/rad", "N m/rad") if motion.startswith("r") else ("N/m", "N/um")
            found.append(Quantity(f"k_{motion}", value, si, unit, boundary))
    return found


def kind(motion: str, ports: Sequence[Port]) -> str:
    """Return what a motion of the output does to a joint along its normal: axial, shear, torsion or bending.

    Empty where the normal is along no axis, and of a bore or a shaft, whose axis does not tell how the joint lies.
    """
    output = next(port for port in ports if port.role == "output")
    normal = np.abs(output.normal)
    if output.is_round or normal.max() < 1 - 1e-6:
        return ""
    return KINDS[motion.startswith("r"), bool(normal["xyz".index(motion[-1])] > 0.5)]
