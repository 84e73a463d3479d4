"""Every quantity that one mesh gives."""

from __future__ import annotations

import math

from flexdesign.core.model import Quantity, output_boundary
from flexdesign.design.design import Actuator
from flexdesign.design.study import Study
from flexdesign.fem.analysis import Solution
from flexdesign.fem.quantities.motion import coupling, rotation_centres, six_degrees
from flexdesign.fem.quantities.port_stiffness import port_stiffness
from flexdesign.fem.quantities.strength import stresses
from flexdesign.fem.quantities.vibration import frequencies
from flexdesign.fem.solving.statics import PortCompliance


def of_solution(study: Study, solution: Solution) -> list[Quantity]:
    """Return every quantity that one mesh gives and whose limit for vanishing element size is sought."""
    c, actuator = solution.compliance, study.design.actuator
    found = []
    if c.has_input:
        found += of_compliance(c, actuator, study.output.load)
        found += stresses(study, solution)
        found += six_degrees(study, c, off_axis=bool(solution.modes))
    if solution.whole:
        found += port_stiffness(c)
    if c.has_input or solution.whole:
        found += rotation_centres(study, c)
    if solution.modes and c.has_input:
        found += coupling(c, study.output.actuator_offset)
    if solution.modes:
        found += frequencies(solution, actuator.installed_stiffness if actuator else 0.0)
    return found


def of_compliance(c: PortCompliance, actuator: Actuator | None, load: float | None = None) -> list[Quantity]:
    """Return what the compliance between input and output gives.

    Parameters
    ----------
    c
        The compliance.
    actuator
        What drives the part, if anything does.
    load
        Stiffness of what the output pushes against [N/m], for one more row of K_in and amplification.
    """
    found = [
        Quantity("K_in", c.input_stiffness, "N/m", "N/mm", "output free"),
        Quantity("lambda", c.amplification, "1", "", "output free"),
        Quantity("K_out", c.output_stiffness(0.0), "N/m", "N/mm", "input free"),
        Quantity("K_out", c.output_stiffness(math.inf), "N/m", "N/mm", "input held"),
    ]
    if load is not None:
        stiffness, ratio = c.loaded(load)
        boundary = output_boundary(load)
        found.append(Quantity("K_in", stiffness, "N/m", "N/mm", boundary))
        found.append(Quantity("lambda", ratio, "1", "", boundary))
    if actuator is not None:
        k, s = actuator.installed_stiffness, actuator.free_stroke
        found += [
            Quantity("K_out", c.output_stiffness(k), "N/m", "N/mm", "actuator installed"),
            Quantity("stroke", c.stroke(s, k), "m", "um", "output free"),
            Quantity("blocked_force", c.blocked_force(s, k), "N", "N", "output held"),
            Quantity("actuator_force", c.actuator_force(s, k), "N", "N", "full stroke, output free"),
        ]
        if actuator.preload > 0:
            found += _preload_effects(c, actuator.preload, k)
    return found


def _preload_effects(c: PortCompliance, preload: float, k: float) -> list[Quantity]:
    """Return what the preload does: it shifts the output at rest, and an output force of one sign uses it up.

    An output force P extends the inputs by C12 P / (1 + k C11), and the stack's compression falls by k times that.
    """
    lost = preload * (1 + k * c.c11) / (k * c.c12)
    return [
        Quantity("preload_shift", preload * c.c12, "m", "um", "output free"),
        Quantity("output_force_that_unloads_the_stack", lost, "N", "N", "no voltage"),
    ]
