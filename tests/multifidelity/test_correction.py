"""The planar model's correction against laws that it must find exactly, and against solids."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import qmc

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design import design
from flexdesign.design.design import Design
from flexdesign.design.study import MeshSettings
from flexdesign.fem import analysis
from flexdesign.fem.multifidelity import Correction, Planar, extrusion
from flexdesign.fem.quantities import of_compliance

MIDDLE = design.read(design.find("lin2019_amplifier_xy"))
VARIED = ("hinge_thickness", "arm_span", "width")


@dataclass
class Law:
    """An evaluator that knows a formula."""

    of: Callable[[dict[str, float]], float]
    sigma: float | None = None

    def evaluate(self, given: Design) -> list[Quantity]:
        return [Quantity("K_in", self.of(dict(given.dimensions)), "N/m", "N/mm", "output free", half_width=self.sigma)]


def designs(count: int, seed: int = 0, within: float = 0.3) -> list[Design]:
    rows = qmc.LatinHypercube(len(VARIED), rng=np.random.default_rng(seed)).random(count)
    return [scaled(dict(zip(VARIED, 1 + within * (2 * row - 1), strict=True))) for row in rows]


def scaled(scales: dict[str, float]) -> Design:
    changes = {name: MIDDLE.dimensions[name] * scale for name, scale in scales.items()}
    return replace(MIDDLE, dimensions={**MIDDLE.dimensions, **changes})


def flat(d: dict[str, float]) -> float:
    return 1e12 * d["hinge_thickness"] ** 2.5 * d["width"]


def power(d: dict[str, float]) -> float:
    return flat(d) * 1.1 * (d["hinge_thickness"] / d["width"]) ** 0.2 * d["arm_span"] ** -0.1


def curved(d: dict[str, float]) -> float:
    x, y = np.log(d["hinge_thickness"] / 4e-4), np.log(d["width"] / 1e-2)
    return float(flat(d) * np.exp(0.03 + 0.1 * x * y - 0.2 * y**2 + 0.05 * x))


def value(correction: Correction, given: Design) -> Quantity:
    return correction.apply(given, Law(flat).evaluate(given))[0]


@pytest.mark.parametrize(("law", "count", "order"), [(power, 5, 1), (power, 20, 2), (curved, 20, 2)])
def test_laws_of_its_order_are_found(law: Callable[[dict[str, float]], float], count: int, order: int) -> None:
    found = Correction.fit(designs(count), Law(flat), Law(law))
    assert found.order == order and set(found.names) == set(VARIED)
    for given in designs(5, seed=1, within=0.2):
        assert value(found, given).value == pytest.approx(law(dict(given.dimensions)), rel=1e-9)
    assert found.errors["K_in_output_free"] < 1e-9


def test_few_samples_give_the_mean() -> None:
    few = designs(3)
    found = Correction.fit(few, Law(flat), Law(power))
    ratios = [power(dict(d.dimensions)) / flat(dict(d.dimensions)) for d in few]
    assert found.order == 0
    assert value(found, few[0]).value == pytest.approx(
        flat(dict(few[0].dimensions)) * np.exp(np.mean(np.log(ratios))), rel=1e-12
    )


def test_the_error_is_what_fits_without_each_sample_miss_it_by() -> None:
    """Against fits that were really made without; Allen's formula is exact where the terms stay the same."""
    given = designs(8)
    found = Correction.fit(given, Law(flat), Law(curved))
    assert found.order == 1
    missed = []
    for index, left in enumerate(given):
        others = Correction.fit(given[:index] + given[index + 1 :], Law(flat), Law(curved))
        missed.append(np.log(value(others, left).value / curved(dict(left.dimensions))))
    assert found.errors["K_in_output_free"] == pytest.approx(2 * np.sqrt(np.mean(np.square(missed))), rel=1e-9)


