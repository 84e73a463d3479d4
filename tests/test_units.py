"""Units at the border: what is read, what is refused, and that writing and reading agree."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexdesign.core import units

MAGNITUDES = st.floats(1e-12, 1e12) | st.floats(-1e12, -1e-12) | st.just(0.0)
UNITS = [("mm", "m"), ("um", "m"), ("N/um", "N/m"), ("GPa", "Pa"), ("g", "kg"), ("kHz", "Hz"), ("N*mm/rad", "N*m/rad")]


@pytest.mark.parametrize(
    ("text", "si", "value"),
    [
        ("0.5 mm", "m", 0.5e-3),
        (" 0.5mm ", "m", 0.5e-3),
        ("+.5 mm", "m", 0.5e-3),
        ("5e-1 mm", "m", 0.5e-3),
        ("38 µm", "m", 38e-6),
        ("38 micrometer", "m", 38e-6),
        ("1 inch", "m", 25.4e-3),
        ("100 N/um", "N/m", 1e8),
        ("100 N um^-1", "N/m", 1e8),
        ("71.7 GPa", "Pa", 71.7e9),
        ("2.81 g/cm^3", "kg/m^3", 2810.0),
        ("-30 V", "V", -30.0),
        ("0.33", "1", 0.33),
        (0.33, "1", 0.33),
        (3, "1", 3.0),
        ("2 %", "1", 0.02),
        ("1 um/mm", "1", 1e-3),
    ],
)
def test_reads(text: object, si: str, value: float) -> None:
    assert units.from_text(text, si) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "si", "said"),
    [
        ("5 N", "m", "'N' is wrong here: it is not a unit of length"),
        ("5 m", "N/m", "not a unit of stiffness"),
        ("5 mm", "1", "the number has no unit"),
        ("5", "m", "the unit is missing"),
        (5, "m", "the unit is missing"),
        ("5 mmm", "m", "unknown unit 'mmm'"),
        ("5 mm # wide", "m", "cannot read the unit"),
        ("5 2 mm", "m", "cannot read the unit"),
        ("5,5 mm", "m", "written with a point"),
        ("mm", "m", "does not begin with a number"),
        ("", "m", "is empty"),
        ("nan mm", "m", "not a finite number"),
        ("-inf mm", "m", "not a finite number"),
        (math.nan, "1", "not a finite number"),
        ("1e300 Tm", "um", "not a finite number"),
        (True, "1", "is not a number"),
        (None, "m", "is not a number with a unit"),
        (["1 mm"], "m", "is not a number with a unit"),
    ],
)
def test_refuses(text: object, si: str, said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        units.from_text(text, si)
    if si in units.MEASURES:
        assert f'write for example "{units.example(si)}"' in str(caught.value)


def test_a_scale_that_does_not_start_at_zero_is_refused() -> None:
    """20 degC is 293 K, and no factor makes it so."""
    with pytest.raises(ValueError, match="does not count from zero; use 'K'"):
        units.from_text("20 degC", "K")
    assert units.from_text("20 K", "K") == 20.0


@pytest.mark.parametrize("si", units.DISPLAY)
def test_its_own_examples_can_be_read(si: str) -> None:
    assert units.from_text(units.example(si), si) > 0


@given(MAGNITUDES, st.sampled_from(UNITS))
def test_what_is_written_reads_as_the_same_number(value: float, unit: tuple[str, str]) -> None:
    written = units.to_text(value, unit[0], digits=17, si=unit[1])
    assert units.from_text(written, unit[1]) == pytest.approx(value, rel=1e-14)


@given(MAGNITUDES, st.integers(2, 8))
def test_rounding_stays_within_half_a_digit(value: float, digits: int) -> None:
    shown = float(units.significant(value, digits))
    assert abs(shown - value) <= 0.5000001 * 10.0 ** (1 - digits) * abs(value)


@given(st.floats(1e-4, 9e6), st.integers(1, 8))
def test_readable_numbers_are_written_without_an_exponent(value: float, digits: int) -> None:
    assert "e" not in units.significant(value, digits)


@given(st.text(max_size=30), st.sampled_from(["m", "1", "N/m"]))
def test_any_text_is_read_or_refused(text: str, si: str) -> None:
    try:
        value = units.from_text(text, si)
    except ValueError as error:
        assert "\n" not in str(error).replace(repr(text), "")
    else:
        assert math.isfinite(value)


@pytest.mark.parametrize(
    ("number", "digits", "shown"),
    [
        (1906.2, 4, "1906"),
        (0.0, 4, "0"),
        (12.3894, 3, "12.4"),
        (9.9996, 4, "10.00"),
        (1234567.0, 4, "1234567"),
        (12345678.0, 4, "1.235e+07"),
        (1.234e-5, 2, "1.2e-05"),
        (-0.5, 2, "-0.50"),
        (math.inf, 4, "inf"),
    ],
)
def test_significant_digits(number: float, digits: int, shown: str) -> None:
    assert units.significant(number, digits) == shown


def test_kept_definitions_that_cannot_be_read_or_written_are_no_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def known() -> float:
        registry = units._registry.__wrapped__()
        return float(registry.Quantity(1.0, "N/mm").to("N/m").magnitude)

    monkeypatch.setattr("platformdirs.user_cache_path", lambda *given, **named: tmp_path / "kept")
    assert known() == 1000.0
    kept = [path for path in (tmp_path / "kept").glob("*.pickle") if path.stat().st_size]
    assert kept and known() == 1000.0
    for path in kept:  # as if another process were just writing them
        path.write_bytes(path.read_bytes()[:100])
    assert known() == 1000.0
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *given, **named: tmp_path / "kept" / kept[0].name)
    assert known() == 1000.0
