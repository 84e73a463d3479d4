"""Closed forms of notch hinges against quadrature, against a wedge, against published numbers, and in their limits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from flexdesign.analytic import notch
from flexdesign.analytic.notch import EndCompliance
from flexdesign.analytic.textbook import TextbookBridge
from flexdesign.core.model import Notch

YOUNG, WIDTH, THICKNESS, RADIUS = 71e9, 10e-3, 0.5e-3, 2e-3
#: Neck over radius, from far thinner to far thicker than is built.
NECKS = [0.004, 0.05, 0.25, 1.0, 3.0]
#: Length, fillet and thickness [m]; the last but one is nearly all fillet, the last one nearly sharp.
FILLETED = [
    (4e-3, 0.5e-3, 0.5e-3),
    (10e-3, 1e-3, 0.3e-3),
    (20e-3, 2e-3, 0.05e-3),
    (3e-3, 1.49e-3, 0.4e-3),
    (8e-3, 0.05e-3, 1e-3),
]
#: Quadrature is asked for 1e-11; terms that cancel cost the closed forms less than that down to a fillet of t / 20.
CLOSED = 1e-10


def assert_close(found: EndCompliance, expected: EndCompliance, rel: float) -> None:
    assert dataclasses.asdict(found) == pytest.approx(dataclasses.asdict(expected), rel=rel)


# --- the reference itself


def test_quadrature_on_a_wedge() -> None:
    """Height from a to c in proportion to x: elementary integrals. Rounding and the quadrature's 1e-11."""
    a, c, length = 0.4e-3, 1.1e-3, 5e-3
    slope, young, width = (c - a) / length, 3e9, 7e-3
    squares, inverses = (a**-2 - c**-2) / 2, 1 / a - 1 / c
    expected = EndCompliance(
        rotation=12 / (young * width) * squares / slope,
        cross=12 / (young * width) * (c * squares - inverses) / slope**2,
        transverse=12 / (young * width) * (c**2 * squares - 2 * c * inverses + math.log(c / a)) / slope**3,
        axial=math.log(c / a) / (slope * young * width),
    )
    assert_close(notch.beam_integral(young, width, lambda x: a + slope * x, length), expected, 1e-10)


def test_quadrature_on_a_leaf() -> None:
    found = notch.beam_integral(YOUNG, WIDTH, lambda _: THICKNESS, 4e-3)
    assert_close(found, notch.leaf(YOUNG, WIDTH, THICKNESS, 4e-3), 1e-12)  # polynomials: rounding alone


def test_heights_are_the_neck_in_the_middle_and_the_block_at_the_ends() -> None:
    circle, fillets = notch.circular_thickness(2.0, 0.5), notch.filleted_thickness(10.0, 1.0, 0.5)
    assert [circle(x) for x in (0.0, 2.0, 4.0)] == [4.5, 0.5, 4.5]
    assert circle(1.0) == pytest.approx(0.5 + 2 * (2 - math.sqrt(3)), rel=1e-15)  # 60 degrees of arc
    assert [fillets(x) for x in (0.0, 1.0, 5.0, 9.0, 10.0)] == [2.5, 0.5, 0.5, 0.5, 2.5]


# --- closed forms that claim to be exact


@pytest.mark.parametrize("neck", NECKS)
def test_lobontiu_circular_is_the_integral(neck: float) -> None:
    thickness = neck * RADIUS
    height = notch.circular_thickness(RADIUS, thickness)
    expected = notch.beam_integral(YOUNG, WIDTH, height, 2 * RADIUS, RADIUS)
    assert_close(notch.lobontiu_circular(YOUNG, WIDTH, thickness, RADIUS), expected, CLOSED)


@pytest.mark.parametrize(("length", "fillet", "thickness"), FILLETED)
def test_lobontiu_corner_filleted_is_the_integral(length: float, fillet: float, thickness: float) -> None:
    height = notch.filleted_thickness(length, fillet, thickness)
    expected = notch.beam_integral(YOUNG, WIDTH, height, length, fillet, length - fillet)
    assert_close(notch.lobontiu_corner_filleted(YOUNG, WIDTH, thickness, length, fillet), expected, CLOSED)


@pytest.mark.parametrize("neck", NECKS)
@pytest.mark.parametrize("depth", [0.05, 0.4, 0.8, 1.0])
def test_paros_weisbord_in_full_is_the_integral(neck: float, depth: float) -> None:
    """For notches that are shallower than a half circle as well."""
    thickness = neck * RADIUS
    half = RADIUS * math.sqrt(depth * (2 - depth))

    def height(x: float) -> float:
        return thickness + 2 * (RADIUS - math.sqrt(max(0.0, RADIUS**2 - (x - half) ** 2)))

    expected = notch.beam_integral(YOUNG, WIDTH, height, 2 * half, half)
    found = notch.paros_weisbord(YOUNG, WIDTH, thickness, RADIUS, thickness + 2 * depth * RADIUS)
    assert found == pytest.approx((expected.rotation, expected.axial), rel=CLOSED)


