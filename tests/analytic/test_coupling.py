"""The shortening of a chain against exact arithmetic, its approximation by order, and its inverse."""

from __future__ import annotations

import itertools
import math
from decimal import Decimal, localcontext

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexdesign.analytic import coupling

LENGTHS = st.floats(1e-3, 1.0)
#: Travel over length, down to where 1 - cos(beta), as written, would be nothing but rounding.
SLOPES = st.floats(math.log(1e-9), math.log(0.99)).map(math.exp)


def exact(length: float, travel: float) -> float:
    """L - sqrt(L^2 - travel^2) by Pythagoras, with 60 digits."""
    with localcontext() as context:
        context.prec = 60
        a, b = Decimal(length), Decimal(travel)
        return float(a - (a * a - b * b).sqrt())


@given(LENGTHS, SLOPES, st.sampled_from([-1, 1]))
def test_shortening_is_pythagoras_to_the_last_digits(length: float, slope: float, sign: int) -> None:
    travel = sign * slope * length
    # The sine's inverse loses digits towards the right angle: its slope there, 1/sqrt(1 - 0.99^2), is 7.
    assert coupling.shortening(length, travel) == pytest.approx(exact(length, travel), rel=1e-14)
    assert coupling.shortening(length, -travel) == coupling.shortening(length, travel)
    assert coupling.chain_rotation(length, travel) == -coupling.chain_rotation(length, -travel)


def test_a_chain_turned_by_a_right_angle_shortens_by_its_length() -> None:
    assert coupling.chain_rotation(0.05, 0.05) == pytest.approx(math.pi / 2)
    assert coupling.shortening(0.05, 0.05) == pytest.approx(0.05)
    assert coupling.coupling_ratio(0.05, 0.05) == pytest.approx(1.0)


def test_the_approximation_is_wrong_by_the_fourth_order() -> None:
    """L (1 - sqrt(1 - s^2)) = L (s^2/2 + s^4/8 + ...): halving the travel leaves a sixteenth of the error."""
    errors = [exact(1.0, s) - coupling.shortening_approximate(1.0, s) for s in (0.1, 0.05, 0.025)]
    assert errors[0] == pytest.approx(0.1**4 / 8, rel=0.01)  # the next term is s^6/16: 0.5 % of this one
    orders = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert orders == pytest.approx([4, 4], abs=0.01)


@given(LENGTHS, SLOPES)
def test_length_and_ratio_are_inverse(length: float, slope: float) -> None:
    travel = slope * length
    ratio = coupling.coupling_ratio(length, travel)
    assert coupling.chain_length(ratio, travel) == pytest.approx(length, rel=1e-13)
    assert coupling.chain_length(ratio, -travel) == coupling.chain_length(ratio, travel)


def test_the_ratio_grows_with_the_travel() -> None:
    ratios = [coupling.coupling_ratio(0.0455, travel) for travel in (0.0, 20e-6, 40e-6, 80e-6)]
    assert ratios[0] == 0.0
    assert ratios[2] / ratios[1] == pytest.approx(2, rel=1e-6)
    assert ratios[3] / ratios[2] == pytest.approx(2, rel=1e-6)


def test_the_paper_s_ratios_give_its_lengths_either_way() -> None:
    # 20 um of input at lambda = 4.046; ratios of Table 1. (25) and the exact geometry agree in all digits shown.
    travel = 20e-6 * 4.046
    for ratio, length in ((0.089e-2, 45.5e-3), (0.045e-2, 89.9e-3)):
        assert abs(coupling.chain_length(ratio, travel) - length) <= 0.05e-3
        assert abs(travel / (2 * ratio) - length) <= 0.05e-3


@pytest.mark.parametrize("length", [0.0, -0.1, math.nan, math.inf])
def test_a_chain_has_a_length(length: float) -> None:
    with pytest.raises(ValueError, match="length of a chain"):
        coupling.shortening(length, 1e-6)


@pytest.mark.parametrize("travel", [0.051, -0.051, math.nan])
def test_a_chain_cannot_follow_farther_than_it_is_long(travel: float) -> None:
    with pytest.raises(ValueError, match="cannot follow"):
        coupling.coupling_ratio(0.05, travel)


@pytest.mark.parametrize("ratio", [0.0, -0.001, 1.001, math.nan])
def test_a_ratio_lies_between_zero_and_one(ratio: float) -> None:
    with pytest.raises(ValueError, match="more than 0 and at most 1"):
        coupling.chain_length(ratio, 80e-6)


@pytest.mark.parametrize("travel", [0.0, math.nan, math.inf])
def test_a_ratio_holds_at_a_travel(travel: float) -> None:
    with pytest.raises(ValueError, match="travel"):
        coupling.chain_length(1e-3, travel)
