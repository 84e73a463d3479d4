"""Domains drawn out of an outline against those that the CAD kernel cuts from the solid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.model import Linkage, Member
from flexdesign.design import design
from flexdesign.design import part as parts
from flexdesign.design.part import Outline, SymmetryPlane
from flexdesign.fem.meshing import domain, polygon_domain
from tests.fem.solids import Bracket

BRACKET = [(-4, 0), (4, 0), (4, 9), (9, 9), (9, 13), (-9, 13), (-9, 9), (-4, 9)]


@dataclass(frozen=True)
class Told(Bracket):
    """The bracket with its outline, or another one."""

    corners: tuple[tuple[float, float], ...] = tuple((x * 1e-3, y * 1e-3) for x, y in BRACKET)
    low: float = -3e-3

    def linkage(self) -> Linkage:
        """Return the stem as a hinge: without one the faces of the solid are covered with even triangles."""
        foot, top = (0.0, 0.0, 0.0), (0.0, 9e-3, 0.0)
        return Linkage({"foot": foot, "top": top}, (Member("stem", "hinge", ("foot", "top"), foot, top, 8e-3, 6e-3),))

    def outline(self) -> Outline:
        """Return the corners."""
        return Outline([self.corners], self.low, 3e-3)


def amplifier(name: str, **dimensions: float) -> Any:
    read = design.read(design.find(name))
    return replace(read, dimensions={**read.dimensions, **dimensions}).part()


def where(body: domain.Domain) -> Any:
    """What must not depend on how the domain came about, in nanometres: corners, and where named faces lie."""
    assert body.section is not None

    def rounded(points: Any) -> list[Any]:
        return sorted({tuple(row) for row in (np.round(np.asarray(points) * 1e9).astype(int) + 0).tolist()})

    ends = np.concatenate([curve.points[[0, -1]] for curve in body.section.outline])
    ports = {name: rounded(body.faces[face].points) for name, face in body.ports.items()}
    planes = [sorted(rounded(body.faces[face].points) for face in faces) for faces in body.plane_faces]
    in_section = [[p for p in plane if len(p) == 4] for plane in planes]  # the extrusion's own plane has many corners
    depth = round(body.section.low * 1e9), round(body.section.high * 1e9)
    return rounded(ends), depth, ports, in_section


@pytest.mark.parametrize(
    "part",
    [
        amplifier("bridge_amplifier"),
        amplifier("lin2019_amplifier_xy", arm_offset=1.6e-3, width=14e-3),
        amplifier("lin2019_amplifier_z"),
        amplifier("bridge_amplifier", rod_length=0.0, input_block_height=30e-3),
        Told(),
    ],
)
def test_the_domain_is_that_of_the_solid(part: Any) -> None:
    told, solid = polygon_domain.of_part(part), domain.of_part(part, chord=1e-5)
    assert told is not None and told.section is not None and solid.section is not None
    assert where(told) == where(solid)
    assert told.volume == pytest.approx(solid.volume, rel=1e-12)
    for name, face in told.ports.items():
        normal, given = told.faces[face].normal, next(p.normal for p in part.ports() if p.name == name)
        assert normal == pytest.approx(np.array(given), abs=1e-12)
    inner, outer = (np.array(sorted(body.section.reentrant_corners().round(9).tolist())) for body in (told, solid))
    assert inner == pytest.approx(outer)


def test_fillets_are_no_matter_of_corners() -> None:
    rounded = amplifier("bridge_amplifier", fillet_radius=2e-4)
    assert parts.straight_outline(rounded) is None and polygon_domain.of_part(rounded) is None
    assert parts.straight_outline(Bracket()) is None


@pytest.mark.parametrize(
    ("changes", "remedy"),
    [
        ({"corners": ((-4e-3, 0), (4e-3, 0), (-4e-3, 13e-3), (4e-3, 13e-3))}, "crosses itself"),
        ({"corners": ((-4e-3, 0), (5e-3, 0), (4e-3, 13e-3), (-4e-3, 13e-3))}, "own mirror image"),
        ({"low": -2e-3}, "own mirror image"),
        ({"corners": ((-4e-3, 1e-3), (4e-3, 1e-3), (4e-3, 13e-3), (-4e-3, 13e-3))}, "no plane face"),
    ],
)
def test_outlines_that_cannot_be_are_refused(changes: dict[str, Any], remedy: str) -> None:
    with pytest.raises(InputError, match=remedy):
        polygon_domain.of_part(Told(**changes))


@pytest.mark.parametrize(("method", "answer"), [("outline", [(0.0, 0.0)]), ("prismatic", None)])
def test_outlines_that_are_none_are_refused_before_anything_is_built(method: str, answer: Any) -> None:
    part = amplifier("bridge_amplifier")
    other = type("Other", (type(part),), {method: lambda self: answer, "__module__": type(part).__module__})
    with pytest.raises(InputError, match=r"Other\.outline\(\).*must return a flexdesign\.Outline or None"):
        parts.examine(other(**vars(part)))


def test_a_plane_that_misses_the_outline_is_refused() -> None:
    class Aside(Told):
        def symmetry(self) -> tuple[SymmetryPlane, ...]:
            return (SymmetryPlane("y", {}),)

    with pytest.raises(InputError, match="symmetry"):
        polygon_domain.of_part(Aside())
