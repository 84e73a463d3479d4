"""Drawings: letters that are read on light and on dark paper, sizes that a telephone shows, and their texts."""

from __future__ import annotations

import re

import pytest

from flexdesign.report import charts
from flexdesign.report.diagnosis.diagnosis_charts import Step, error_ladder

LADDER = error_ladder([Step("as designed", 4.7, "4.7 um"), Step("+ creep", 0.02, "20 nm")], 0.02, "20 nm", "um")


def luminance(colour: str) -> float:
    """Return the relative luminance of a colour (WCAG 2.2)."""
    channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: str, other: str) -> float:
    """Return the contrast ratio of two colours (WCAG 2.2)."""
    low, high = sorted([luminance(one), luminance(other)])
    return (high + 0.05) / (low + 0.05)


def test_letters_have_contrast_on_light_and_on_dark_paper() -> None:
    """WCAG AA asks for 4.5; the papers are those of page.css."""
    light, dark = re.findall(rb"fill: (#\w{6}) !important", LADDER)
    assert contrast(light.decode(), "#ffffff") > 4.5 and contrast(dark.decode(), "#14181c") > 4.5
    assert charts.NEUTRAL.encode() in re.findall(rb'g\[style\^="fill: (#\w{6})"\]', LADDER)
    assert b'<g style="fill: ' + charts.NEUTRAL.encode() in LADDER


def test_a_ladder_is_shown_whole_on_a_narrow_window() -> None:
    assert charts.is_narrow(LADDER)
    assert not charts.is_narrow(charts.shares({"K_in": {"hinges": 60.0, "arms": 40.0}}, "share [%]"))


@pytest.mark.parametrize("words", ["rms error [µm]", "noise floor, 20 nm at 0.02", "as designed, + creep"])
def test_a_ladder_says_what_it_shows(words: str) -> None:
    assert words in charts.description(LADDER)
