"""What a report says of the accuracy that was asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flexdesign.core.model import Quantity
from flexdesign.fem import mesh_refinement
from flexdesign.report.wording import name_of


def not_reached(
    required: float | None, found: Sequence[Quantity], where: str = "on the finest mesh that is tried"
) -> str:
    """Say for the headline that an accuracy (relative) was not reached, and by which quantity; nothing if it was."""
    worst = mesh_refinement.least_certain(found)
    reached = abs((worst.half_width or 0.0) / worst.value)
    if required is None or reached <= required:
        return ""
    return (
        f"The accuracy that was asked for is NOT reached: {_percent(required)} was asked for in every stiffness and "
        f"amplification, and the estimated error of the {name_of(worst)}, {worst.boundary}, is {_percent(reached)} "
        f"{where}."
    )


def not_reached_by(required: float | None, missed: Mapping[str, float], count: int) -> str:
    """Say for the headline of a sweep how many of its cases miss an accuracy (relative), and by how much at worst.

    Parameters
    ----------
    required
        The accuracy.
    missed
        The cases that miss it, in words, with the largest estimated error of each.
    count
        How many cases have an answer.
    """
    if required is None or not missed:
        return ""
    worst = max(missed, key=lambda words: missed[words])
    return (
        f"The accuracy that was asked for is NOT reached in {len(missed)} of {count} cases: {_percent(required)} was "
        "asked for in every stiffness and amplification, and the largest estimated error of one is "
        f"{_percent(missed[worst])}, with {worst}."
    )


def reached(required: float | None, found: Sequence[Quantity]) -> str:
    """Say with the meshes how the largest estimated error compares with the accuracy that was asked for."""
    if required is None:
        return ""
    error = mesh_refinement.estimated_error(found)
    verdict = "reached" if error <= required else "NOT reached with the finest mesh that is tried"
    return (
        f" Asked for was an error of at most {_percent(required)} in every stiffness and amplification; the largest "
        f"estimate is {_percent(error)}: {verdict}."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