def test_paros_weisbord_takes_a_half_circle_unless_told() -> None:
    both = notch.lobontiu_circular(YOUNG, WIDTH, THICKNESS, RADIUS)
    assert notch.paros_weisbord(YOUNG, WIDTH, THICKNESS, RADIUS) == pytest.approx(
        (both.rotation, both.axial), rel=1e-13
    )


# --- published and known numbers


def test_known_stiffness_of_a_circular_hinge() -> None:
    """R 2 mm, t 0.5 mm, b 10 mm, E 71 GPa, in N mm/rad, to the five digits given."""
    exact = 1e3 * notch.lobontiu_circular(YOUNG, WIDTH, THICKNESS, RADIUS).rotational_stiffness
    full = 1e3 / notch.paros_weisbord(YOUNG, WIDTH, THICKNESS, RADIUS)[0]
    thin = 1e3 * notch.thin_neck(YOUNG, WIDTH, THICKNESS, RADIUS).rotational_stiffness
    assert (exact, full, thin) == (
        pytest.approx(6486.3, abs=0.05),
        pytest.approx(6486.3, abs=0.05),
        pytest.approx(6277.8, abs=0.05),
    )
    # Plane-stress finite elements, good to 0.2 % (studies.verification.hinges): blocks give way, and beams neglect it.
    solid = 5923.2
    assert exact / solid - 1 == pytest.approx(0.095, abs=0.002)
    assert thin / solid - 1 == pytest.approx(0.060, abs=0.002)


def test_the_simplified_formulas_as_printed() -> None:
    """9 pi R^(1/2) / (2 E b t^(5/2)), and (pi (R / t)^(1/2) - 2.57) / E b, whose constant has three digits."""
    found = notch.thin_neck(YOUNG, WIDTH, THICKNESS, RADIUS)
    printed = 9 * math.pi * RADIUS**0.5 / (2 * YOUNG * WIDTH * THICKNESS**2.5)
    assert found.rotation == pytest.approx(printed, rel=1e-14)
    assert found.axial * YOUNG * WIDTH == pytest.approx(math.pi * math.sqrt(4) - 2.57, abs=0.005)


# --- limits


@pytest.mark.parametrize("neck", [0.1, 0.03, 0.01, 0.003])
def test_thin_necks_err_by_what_is_stated(neck: float) -> None:
    """t / 8R in rotation; about 0.4 t / R along, with terms in (t / R)^(3/2); less than 2 t / R in sway.

    Of the closed form's rotation, what goes with pi is that of a thin neck times (1 + t / 2R) / (1 + t / 4R)^(5/2): an
    error of t / 8R + 7 (t / R)^2 / 128. The rest is of order (t / R)^(5/2).
    """
    exact = notch.lobontiu_circular(YOUNG, WIDTH, neck * RADIUS, RADIUS)
    thin = notch.thin_neck(YOUNG, WIDTH, neck * RADIUS, RADIUS)
    assert thin.rotation / exact.rotation - 1 == pytest.approx(neck / 8 + 7 * neck**2 / 128, abs=neck**2.5 / 20)
    assert thin.cross / exact.cross == pytest.approx(thin.rotation / exact.rotation, rel=1e-12)
    assert -0.48 < (thin.axial / exact.axial - 1) / neck < -0.36
    assert 1.4 < (exact.sway_stiffness / thin.sway_stiffness - 1) / neck < 2


@pytest.mark.parametrize("neck", [1e-2, 1e-3, 1e-4])
def test_stiffness_vanishes_as_the_neck_does_to_the_power_of_five_halves(neck: float) -> None:
    """K = K_thin (1 + t / 8R): the local exponent is 5/2 but for t / 8R."""

    def stiffness(thickness: float) -> float:
        return notch.lobontiu_circular(YOUNG, WIDTH, thickness, RADIUS).rotational_stiffness

    step = 1.01
    exponent = math.log(stiffness(neck * RADIUS * step) / stiffness(neck * RADIUS)) / math.log(step)
    assert exponent == pytest.approx(2.5, abs=neck / 7)


