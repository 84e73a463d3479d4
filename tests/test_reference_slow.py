"""FEM on tetrahedra, meshed both ways, against the independent solution on structured hexahedra (tests/reference)."""

from __future__ import annotations

import math
import tomllib
from functools import cache
from pathlib import Path

import pytest

from flexdesign.core.result_cache import Cache
from flexdesign.design import study
from flexdesign.workflows.validation import Validation, validate

REFERENCE = tomllib.loads((Path(__file__).parent / "reference" / "converged.toml").read_text())
DESIGNS = ("bridge_amplifier", "lin2019_amplifier_xy")
METHODS = ("wild", "extruded")

#: What is asked of the engine: largest relative deviation from the converged reference, by method.
ASKED = {
    "K_in_output_free": {"wild": 2e-2, "extruded": 3e-3},
    "K_out_input_free": {"wild": 2e-2, "extruded": 3e-3},
    "K_out_input_held": {"wild": 2e-2, "extruded": 3e-3},
    "lambda_output_free": {"wild": 3e-3, "extruded": 5e-4},
}

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@cache
def solved(design: str, method: str, store: Cache) -> Validation:
    return validate(study.read(design, [f"mesh.method={method}"]), store)


@pytest.fixture(params=[(design, method) for design in DESIGNS for method in METHODS], ids="-".join)
def found(request: pytest.FixtureRequest, store: Cache) -> tuple[str, str, Validation]:
    design, method = request.param
    return design, method, solved(design, method, store)


def left_open(design: str, key: str) -> float:
    """Return what the reference itself leaves open, at most."""
    return abs(float(REFERENCE[design][key]["last_change"] * REFERENCE[design][key]["value"]))


@pytest.mark.parametrize("key", ASKED)
def test_agrees_with_hexahedra(found: tuple[str, str, Validation], key: str) -> None:
    design, method, validation = found
    assert validation.method.name == method
    assert validation.fem(key).value == pytest.approx(REFERENCE[design][key]["value"], rel=ASKED[key][method])


@pytest.mark.parametrize("key", ASKED)
def test_error_estimate_contains_the_difference(found: tuple[str, str, Validation], key: str) -> None:
    design, _, validation = found
    quantity = validation.fem(key)
    assert quantity.half_width is not None
    assert abs(quantity.value - REFERENCE[design][key]["value"]) <= quantity.half_width + left_open(design, key)


@pytest.mark.parametrize("key", ASKED)
@pytest.mark.parametrize("design", DESIGNS)
def test_both_methods_agree_within_their_estimates(store: Cache, design: str, key: str) -> None:
    wild, extruded = (solved(design, method, store).fem(key) for method in METHODS)
    assert wild.half_width and extruded.half_width
    assert abs(wild.value - extruded.value) <= math.hypot(wild.half_width, extruded.half_width)


@pytest.mark.parametrize("design", DESIGNS)
def test_finest_extruded_mesh_is_within_half_a_percent(store: Cache, design: str) -> None:
    """Before any extrapolation, and with fewer unknowns than the finest wild mesh needs for more than that."""
    wild, extruded = (solved(design, method, store).finest.solution for method in METHODS)
    reference = REFERENCE[design]["K_in_output_free"]["value"]
    assert extruded.compliance.input_stiffness == pytest.approx(reference, rel=5e-3)
    assert extruded.facts["unknowns"] < wild.facts["unknowns"]
    assert abs(extruded.compliance.input_stiffness - reference) < abs(wild.compliance.input_stiffness - reference)


def test_output_mode(found: tuple[str, str, Validation]) -> None:
    design, _, validation = found
    reference = REFERENCE[design]["frequency_1"][
        "value"
    ]  # with free inputs the first symmetric mode carries the output
    quantity = validation.fem("output_frequency_input_free")
    assert quantity.value == pytest.approx(reference, rel=1e-2)
    assert abs(quantity.value - reference) <= quantity.half_width + 1e-3 * reference
