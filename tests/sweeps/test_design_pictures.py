"""Designs side by side: extruded parts as sections, others as the surface of their solid."""

from __future__ import annotations

import numpy as np
import pytest

from flexdesign.design import design as designs
from flexdesign.design.design import Design
from flexdesign.report import pictures
from flexdesign.report.pictures import NoPictures
from flexdesign.report.validation import design_pictures

SHARP = ("dimensions.fillet_radius=0 mm",)
ROUNDED = ("dimensions.fillet_radius=0.2 mm",)


def amplifier(overrides: tuple[str, ...]) -> Design:
    return designs.read(designs.find("bridge_amplifier"), overrides)


def test_the_surface_encloses_what_the_solid_does() -> None:
    design = amplifier(ROUNDED)
    points, triangles = design_pictures.skin(design)
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    enclosed = np.einsum("ij,ij->", a, np.cross(b, c)) / 6  # divergence theorem
    # The roots' arcs stand for chords of 0.05 mm at most: 1 % of the fillets, which are 0.1 % of the part.
    assert enclosed == pytest.approx(1e-9 * design.part().solid().Volume(), rel=1e-4)


def test_extruded_parts_are_sections_and_others_solids() -> None:
    figures, said = design_pictures.draw({"sharp": amplifier(SHARP), "round, thin": amplifier(ROUNDED)})
    assert [(figure.file, figure.caption) for figure in figures][1:] == [("design_1.png", "round, thin")]
    assert figures[0].file == "sections.svg" and figures[1].data.startswith(b"\x89PNG") and not said


def test_without_graphics_sections_are_drawn_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: object) -> dict[str, bytes]:
        raise NoPictures("no library")

    monkeypatch.setattr(pictures, "draw", fails)
    figures, said = design_pictures.draw({"sharp": amplifier(SHARP), "rounded": amplifier(ROUNDED)})
    assert [figure.file for figure in figures] == ["sections.svg"]
    assert said == ["No pictures: no library."]
