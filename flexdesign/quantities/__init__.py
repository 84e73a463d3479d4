"""From port compliance, section forces and modes to the quantities a designer asks for, each with its boundary."""

from flexdesign.quantities.gathering import of_compliance, of_solution
from flexdesign.quantities.handover import AXIS, stage_model
from flexdesign.quantities.motion import COMPONENTS, POINTS, six_degrees
from flexdesign.quantities.shares import compliance_shares, energy_shares
from flexdesign.quantities.strength import hinge_peak, hinge_peak_node, peak_stresses, stated_force, stresses
from flexdesign.quantities.vibration import drive_share, output_share

__all__ = [
    "AXIS",
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
    "six_degrees",
    "stage_model",
    "stated_force",
    "stresses",
]
