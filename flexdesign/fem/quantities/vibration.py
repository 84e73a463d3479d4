"""Natural frequencies, and what single modes carry."""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.model import Quantity
from flexdesign.fem.analysis import ModeRecord, Solution
from flexdesign.fem.solving.statics import PortCompliance


def output_share(mode: ModeRecord, compliance: PortCompliance, actuator: float) -> float:
    """Return what part of the output's compliance, 1/K_out, one mode carries: 1 / (m omega^2), m its output mass."""
    stiffness = compliance.output_stiffness(actuator if mode.installed else 0.0)
    return stiffness / (mode.output_mass * (2 * math.pi * mode.frequency) ** 2)


def drive_share(mode: ModeRecord, compliance: PortCompliance, actuator: float) -> float:
    """Return what part of the static response to a voltage one mode carries: e y / (omega^2 Y).

    By mode superposition, e and y are extension of the inputs and motion of the output for unit modal mass. Y is the
    static output motion per blocked force of the actuator, its spring k (`actuator` [N/m], where the mode has it) in
    place: C12 / (1 + k C11). Over all modes the shares add up to 1; a mode that moves the output against Y has a
    negative one, and others then carry more than 1 together.
    """
    static = compliance.c12 / (1 + (actuator if mode.installed else 0.0) * compliance.c11)
    return mode.extension / (math.sqrt(mode.output_mass) * (2 * math.pi * mode.frequency) ** 2 * static)


def frequencies(solution: Solution, actuator: float) -> list[Quantity]:
    """Return the first frequency, and those of the modes with most output and actuator participation."""
    found = []
    free = "input free" if solution.compliance.has_input else "output free"
    for installed, boundary in ((False, free), (True, "actuator installed")):
        modes = [mode for mode in solution.modes if mode.installed == installed]
        if not modes:
            continue
        shares = [output_share(mode, solution.compliance, actuator) for mode in modes]
        main = int(np.argmax(shares))
        found += [
            Quantity("first_frequency", modes[0].frequency, "Hz", "Hz", boundary),
            Quantity("output_frequency", modes[main].frequency, "Hz", "Hz", boundary),
            Quantity("output_share", shares[main], "1", "%", boundary),
            Quantity("output_mass", modes[main].output_mass, "kg", "g", boundary),
        ]
        if installed:
            shares = [drive_share(mode, solution.compliance, actuator) for mode in modes]
            main = int(np.argmax(shares))
            found += [
                Quantity("drive_frequency", modes[main].frequency, "Hz", "Hz", boundary),
                Quantity("drive_share", shares[main], "1", "%", boundary),
            ]
    return found
