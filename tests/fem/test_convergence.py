"""Extrapolation of sequences whose limit is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from flexdesign.fem.convergence import MESH_NOISE, SMOOTH, MeshNoise, extrapolate, observed_order
from flexdesign.fem.convergence import ORDERS as BRACKET

ORDERS = st.floats(0.8, 4.0)
LIMITS = st.floats(0.5, 2e6)
SIZES = st.sampled_from([(1.82, 1.35, 1.0), (4.0, 2.0, 1.0), (3.1, 1.7, 1.1), (2.0, 1.9, 1.0)])


def power_law(limit: float, share: float, order: float, sizes: tuple[float, ...]) -> list[float]:
    """Return limit (1 + share h^p)."""
    return [limit * (1 + share * size**order) for size in sizes]


@given(LIMITS, st.floats(-0.1, 0.1), ORDERS, SIZES)
def test_a_power_law_of_known_order_is_extrapolated_exactly(
    limit: float, share: float, order: float, sizes: tuple[float, ...]
) -> None:
    """Rounding of values near one another, magnified by at most 1 / ((1.7 / 1.1)^0.8 - 1) < 3 and by h^p < 256."""
    found = extrapolate(power_law(limit, share, order, sizes), sizes, (order, order))
    assert found.value == pytest.approx(limit, rel=1e-12)
    assert found.finest == pytest.approx(limit * (1 + share * sizes[-1] ** order), rel=1e-15)
    ratio = (sizes[-2] / sizes[-1]) ** order
    fine, coarse = ratio / (ratio - 1), 1 / (ratio - 1)
    scattered = MESH_NOISE.relative / 2 * limit * math.hypot(fine, coarse)  # value = fine f_fine - coarse f_coarse
    assert found.error == pytest.approx(scattered, rel=1e-6)  # nothing else is left to doubt


@given(LIMITS, st.floats(1e-3, 0.1), st.booleans(), ORDERS, SIZES)
def test_observed_order_is_that_of_the_power_law(
    limit: float, share: float, above: bool, order: float, sizes: tuple[float, ...]
) -> None:
    values = power_law(limit, share if above else -share, order, sizes)
    assert observed_order(values, sizes) == pytest.approx(order, rel=1e-6)  # shares of 1e-3 leave 13 digits


@given(LIMITS, st.floats(-0.1, 0.1), st.sampled_from([BRACKET, (2.0, 4.0)]), st.floats(0, 1), SIZES)
def test_error_bar_holds_the_truth_for_any_order_in_the_bracket(
    limit: float, share: float, orders: tuple[float, float], between: float, sizes: tuple[float, ...]
) -> None:
    """The two extrapolations lie on either side of the truth."""
    order = orders[0] + between * (orders[1] - orders[0])
    for count in (2, 3):
        found = extrapolate(power_law(limit, share, order, sizes)[-count:], sizes[-count:], orders)
        assert abs(found.value - limit) <= found.error * (1 + 1e-9)


@given(LIMITS, st.floats(1e-3, 0.1), st.booleans(), st.floats(BRACKET[1], SMOOTH), SIZES)
def test_error_bar_holds_the_truth_where_three_meshes_show_a_smooth_error(
    limit: float, share: float, above: bool, order: float, sizes: tuple[float, ...]
) -> None:
    """Above the bracket, where rounded roots leave little that is singular; two meshes cannot show it."""
    values = power_law(limit, share if above else -share, order, sizes)
    found = extrapolate(values, sizes, BRACKET)
    assert abs(found.value - limit) <= found.error
    scatter = MESH_NOISE.relative / 2 * abs(found.value)  # half the way between the two extrapolations, and no more
    low, high = (
        values[-1] + (values[-1] - values[-2]) / ((sizes[-2] / sizes[-1]) ** p - 1) for p in (BRACKET[0], order)
    )
    assert found.value == pytest.approx((low + high) / 2, rel=1e-6)
    assert found.error > scatter


def test_no_order_above_that_of_smooth_errors_is_believed() -> None:
    """A step that falls by 2^6 and another that falls by 2^4 are judged alike: the sizes halve."""
    steep, smooth = (extrapolate(power_law(1.0, 0.01, order, (4.0, 2.0, 1.0)), (4.0, 2.0, 1.0)) for order in (6.0, 4.0))
    assert steep.observed_order == pytest.approx(6.0)
    left = [(1 / (2 ** BRACKET[0] - 1) + 1 / (2**SMOOTH - 1)) / 2 * 0.01 * (2**order - 1) for order in (6.0, 4.0)]
    for found, order, beyond in zip((steep, smooth), (6.0, 4.0), left, strict=True):
        assert found.value == pytest.approx(1 + 0.01 - beyond, rel=1e-9), order


@given(LIMITS, st.floats(0.0, 0.1), st.floats(0.0, 0.05), SIZES)
def test_error_bar_holds_the_truth_for_a_mixture_of_orders(
    limit: float, singular: float, smooth: float, sizes: tuple[float, ...]
) -> None:
    """A singular and a smooth error of the same sign: what sharp roots show before the end."""
    values = [limit * (1 + singular * h ** BRACKET[0] + smooth * h ** BRACKET[1]) for h in sizes]
    found = extrapolate(values, sizes, BRACKET)
    assert abs(found.value - limit) <= found.error * (1 + 1e-9)


@pytest.mark.parametrize("shares", [(0.0, 0.005), (0.005, 0.05)], ids=["scatter rules", "mesh rules"])
def test_error_bar_holds_the_truth_for_noisy_sequences(shares: tuple[float, float]) -> None:
    """A mesher that scatters values over `MESH_NOISE`, half of it either way, on the program's own sequence of meshes.

    Extrapolation magnifies that: by 2.9 for the finest mesh and 1.9 for the one before, 0.48 % in the worst case. A
    half-width within which the truth is expected holds it nine times in ten.
    """
    rng = np.random.default_rng(7)
    sizes = (1.35**2, 1.35, 1.0)
    held = 0
    for _ in range(1000):
        values = np.array(power_law(1.0, rng.uniform(*shares), rng.uniform(*BRACKET), sizes))
        found = extrapolate((values * (1 + MESH_NOISE.relative / 2 * rng.uniform(-1, 1, 3))).tolist(), sizes, BRACKET)
        held += abs(found.value - 1.0) <= found.error
    assert held >= 900


@pytest.mark.parametrize("count", [2, 3])
def test_error_bar_holds_the_truth_where_meshes_are_irregular(count: int) -> None:
    """Each mesh leaves open a quarter more or less than the law says, as with few triangles about a root.

    The bracket's ends come as often as its middle here, which is harder than what parts show: nine times in ten.
    """
    rng = np.random.default_rng(11)
    sizes = (1.35**4, 1.35**2, 1.0)[-count:]
    scatter, ratios = MeshNoise(1e-4, 0.25), []
    for _ in range(1000):
        order = rng.uniform(*BRACKET)
        values = [1 + 0.005 * size**order * (1 + 0.25 * rng.uniform(-1, 1)) for size in sizes]
        found = extrapolate(values, sizes, BRACKET, scatter)
        ratios.append(abs(found.value - 1.0) / found.error)
    assert np.mean(np.array(ratios) <= 1) >= 0.9
    assert np.sqrt(np.mean(np.square(ratios))) > 0.3  # and the bar is no longer than it must be


def test_error_bar_of_a_ratio_knows_of_what_cancels() -> None:
    """Two meshes that agree by chance say nothing; a quarter of the 2 % and 1 % beside them does: sizes 2 and 1."""
    scatter = MeshNoise(0.0, 0.25)
    assert extrapolate([3.0, 3.0], [2.0, 1.0], (1.0, 1.0), scatter).error == 0.0
    found = extrapolate([3.0, 3.0], [2.0, 1.0], (1.0, 1.0), scatter, remaining_errors=[0.02, 0.01])
    assert found.error == pytest.approx(3 * 0.25 * math.hypot(2 * 0.01, 0.02))  # value = 2 f_fine - f_coarse


def test_two_meshes_give_no_observed_order() -> None:
    found = extrapolate([1.1, 1.05], [2.0, 1.0], BRACKET)
    assert math.isnan(found.observed_order)
    assert found.value < 1.05  # it goes on falling


@pytest.mark.parametrize(
    "values",
    [(1.0, 1.2, 1.1), (1.2, 1.0, 1.1), (1.0, 1.0, 1.1), (1.1, 1.0, 1.0), (1.1, 1.05, 0.9)],
    ids=["up and down", "down and up", "stuck first", "stuck last", "diverging"],
)
def test_no_order_where_the_sequence_has_none(values: tuple[float, float, float]) -> None:
    assert math.isnan(observed_order(values, (2.0, 1.5, 1.0)))


def test_a_jumping_sequence_gets_a_wide_bar() -> None:
    """The extrapolations of the two pairs contradict one another; the bar is no smaller than a quarter of that."""
    sizes = (4.0, 2.0, 1.0)
    found = extrapolate([1.0, 1.2, 1.1], sizes, (1.0, 1.0))
    assert found.value == pytest.approx(1.0)
    scattered = MESH_NOISE.relative / 2 * math.hypot(2, 1)  # value = 2 f_fine - f_coarse
    assert found.error == pytest.approx(math.hypot(0.4 / 4, scattered))  # 1.2 + 0.2 against 1.1 - 0.1


def test_grid_convergence_index_is_roache_s() -> None:
    """Roache (1994): 1.25 |f2 - f1| / (f1 (r^p - 1)), here with r = 2, p = 1: 1.25 * 0.1 / 1.1."""
    found = extrapolate([1.2, 1.1], [2.0, 1.0], (1.0, 2.0))
    assert found.gci == pytest.approx(1.25 * 0.1 / 1.1, rel=1e-12)


def test_the_sharp_root_s_exponent_is_williams_s() -> None:
    """Williams (1952): sin(s alpha) = -s sin(alpha) in opening, alpha = 270 degrees of solid; lowest root."""
    alpha = 1.5 * math.pi
    exponent = brentq(lambda s: math.sin(s * alpha) + s * math.sin(alpha), 0.4, 0.7, xtol=1e-14)
    assert BRACKET[0] == pytest.approx(2 * exponent, rel=1e-6)
    assert 1 / 3 < exponent < 2 / 3
