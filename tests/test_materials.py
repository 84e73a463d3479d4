"""The material library, materials of a user's own, and the command that shows them."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexdesign.core.errors import InputError
from flexdesign.design import materials
from flexdesign.design.materials import Crystal, Fatigue
from flexdesign.design.materials.crystal import WAFER, engineering, isotropic, matrix
from flexdesign.report import strength_text
from tests.conftest import Ended

LIBRARY = materials.library()
HERE = Path("design.toml")
OWN = {
    "name": "mine", "youngs_modulus": "70 GPa", "poissons_ratio": 0.33, "density": "2700 kg/m^3",
    "yield_strength": "300 MPa",
}  # fmt: skip
TESTED = {"strength": "100 MPa", "cycles": 1e7, "stress_ratio": -1}
SILICON = LIBRARY["Si"]
# Inverting a well-conditioned 6 by 6 matrix in double precision.
ROUNDING = 1e-12


def silicon(**orientation: object) -> Crystal:
    crystal = materials.find({"like": "Si", **orientation}, HERE).crystal
    assert crystal is not None
    return crystal


def poisson(crystal: Crystal, across: int) -> float:
    return engineering(crystal.tensor, np.eye(3)[0], np.eye(3)[across])[1]


# --- the library --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "modulus", "density"),
    [
        # ASM Handbook vol. 1 and 2 (1990), rounded: another compilation than those the library cites.
        ("Al 6061-T6", 69e9, 2700.0),
        ("Steel 17-4PH H900", 196e9, 7800.0),
        ("Invar 36", 144e9, 8050.0),
        ("CuBe C17200 TH04", 128e9, 8250.0),
        ("Steel C75S hardened", 205e9, 7850.0),
    ],
)
def test_metals_of_flexures_are_there(name: str, modulus: float, density: float) -> None:
    """Handbooks differ by 3 % in the modulus of such alloys, and by 1.5 % in density, which ageing changes."""
    assert LIBRARY[name].youngs_modulus == pytest.approx(modulus, rel=0.03)
    assert LIBRARY[name].density == pytest.approx(density, rel=0.015)


@pytest.mark.parametrize(
    "name", ["Al 6061-T6", "Steel 17-4PH H900", "Invar 36", "CuBe C17200 TH04", "Steel C75S hardened"]
)
def test_metals_of_flexures_name_the_source_of_each_number(name: str) -> None:
    """Standards state some of them and makers others, so that one source for all would be wrong."""
    numbers = ("youngs_modulus", "poissons_ratio", "density", "yield_strength", "ultimate_strength")
    assert set(numbers) <= set(LIBRARY[name].sources)


@pytest.mark.parametrize(
    ("name", "key", "pounds", "factor"),
    [
        ("Al 6061-T6", "density", 0.0975, 27679.905),
        ("Steel 17-4PH H900", "density", 0.282, 27679.905),
        ("Invar 36", "density", 0.291, 27679.905),
        ("CuBe C17200 TH04", "density", 0.302, 27679.905),
        ("Al 6061-T6", "yield_strength", 40e3, 6894.757),
        ("Al 6061-T6", "ultimate_strength", 45e3, 6894.757),
        ("Steel 17-4PH H900", "yield_strength", 170e3, 6894.757),
        ("Steel 17-4PH H900", "ultimate_strength", 190e3, 6894.757),
        ("CuBe C17200 TH04", "yield_strength", 165e3, 6894.757),
        ("CuBe C17200 TH04", "ultimate_strength", 190e3, 6894.757),
        ("Invar 36", "youngs_modulus", 20.5e6, 6894.757),
        ("CuBe C17200 TH04", "youngs_modulus", 19e6, 6894.757),
        ("Steel 17-4PH H900", "youngs_modulus", 28.5e6, 6894.757),
    ],
)
def test_numbers_are_those_that_data_sheets_have_in_pounds_and_inches(
    name: str, key: str, pounds: float, factor: float
) -> None:
    """Three digits are rounded, by 0.5 % at most."""
    assert getattr(LIBRARY[name], key) == pytest.approx(pounds * factor, rel=5e-3)


@pytest.mark.parametrize("name", LIBRARY)
def test_every_number_has_a_source_and_is_possible(name: str) -> None:
    material = LIBRARY[name]
    assert material.source and material.note
    assert 1e10 < material.youngs_modulus < 5e11 and 0 < material.poissons_ratio < 0.5
    assert 1e3 < material.density < 2e4
    if material.yield_strength is not None:
        assert material.ultimate_strength is not None and material.yield_strength < material.ultimate_strength
    if material.fatigue is not None:
        assert material.fatigue.source and material.fatigue.specimen
        assert material.ultimate_strength is not None and material.fatigue.strength < 0.6 * material.ultimate_strength


def test_steel_4340_stands_what_basquin_s_law_with_dowling_s_constants_says() -> None:
    """sigma_a = 1758 MPa (2 N)^-0.0977; the library holds three digits of it."""
    fatigue = LIBRARY["Steel AISI 4340"].fatigue
    assert fatigue is not None
    assert fatigue.strength == pytest.approx(1758e6 * (2 * fatigue.cycles) ** -0.0977, rel=1e-3)


# --- crystals -----------------------------------------------------------------------------------------------------


def test_silicon_has_the_published_moduli() -> None:
    """Hopcroft, Nix and Kenny (2010), table I: constants of other rounding (165.7, 63.9, 79.6) give these digits."""
    assert SILICON.crystal is not None
    moduli = [SILICON.crystal.along(d) / 1e9 for d in ((1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0))]
    assert moduli == pytest.approx([130, 169, 188], abs=0.5)
    straight, diagonal = silicon(orientation="<100>"), silicon(orientation="<110>")
    assert poisson(straight, 1) == pytest.approx(0.28, abs=0.005)
    assert poisson(diagonal, 1) == pytest.approx(0.064, abs=0.002)
    assert poisson(diagonal, 2) == pytest.approx(0.36, abs=0.005)
    assert SILICON.youngs_modulus / 1e9 == pytest.approx(169, abs=0.5)
    assert SILICON.shear_modulus / 1e9 == pytest.approx(50.9, abs=0.1)  # in the wafer's plane
    assert SILICON.beam_moduli((0.0, 1.0, 0.0)) == pytest.approx(SILICON.beam_moduli((1.0, 0.0, 0.0)), rel=ROUNDING)


def test_the_modulus_along_a_direction_is_that_of_the_compliance() -> None:
    """A closed formula beside the inverse of the rotated stiffness, for a general direction."""
    crystal = silicon(orientation={"x": [3, 1, 2], "z": [-2, 0, 3]})
    young, _, _ = engineering(crystal.tensor, np.eye(3)[0], np.eye(3)[1])
    assert young == pytest.approx(crystal.along((3.0, 1.0, 2.0)), rel=ROUNDING)


def test_the_tensor_is_the_crystal_s_own_rotated() -> None:
    """Four direction cosines on the tensor of the crystal's axes, component by component."""
    crystal = silicon(orientation={"x": [1, 2, 3], "z": [3, 0, -1], "turn": "20 deg"})
    own = np.zeros((3, 3, 3, 3))
    for i in range(3):
        for j in range(3):
            own[i, i, j, j] += crystal.c11 if i == j else crystal.c12
            if i != j:
                own[i, j, i, j] += crystal.c44
                own[i, j, j, i] += crystal.c44
    a = crystal.cosines
    np.testing.assert_allclose(a @ a.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(a) == pytest.approx(1.0, rel=ROUNDING)
    expected = np.einsum("ip,jq,kr,ls,pqrs->ijkl", a, a, a, a, own)
    np.testing.assert_allclose(crystal.tensor, expected, atol=ROUNDING * crystal.c11)


def test_an_eighth_of_a_turn_takes_one_wafer_direction_to_the_other() -> None:
    turned = silicon(orientation={"x": [1, 0, 0], "z": [0, 0, 1], "turn": "45 deg"})
    np.testing.assert_allclose(turned.tensor, silicon(orientation="<110>").tensor, atol=1e-3)  # of 1e11 Pa


@given(st.floats(1e9, 3e11), st.floats(0.0, 0.45))
def test_a_crystal_without_anisotropy_is_an_isotropic_body(young: float, nu: float) -> None:
    """However it lies, and with the engineering constants it was made of."""
    mu = young / (2 * (1 + nu))
    lam = 2 * mu * nu / (1 - 2 * nu)
    crystal = Crystal(lam + 2 * mu, lam, mu, WAFER["<110>"])
    np.testing.assert_allclose(crystal.tensor, isotropic(lam, mu), atol=1e-9 * young)
    assert engineering(crystal.tensor, np.eye(3)[0], np.eye(3)[2]) == pytest.approx((young, nu, mu), rel=1e-9, abs=1e-9)
    assert crystal.anisotropy == pytest.approx(1.0)


def test_voigt_s_matrix_of_a_cubic_crystal_in_its_axes() -> None:
    found = matrix(silicon(orientation="<100>").tensor) / 1e9
    expected = np.diag([165.64 - 63.94] * 3 + [79.51] * 3)
    expected[:3, :3] += 63.94
    np.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=1e-9)


