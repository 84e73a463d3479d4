"""Pictures drawn off-screen: parts stand clear of the letters, colours have a unit with few digits."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from flexdesign.report import pictures
from flexdesign.report.pictures import BAR_SHARE, LINE_SHARE, Picture, displacement_unit

#: A tetrahedron [m] that is four times as tall as it is wide.
COLUMN = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.005, 0.04, 0.0], [0.005, 0.0, 0.01]])
CELLS = np.array([[0, 1, 2, 3]])


def rows_drawn(image: bytes) -> np.ndarray:
    """Return the rows, relative to the height from above, in which the middle of a picture is not white."""
    shades = np.asarray(Image.open(io.BytesIO(image)).convert("L"))
    height, width = shades.shape
    middle = shades[:, int(0.4 * width) : int(0.6 * width)]
    return np.flatnonzero((middle < 250).any(axis=1)) / height


@pytest.mark.parametrize("motion", [0.0, 0.01])
def test_a_tall_part_stands_between_note_and_scalar_bar(motion: float) -> None:
    displacement = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, motion, 0.0], [0.0, 0.0, 0.0]])
    plain = Picture("plain.png", COLUMN, CELLS, displacement, notes=["drawn larger"])
    coloured = Picture("coloured.png", COLUMN, CELLS, displacement, COLUMN[:, 1], "y [m]", notes=["drawn larger"])
    images = pictures.draw([plain, coloured])
    assert LINE_SHARE < rows_drawn(images["plain.png"])[0] < 0.2
    rows = rows_drawn(images["coloured.png"])
    assert rows[0] > LINE_SHARE
    gap = int(np.argmax(np.diff(rows)))  # between the part and the bar's title
    assert rows[gap] < 1.0 - BAR_SHARE < rows[gap + 1] + 0.02


@pytest.mark.parametrize(("largest", "colour", "unit"), [(2.5e-3, 2.5, "mm"), (4e-5, 40.0, "µm"), (3e-8, 30.0, "nm")])
def test_displacements_have_a_unit_with_few_digits(largest: float, colour: float, unit: str) -> None:
    factor, label = displacement_unit(largest)
    assert factor * np.array([0.0, largest]) == pytest.approx([0.0, colour])
    assert label == f"displacement [{unit}]"
