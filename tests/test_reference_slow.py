"""FEM on tetrahedra against the independent solution on structured hexahedra (tests/reference)."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from flexdesign import study
from flexdesign.cache import Cache
from flexdesign.validation import Validation, validate

REFERENCE = tomllib.loads((Path(__file__).parent / "reference" / "converged.toml").read_text())
DESIGNS = ("bridge_amplifier", "lin2019_amplifier_xy")

#: What is asked of the engine: largest relative deviation from the converged reference.
ASKED = {
    "K_in_output_free": 2e-2,
    "K_out_input_free": 2e-2,
    "K_out_input_held": 2e-2,
    "lambda_output_free": 3e-3,
}

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=DESIGNS)
def found(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Validation]:
    cache = Cache(tmp_path_factory.mktemp("cache"))
    return request.param, validate(study.read(request.param), cache)


@pytest.mark.parametrize("key", ASKED)
def test_agrees_with_hexahedra(found: tuple[str, Validation], key: str) -> None:
    design, validation = found
    reference = REFERENCE[design][key]
    quantity = validation.fem(key)
    assert quantity.value == pytest.approx(reference["value"], rel=ASKED[key])


@pytest.mark.parametrize("key", ASKED)
def test_error_estimate_contains_the_difference(found: tuple[str, Validation], key: str) -> None:
    design, validation = found
    reference = REFERENCE[design][key]
    quantity = validation.fem(key)
    remaining = abs(reference["last_change"] * reference["value"])  # what the reference itself leaves open, at most
    assert abs(quantity.value - reference["value"]) <= quantity.sigma + remaining


def test_output_mode(found: tuple[str, Validation]) -> None:
    design, validation = found
    reference = REFERENCE[design]["frequency_1"][
        "value"
    ]  # with free inputs the first symmetric mode carries the output
    quantity = validation.fem("output_frequency_input_free")
    assert quantity.value == pytest.approx(reference, rel=1e-2)
    assert abs(quantity.value - reference) <= quantity.sigma + 1e-3 * reference