def test_a_crystal_mirrors_in_its_own_planes_alone() -> None:
    wafer = materials.find({"like": "Si", "orientation": "<110>"}, HERE)
    askew = materials.find({"like": "Si", "orientation": {"x": [1, 0, 0], "z": [0, 0, 1], "turn": "10 deg"}}, HERE)
    assert [wafer.mirrors_in(axis) for axis in range(3)] == [True, True, True]
    assert [askew.mirrors_in(axis) for axis in range(3)] == [False, False, True]
    assert LIBRARY["AZ31B"].mirrors_in(0)
    with pytest.raises(TypeError, match="no Lamé constants"):
        _ = wafer.lame


# --- fatigue ------------------------------------------------------------------------------------------------------


@given(st.floats(-1.0, 0.5), st.floats(0.05, 0.2))
def test_what_was_tested_has_no_margin(ratio: float, share: float) -> None:
    """At the amplitude and the mean of the test the margin is 1, whatever the line."""
    fatigue = Fatigue.model_validate({**TESTED, "stress_ratio": ratio, "strength": f"{share * 1000} MPa"})
    assert fatigue.margin(fatigue.strength, fatigue.tested_mean, 1e9) == pytest.approx(1.0, rel=1e-12)
    flat = fatigue.model_copy(update={"mean_stress_sensitivity": 0.3})
    assert flat.margin(fatigue.strength, fatigue.tested_mean, None) == pytest.approx(1.0, rel=1e-12)