def test_a_single_sample_puts_all_of_the_correction_in_doubt() -> None:
    found = Correction.fit([MIDDLE], Law(flat), Law(power))
    ratio = power(dict(MIDDLE.dimensions)) / flat(dict(MIDDLE.dimensions))
    assert value(found, MIDDLE).value == pytest.approx(power(dict(MIDDLE.dimensions)))
    assert found.errors["K_in_output_free"] == pytest.approx(2 * abs(np.log(ratio)))


def test_the_solids_own_errors_are_carried_along() -> None:
    given = designs(6)
    truth = Law(power, sigma=0.01 * power(dict(given[0].dimensions)))
    shares = [0.01 * power(dict(given[0].dimensions)) / power(dict(d.dimensions)) for d in given]
    found = Correction.fit(given, Law(flat), truth)
    assert found.errors["K_in_output_free"] == pytest.approx(np.sqrt(np.mean(np.square(shares))), rel=1e-6)


def test_outside_of_the_samples_the_error_grows() -> None:
    found = Correction.fit(designs(12), Law(flat), Law(curved))
    inside, outside = (value(found, scaled({"width": scale})) for scale in (1.1, 1.8))
    assert inside.half_width is not None and outside.half_width is not None
    assert inside.half_width / inside.value == pytest.approx(found.errors["K_in_output_free"])
    assert outside.half_width / outside.value > 3 * inside.half_width / inside.value


@pytest.mark.parametrize(
    ("given", "law", "remedy"),
    [
        ([], power, "no samples"),
        ([MIDDLE], lambda d: -power(d), "another sign"),
        ([MIDDLE, scaled({"arm_offset": -1.0})], power, "changes its sign"),
    ],
)
def test_what_cannot_be_fitted_is_refused(
    given: list[Design], law: Callable[[dict[str, float]], float], remedy: str
) -> None:
    with pytest.raises(InputError, match=remedy):
        Correction.fit(given, Law(flat), Law(law))


@dataclass
class Direct:
    """Solid FEM by the full engine on one mesh, made anew."""

    coarseness: float

    def evaluate(self, given: Design) -> list[Quantity]:
        part, body = extrusion.of_design(given)
        mesh = extrusion.method(part, body, MeshSettings()).mesh(self.coarseness)
        solution = analysis.solve(part, given.material, body, mesh, all_classes=False)
        return of_compliance(solution.compliance, given.actuator)


@pytest.mark.slow
def test_a_corrected_plate_is_within_two_percent_of_solids() -> None:
    """Eight solids; those here scatter by half a percent themselves, as their meshes are made anew."""
    planar, direct = Planar(), Direct(2.0)
    found = Correction.fit(designs(8), planar, direct)
    for given in designs(4, seed=5):
        truth = {q.key: q.value for q in direct.evaluate(given)}
        for quantity in found.apply(given, planar.evaluate(given)):
            assert quantity.value == pytest.approx(truth[quantity.key], rel=0.02), quantity.key


def test_a_plate_is_near_the_solid_and_keeps_its_keys() -> None:
    """Plane strain would be 1 / (1 - nu^2) = 1.14 times as stiff; leaves half as long as wide lie in between."""
    flat_ones, solids = Planar().evaluate(MIDDLE), Direct(2.46).evaluate(MIDDLE)
    assert [q.key for q in flat_ones] == [q.key for q in solids]
    for one, other in zip(flat_ones, solids, strict=True):
        assert one.value == pytest.approx(other.value, rel=0.14), one.key


def test_planar_answers_are_smooth_and_do_not_depend_on_the_order() -> None:
    """Fourth differences of ln K_in over ln t: 6e-3 on meshes made anew, as those of `studies.benchmarks` show."""
    thicknesses = np.geomspace(0.8, 1.2, 9)
    planar = Planar()
    planar.evaluate(MIDDLE)
    stiffness = [planar.evaluate(scaled({"hinge_thickness": s}))[0].value for s in thicknesses]
    assert np.abs(np.diff(np.log(stiffness), 4)).max() < 1e-4
    assert len(planar.patterns) == 1
    again = [planar.evaluate(scaled({"hinge_thickness": s}))[0].value for s in thicknesses[::-1]]
    assert again[::-1] == pytest.approx(stiffness, rel=1e-9)