@pytest.mark.parametrize("radius", [0.1, 1.0, 10.0])
def test_a_large_radius_makes_a_leaf(radius: float) -> None:
    """A circle over a length l is c = l^2 / 4R higher at the ends, c / 3 on average: c / t stiffer, next (c / t)^2."""
    length = 4e-3
    rise = 2 * (radius - math.sqrt(radius**2 - length**2 / 4))
    rotation, axial = notch.paros_weisbord(YOUNG, WIDTH, THICKNESS, radius, THICKNESS + rise)
    flat, share = notch.leaf(YOUNG, WIDTH, THICKNESS, length), rise / THICKNESS
    # What is left of the rise is rounded at 1e-16 of the radius.
    rounding = 1e-15 * radius / rise
    assert rotation / flat.rotation == pytest.approx(1 - share, abs=2 * share**2 + rounding)
    assert axial / flat.axial == pytest.approx(1 - share / 3, abs=share**2 + rounding)


@pytest.mark.parametrize("fillet", [1e-2, 1e-3, 1e-4])
def test_small_fillets_make_a_leaf(fillet: float) -> None:
    """In fillets much smaller than t, heights differ by 2 r (1 - pi / 4) on average: 12 (1 - pi / 4) r^2 / l t less."""
    length = 8 * THICKNESS
    flat = notch.leaf(YOUNG, WIDTH, THICKNESS, length)
    rounded = notch.lobontiu_corner_filleted(YOUNG, WIDTH, THICKNESS, length, fillet * THICKNESS)
    first = 12 * (1 - math.pi / 4) * fillet**2 / 8
    # The next term is 3 r / t times the first, at most; terms of the size of the result leave 1e-15.
    assert 1 - rounded.rotation / flat.rotation == pytest.approx(first, rel=3 * fillet, abs=1e-14)
    assert 1 - rounded.axial / flat.axial == pytest.approx(first / 3, rel=3 * fillet, abs=1e-14)


# --- other profiles

#: Half length, depth and neck [m]: as deep as long, shallow, deep, and thick.
NOTCHES = [(2e-3, 2e-3, 0.5e-3), (2e-3, 0.3e-3, 0.2e-3), (1e-3, 4e-3, 0.1e-3), (3e-3, 1e-3, 2e-3)]


def by_quadrature(shape: Notch, thickness: float) -> EndCompliance:
    a = shape.half_length

    def height(x: float) -> float:
        return thickness + 2 * float(shape.rise(np.array([x - a]))[0])

    places = (a - shape.arc_half, a, a + shape.arc_half)
    return notch.beam_integral(YOUNG, WIDTH, height, 2 * a, *places)


@pytest.mark.parametrize("neck", NECKS)
def test_wu_and_zhou_are_paros_and_weisbord(neck: float) -> None:
    found = notch.wu_zhou(YOUNG, WIDTH, neck * RADIUS, RADIUS)
    assert found == pytest.approx(notch.paros_weisbord(YOUNG, WIDTH, neck * RADIUS, RADIUS), rel=1e-9)


@pytest.mark.parametrize(("a", "c", "t"), NOTCHES)
def test_elliptic_and_parabolic_notches_are_their_integrals(a: float, c: float, t: float) -> None:
    assert_close(notch.elliptic(YOUNG, WIDTH, t, a, c), by_quadrature(Notch.elliptic(a, c), t), 1e-8)
    assert_close(notch.parabolic(YOUNG, WIDTH, t, a, c), by_quadrature(Notch.parabolic(a, c), t), 1e-8)


@pytest.mark.parametrize(("a", "c", "t"), NOTCHES)
def test_a_v_is_its_integral(a: float, c: float, t: float) -> None:
    expected = by_quadrature(Notch.v(a, c, 0.1e-3), t)
    found = notch.v_notch(YOUNG, WIDTH, t, a, c, 0.1e-3)
    assert found == pytest.approx((expected.rotation, expected.axial), rel=1e-8)


def test_a_thin_parabola_is_the_thin_neck_of_its_radius() -> None:
    """Near a thin neck every profile is a parabola; what the ends add falls with (t / 2c)^(5/2)."""
    a, t = 2e-3, 1e-5
    parabola = notch.parabolic(YOUNG, WIDTH, t, a, a / 2)  # of radius a at the neck
    assert parabola.rotation == pytest.approx(notch.thin_neck(YOUNG, WIDTH, t, a).rotation, rel=1e-5)


# --- scaling, for all dimensions