def test_goodman_s_line_ends_at_the_tensile_strength() -> None:
    """1/n = a/S + m/R_m for data at full reversal; a pulsating stress of amplitude and mean alike among them."""
    fatigue = Fatigue.model_validate(TESTED)
    assert fatigue.margin(0.0, 400e6, 400e6) == pytest.approx(1.0)
    assert 1 / fatigue.margin(40e6, 40e6, 400e6) == pytest.approx(40 / 100 + 40 / 400)
    assert fatigue.margin(50e6, -80e6, 400e6) == pytest.approx(2.0)  # compression is not counted on
    assert LIBRARY["Si"].fatigue_margin(1e6, 1e6) is None


def test_the_report_says_what_is_known_and_what_is_not() -> None:
    static, fatigue = strength_text.strengths(LIBRARY["Al 7075-T6"])
    assert "503 MPa (ASM Handbook" in static
    assert "amplitude 159 MPa at 5 x 10^8 cycles, stress ratio -1" in fatigue and "tensile strength, 572 MPa" in fatigue
    static, fatigue = strength_text.strengths(SILICON)
    assert "No yield strength of Si is known" in static and "breaks without yielding" in static
    assert "No fatigue data of Si are known" in fatigue
    sensitive = Fatigue.model_validate({**TESTED, "mean_stress_sensitivity": 0.25})
    told = strength_text.strengths(dataclasses.replace(LIBRARY["AZ31B"], fatigue=sensitive))[1]
    assert "a mean stress takes 0.25 of itself from that" in told


# --- a material of one's own --------------------------------------------------------------------------------------


