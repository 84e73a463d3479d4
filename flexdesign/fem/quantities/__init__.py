"""From port compliance, section forces and modes to the quantities a designer asks for, each with its boundary."""

from flexdesign.fem.quantities import port_stiffness
from flexdesign.fem.quantities.gathering import of_compliance, of_solution
from flexdesign.fem.quantities.motion import COMPONENTS, POINTS, rotation_centres, six_degrees
from flexdesign.fem.quantities.shares import compliance_shares, energy_shares
from flexdesign.fem.quantities.strength import (
    hinge_peak,
    hinge_peak_node,
    peak_stresses,
    stated_force,
    stresses,
    unresolved_fillet,
)
from flexdesign.fem.quantities.vibration import drive_share, output_share

__all__ = [
    "COMPONENTS",
    "POINTS",
    "compliance_shares",
    "drive_share",
    "energy_shares",
    "hinge_peak",
    "hinge_peak_node",
    "of_compliance",
    "of_solution",
    "output_share",
    "peak_stresses",
    "port_stiffness",
    "rotation_centres",
    "six_degrees",
    "stated_force",
    "stresses",
    "unresolved_fillet",
]
