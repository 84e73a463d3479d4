"""Stress at the hinges, nominal and at its peak, and what it leaves to yield and fatigue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexdesign.core import units
from flexdesign.core.model import Member, Quantity
from flexdesign.design.study import Study
from flexdesign.fem.analysis import Solution
from flexdesign.fem.post_processing import stress


def stated_force(study: Study, solution: Solution) -> tuple[float, str]:
    """Return the actuator force at which stress is stated [N], preload included, and how it comes about."""
    actuator, stroke, compliance = study.design.actuator, study.output.stroke, solution.compliance
    preload = actuator.preload if actuator else 0.0
    also = " and preload" if preload else ""
    if stroke is not None:
        return stroke / abs(compliance.c12) + preload, f"{stroke * 1e6:g} um at the output{also}"
    if actuator is not None:
        force = compliance.actuator_force(actuator.free_stroke, actuator.installed_stiffness)
        return force + preload, f"full voltage{also}"
    return 1.0, "1 N of actuator force"


def stresses(study: Study, solution: Solution) -> list[Quantity]:
    """Return the nominal stress of the hinges at the stated force, and how far it is from yield and fatigue."""
    force, boundary = stated_force(study, solution)
    hinges = [section.nominal_stress for section in solution.input_sections if section.member.kind == "hinge"]
    if not hinges:  # without members there is no nominal stress, and the peak is all there is
        return []
    nominal = max(hinges)
    found = [Quantity("hinge_stress", force * nominal, "Pa", "MPa", boundary)]
    return found + _margins(study, solution, nominal, f"hinge stress, {boundary}")


def unresolved_fillet(solution: Solution) -> str:
    """Say that a fillet next to a thin region is smaller than the edges of the mesh; empty if none is."""
    found = solution.facts.get("unresolved fillet")
    if not found:
        return ""
    radius, edge = (units.to_text(length, "mm", 2, si="m") for length in found)
    return (
        f"Peak stress is not resolved at a fillet of radius {radius} next to a thin region: edges of the mesh are "
        f"{edge} long there; reduce mesh.at_root."
    )


def peak_stresses(study: Study, solutions: Sequence[Solution], sizes: Sequence[float]) -> list[Quantity]:
    """Return the peak stress at the hinges at the stated force, and what it leaves to yield and fatigue.

    Where a root is sharp there is no peak but a number that grows as the mesh is refined, and no margin can be had from
    it; neither from one at a fillet that the mesh does not follow. Elsewhere the margins carry the peak's relative
    error. Of a crystal, which breaks before it yields, the largest tension is sought, too.

    Parameters
    ----------
    study
        What was asked.
    solutions, sizes
        Of meshes coarse to fine, with their element sizes at the roots [m].
    """
    if not solutions[-1].compliance.has_input:
        return []
    force, boundary = stated_force(study, solutions[-1])
    hinges = [section.member for section in solutions[-1].input_sections if section.member.kind == "hinge"]
    sharp = any(stress.is_sharp(hinge) for hinge in hinges) or solutions[-1].facts.get("sharp", False)
    unresolved = unresolved_fillet(solutions[-1])
    unknowns = f"FEM, {len(sizes)} meshes to {solutions[-1].facts['unknowns']} unknowns"

    def peak(name: str, values: Sequence[float]) -> Quantity:
        found = stress.peak(values, sizes, sharp=sharp)
        if unresolved and not sharp:
            source = f"{unknowns}, value of the finest. {unresolved}"
            return Quantity(name, force * found.value, "Pa", "MPa", boundary, source)
        if found.error is not None:
            source, sigma = f"{unknowns}, value of the finest", force * found.error
            return Quantity(name, force * found.value, "Pa", "MPa", boundary, source, sigma)
        seen = f"grows as h^{-found.exponent:.2f} here, in the end as h^{-stress.SINGULAR:.2f}"
        source = f"{unknowns}; singular: grows with refinement, use a fillet ({seen})"
        return Quantity(name, force * found.value, "Pa", "MPa", boundary, source)

    largest = peak("peak_stress", [hinge_peak(solution) for solution in solutions])
    peaks = [largest]
    if study.design.material.crystal is not None:
        peaks.append(peak("peak_tension", [hinge_peak(solution, solution.tension) for solution in solutions]))
    if largest.half_width is None:
        return peaks
    error = largest.half_width / largest.value
    margins = _margins(study, solutions[-1], largest.value / force, f"peak stress, {boundary}")
    return [*peaks, *(replace(m, half_width=m.value * error, source=largest.source) for m in margins)]


def hinge_peak(solution: Solution, field: np.ndarray | None = None) -> float:
    """Return the largest von Mises stress, or other field (n,), within one thickness of the hinges [Pa/N].

    Other edges of the solid and the rim of the held face have singularities of their own, which say nothing of the
    design.
    """
    values = solution.von_mises if field is None else field
    return float(values[hinge_peak_node(solution, values)])


def hinge_peak_node(solution: Solution, field: np.ndarray | None = None) -> int:
    """Return the node at which `hinge_peak` is found."""
    hinges = [section.member for section in solution.input_sections if section.member.kind == "hinge"]
    if hinges:
        near = np.any([_distance(solution.positions, hinge) <= hinge.thickness for hinge in hinges], axis=0)
    else:  # what was found to be thin
        near = np.isin(np.arange(len(solution.positions)), solution.thin_nodes)
    values = solution.von_mises if field is None else field
    return int(np.flatnonzero(near)[np.argmax(values[near])])


def _margins(study: Study, solution: Solution, per_force: float, where: str) -> list[Quantity]:
    """Return what a stress per actuator force [Pa/N] leaves to yield and to fatigue, where data are known.

    In operation the actuator swings between no drive and the stated one, about a preload that stays: the amplitude is
    half the drive's stress, the mean is that and the preload's, taken as tension, as it is on one side of a bent leaf.
    """
    material = study.design.material
    force, _ = stated_force(study, solution)
    found = []
    if material.yield_strength is not None:
        found.append(Quantity("safety_against_yield", material.yield_strength / (force * per_force), "1", "", where))
    preload = study.design.actuator.preload if study.design.actuator else 0.0
    driven = study.design.actuator is not None or study.output.stroke is not None
    swing = (force - preload) / 2
    if driven and material.fatigue is not None:
        margin = material.fatigue_margin(swing * per_force, (preload + swing) * per_force)
        found.append(Quantity("safety_against_fatigue", margin or 0.0, "1", "", where))
    return found


def _distance(points: np.ndarray, member: Member) -> np.ndarray:
    """Return the distance of points (n, 3) from a member's axis, seen along the width."""
    start, axis = np.array(member.start)[:2], np.array(member.axis)[:2]
    along = np.clip((points[:, :2] - start) @ axis, 0.0, member.length)
    return np.asarray(np.linalg.norm(points[:, :2] - start - along[:, None] * axis, axis=1))