def test_a_file_holds_a_material(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    lines = [f"{key} = {json.dumps(value)}" for key, value in OWN.items()]
    file.write_text("\n".join(["format = 1", *lines, "[sources]", 'density = "weighed"']), encoding="utf-8")
    found = materials.find("mine.toml", tmp_path / "design.toml")
    assert (found.name, found.youngs_modulus, found.sources["density"]) == ("mine", 70e9, "weighed")
    file.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match="write format = 1"):
        materials.read(file)


def test_a_table_may_take_the_rest_from_the_library() -> None:
    found = materials.find({"like": "AZ31B", "youngs_modulus": "44 GPa"}, HERE)
    assert found.name == "AZ31B, changed"
    assert (found.youngs_modulus, found.density) == (44e9, LIBRARY["AZ31B"].density)
    assert "youngs_modulus" not in found.sources and "density" in found.sources  # the library's source is not its own


@pytest.mark.parametrize(
    ("given", "field", "words"),
    [
        ("Al 7075", "material", "did you mean Al 7075-T6?"),
        (7075, "material", "expected a name"),
        ({"like": "Silicon"}, "material.like", "is not in the library"),
        ({"like": 4}, "material.like", "expected a name of the library"),
        ({"like": "Si", "orientation": "<111>"}, "material.orientation", 'write "<100>" or "<110>"'),
        ({"like": "Si", "orientation": {"x": [1, 0, 0]}}, "material.orientation", 'write "<100>" or "<110>"'),
        ({"like": "Si", "orientation": {"x": [1, 1, 0], "z": [1, 0, 0]}}, "material.orientation", "at right angles"),
        ({"like": "Si", "orientation": {"x": [0, 0, 0], "z": [0, 0, 1]}}, "material.orientation", "three indices"),
        ({"like": "Si", "orientation": {"x": [1, True, 0], "z": [0, 0, 1]}}, "material.orientation", "three indices"),
        (
            {"like": "Si", "orientation": {"x": [1, 0, 0], "z": [0, 0, 1], "turn": "3 mm"}},
            "material.orientation",
            "not a unit of angle",
        ),
        ({"like": "Si", "c11": "50 GPa"}, "material", "c11 must exceed c12"),
        ({**OWN, "sources": {"colour": "grey"}}, "material", "a number that is not there"),
        ({**OWN, "fatigue": TESTED}, "material", "ultimate_strength (Goodman)"),
        ({**OWN, "fatigue": {**TESTED, "cycles": 10}}, "material.fatigue.cycles", "allowed: 1000"),
        ({**OWN, "fatigue": {**TESTED, "strength": "1 mm"}}, "material.fatigue.strength", "not a unit of stress"),
    ],
)
def test_what_is_no_material_is_refused(given: object, field: str, words: str) -> None:
    with pytest.raises(InputError) as refusal:
        materials.find(given, HERE)
    assert refusal.value.field == field
    assert words in str(refusal.value)


# --- the command --------------------------------------------------------------------------------------------------


def test_the_command_lists_the_library(command_line: Callable[..., Ended], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    ended = command_line("materials")
    assert (ended.code, ended.stderr) == (0, "")
    assert all(name in ended.stdout for name in LIBRARY)
    assert "71.70 GPa" in ended.stdout and "5 x 10^8" in ended.stdout


@pytest.mark.parametrize("name", LIBRARY)
def test_the_command_shows_one_with_units_and_sources(
    name: str, command_line: Callable[..., Ended], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    ended = command_line("materials", name)
    assert ended.code == 0
    for source in (*LIBRARY[name].sources.values(), f"{LIBRARY[name].density:g} kg/m^3"):
        assert source in ended.stdout
    found = json.loads(command_line("materials", name, "--json").stdout)["materials"][name]
    assert found["density"] == f"{LIBRARY[name].density:g} kg/m^3"
    assert math.isclose(float(found["youngs_modulus"].split()[0]), LIBRARY[name].youngs_modulus / 1e9, rel_tol=1e-3)


def test_the_command_refuses_what_is_not_there(command_line: Callable[..., Ended]) -> None:
    ended = command_line("materials", "AZ31")
    assert (ended.code, ended.stdout) == (2, "")
    assert "did you mean AZ31B?" in ended.stderr