SIZES = st.floats(math.log(0.02), math.log(50.0)).map(math.exp)
FACTORS = st.floats(0.1, 10.0)
FORMS: dict[str, Callable[[float, float, float, float], EndCompliance]] = {
    "leaf": lambda young, width, t, r: notch.leaf(young, width, t, 3 * r),
    "thin neck": notch.thin_neck,
    "circular": notch.lobontiu_circular,
    "filleted": lambda young, width, t, r: notch.lobontiu_corner_filleted(young, width, t, 3 * r, r),
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@given(thickness=SIZES, young=FACTORS, width=FACTORS, size=FACTORS)
def test_scaling(
    form: Callable[[float, float, float, float], EndCompliance],
    thickness: float,
    young: float,
    width: float,
    size: float,
) -> None:
    """Compliance goes with 1 / E and 1 / b; other lengths times s: s^-2, s^-1, 1 and 1. Rounding, and what cancels."""
    one, other = form(1.0, 1.0, thickness, 1.0), form(young, width, size * thickness, size)
    expected = EndCompliance(one.rotation / size**2, one.cross / size, one.transverse, one.axial)
    expected = EndCompliance(*(value / (young * width) for value in dataclasses.astuple(expected)))
    # In thicknesses, a thick neck's terms are 1 and its transverse compliance (R / t)^3; a thin one's stretch may be 0.
    cancelled = 1e-14 * max(1.0, thickness) ** 4 / (young * width)
    for name, value in dataclasses.asdict(other).items():
        assert value == pytest.approx(getattr(expected, name), rel=1e-12, abs=cancelled if name[0] in "at" else 0.0), (
            name
        )


@given(SIZES)
def test_a_moment_is_a_moment_about_the_middle(neck: float) -> None:
    """Both ends are alike, so that the deflection per moment is half the length of the rotation; and K_s > 0."""
    found = notch.beam_integral(1.0, 1.0, notch.filleted_thickness(3.0, 1.0, neck), 3.0, 1.0, 2.0)
    assert found.cross / found.rotation == pytest.approx(1.5, rel=1e-9)  # quadrature
    assert found.sway_stiffness > 0


# --- stiffnesses, and shear


def test_a_leaf_has_the_stiffnesses_of_the_textbook_bridge() -> None:
    hinge = notch.leaf(YOUNG, WIDTH, THICKNESS, 4e-3)
    bridge = TextbookBridge.of_leaves(YOUNG, WIDTH, THICKNESS, 4e-3, 20e-3, 1e-3)
    assert hinge.rotational_stiffness == pytest.approx(bridge.rotational_stiffness, rel=1e-13)
    assert hinge.axial_stiffness == pytest.approx(bridge.axial_stiffness, rel=1e-13)
    assert hinge.sway_stiffness == pytest.approx(bridge.sway_stiffness, rel=1e-13)


def test_shear_is_its_own_integral() -> None:
    """(6/5) int dx / (G b t), by quadrature over the arc's angle."""
    poisson = 0.33
    shear_modulus = YOUNG / (2 * (1 + poisson))

    def per_angle(a: float) -> float:
        return RADIUS * math.cos(a) / (THICKNESS + 2 * RADIUS * (1 - math.cos(a)))

    sheared = 1.2 / (shear_modulus * WIDTH) * quad(per_angle, -math.pi / 2, math.pi / 2, epsrel=1e-12)[0]
    bent = notch.lobontiu_circular(YOUNG, WIDTH, THICKNESS, RADIUS)
    both = bent.with_shear(poisson)
    assert both.transverse - bent.transverse == pytest.approx(sheared, rel=1e-9)
    assert dataclasses.replace(both, transverse=bent.transverse) == bent


# --- what is refused


@pytest.mark.parametrize("value", [0.0, -1e-3, math.nan, math.inf])
@pytest.mark.parametrize("name", ["youngs_modulus", "width", "thickness", "length", "fillet"])
def test_refuses_what_is_not_positive(name: str, value: float) -> None:
    sizes = {"youngs_modulus": YOUNG, "width": WIDTH, "thickness": THICKNESS, "length": 4e-3, "fillet": 1e-3}
    with pytest.raises(ValueError, match=f"{name} must be positive"):
        notch.lobontiu_corner_filleted(**{**sizes, name: value})


def test_refuses_fillets_that_overlap_and_notches_deeper_than_their_radius() -> None:
    with pytest.raises(ValueError, match=r"fillet must be at most half the length 0\.004"):
        notch.lobontiu_corner_filleted(YOUNG, WIDTH, THICKNESS, 4e-3, 2.1e-3)
    with pytest.raises(ValueError, match="no deeper than its radius"):
        notch.paros_weisbord(YOUNG, WIDTH, THICKNESS, RADIUS, 5e-3)
    with pytest.raises(ValueError, match="block must be between thickness"):
        notch.paros_weisbord(YOUNG, WIDTH, THICKNESS, RADIUS, THICKNESS)
