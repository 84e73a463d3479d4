"""Designs and studies: what is read from them, where they are found, and what --set changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexdesign.core import toml_files
from flexdesign.core.errors import InputError
from flexdesign.design import design as designs
from flexdesign.design import materials, study
from flexdesign.design.study import MeshSettings, ModeSettings, OutputSettings

DESIGN = """\
format = 1
part = "bridge_amplifier"
material = "AZ31B"
title = "An amplifier"
provenance = "from a drawing"

[dimensions]
arm_span = "20 mm"
arm_offset = "1.6 mm"
arm_thickness = "4 mm"
hinge_length = "3 mm"
hinge_thickness = "500 um"
width = "12 mm"
rod_length = "0 mm"
rod_thickness = "4 mm"
input_block_height = "1.2 cm"
input_block_depth = "6 mm"
block_width = "12 mm"
output_block_height = "6 mm"
ground_block_height = "6 mm"
fillet_radius = "0 mm"

[actuator]
free_stroke = "38 um"
stiffness = "100 N/um"
"""

SHIPPED = sorted((Path(__file__).parent.parent / "geometry").glob("*.toml"))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(DESIGN)
    return path


# --- what is read -------------------------------------------------------------------------------------------------


def test_numbers_are_read_in_si_in_the_order_of_the_part(path: Path) -> None:
    design = designs.read(path)
    assert list(design.dimensions) == [p.name for p in design.part_class.dimensions]
    assert design.dimensions["hinge_thickness"] == pytest.approx(0.5e-3)
    assert design.dimensions["input_block_height"] == pytest.approx(12e-3)
    assert design.dimensions["rod_length"] == 0.0
    assert design.part().width == pytest.approx(12e-3)  # type: ignore[attr-defined]


def test_what_the_file_says_of_itself(path: Path) -> None:
    design = designs.read(path)
    assert (design.name, design.title, design.provenance) == ("mine", "An amplifier", "from a drawing")
    assert design.file == path
    assert design.material == materials.library()["AZ31B"]


def test_defaults(path: Path) -> None:
    path.write_text(DESIGN.replace('title = "An amplifier"\nprovenance = "from a drawing"\n', ""))
    design = designs.read(path)
    assert (design.title, design.provenance) == ("mine", "")
    assert design.actuator is not None
    assert design.actuator.name == "actuator"
    assert design.actuator.preload == 0.0
    assert design.actuator.voltage_range is None
    assert design.actuator.installed_stiffness == pytest.approx(1e8)  # rigid seats


def test_the_seats_are_in_series_with_the_stack(path: Path) -> None:
    design = designs.read(path, ["actuator.contact_stiffness=300 N/um"])
    assert design.actuator is not None
    assert design.actuator.installed_stiffness == pytest.approx(75e6)


def test_a_design_without_an_actuator(path: Path) -> None:
    path.write_text(DESIGN.partition("[actuator]")[0])
    assert designs.read(path).actuator is None


def test_a_material_of_its_own(path: Path) -> None:
    table = 'name = "X"\nyoungs_modulus = "70 GPa"\npoissons_ratio = "33 %"\n'
    table += 'density = "2.7 g/cm^3"\nyield_strength = "300 MPa"\n'
    path.write_text(DESIGN.replace('material = "AZ31B"\n', "") + "[material]\n" + table)
    material = designs.read(path).material
    assert material.name == "X"
    assert material.poissons_ratio == pytest.approx(0.33)
    assert material.youngs_modulus == pytest.approx(70e9)
    assert material.density == pytest.approx(2700.0)


def test_a_byte_order_mark_does_no_harm(path: Path) -> None:
    path.write_bytes(b"\xef\xbb\xbf" + DESIGN.encode())
    assert designs.read(path).title == "An amplifier"


def test_voltages_are_a_range(path: Path) -> None:
    design = designs.read(path, ['actuator.voltage_range=["-30 V", "0.15 kV"]'])
    assert design.actuator is not None
    assert design.actuator.voltage_range == pytest.approx((-30.0, 150.0))


@pytest.mark.parametrize("shipped", SHIPPED, ids=lambda path: path.stem)
def test_shipped_designs_can_be_read(shipped: Path) -> None:
    design = designs.read(shipped)
    assert design.title != design.name
    assert design.stage().assembly().driven if design.is_stage else design.part().linkage().of_kind("hinge")


# --- where it is found --------------------------------------------------------------------------------------------


def test_a_bare_name_finds_what_is_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert designs.find("bridge_amplifier").name == "bridge_amplifier.toml"
    assert study.read("bridge_amplifier").name == "bridge_amplifier"


def test_a_bare_name_finds_ones_own_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("geometry", "studies"):
        (tmp_path / folder).mkdir()
    own = Path("geometry/bridge_amplifier.toml")
    own.write_text(DESIGN)
    assert designs.find("bridge_amplifier") == own
    Path("studies/mine.toml").write_text('format = 1\ndesign = "bridge_amplifier"\n')
    assert study.read("mine").design.title == "An amplifier"


def test_a_path_is_a_path(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(path.parent)
    assert designs.find(path) == path
    assert designs.find("mine.toml") == Path("mine.toml")
    with pytest.raises(InputError, match="no such design or study"):
        designs.find("mine")


def test_a_part_beside_the_design_comes_first(path: Path) -> None:
    source = (Path(__file__).parent.parent / "geometry" / "bridge_amplifier.py").read_text()
    beside = path.parent / "bridge_amplifier.py"
    beside.write_text(source.replace("class BridgeAmplifier", "class MyAmplifier"))
    assert designs.read(path).part_class.__name__ == "MyAmplifier"
    (path.parent / "parts").mkdir()
    beside.rename(path.parent / "parts" / "other.py")
    assert designs.read(path).part_class.__name__ == "BridgeAmplifier"
    assert designs.read(path, ["part=parts/other.py"]).part_class.__name__ == "MyAmplifier"


# --- studies ------------------------------------------------------------------------------------------------------


def test_a_design_is_studied_with_default_settings(path: Path) -> None:
    asked = study.read(path)
    assert (asked.name, asked.design.name) == ("mine", "mine")
    assert (asked.mesh, asked.modes, asked.output) == (MeshSettings(), ModeSettings(), OutputSettings())
    assert asked.output.stroke is None


def test_a_study_names_a_design_beside_it(path: Path) -> None:
    other = path.parent / "how.toml"
    settings = '[mesh]\nlevels = 2\nlargest = "2 mm"\n[output]\nstroke = "0.1 mm"\n'
    other.write_text(f'format = 1\ndesign = "mine.toml"\n{settings}')
    asked = study.read(other)
    assert (asked.name, asked.design.name) == ("how", "mine")
    assert (asked.mesh.levels, asked.mesh.largest) == (2, pytest.approx(2e-3))
    assert asked.output.stroke == pytest.approx(1e-4)
    assert asked.modes == ModeSettings()


def test_a_study_may_have_a_title_of_its_own(path: Path) -> None:
    other = path.parent / "how.toml"
    other.write_text('format = 1\ndesign = "mine.toml"\n')
    assert study.read(other).design.title == "An amplifier"
    assert study.read(other, ["title=Another"]).design.title == "Another"
    assert study.read(path, ["title=Another"]).design.title == "Another"


# --- overrides ----------------------------------------------------------------------------------------------------


def test_overrides_go_to_design_and_study_alike(path: Path) -> None:
    overrides = [
        "dimensions.width=15 mm",
        "mesh.levels=2",
        'material="Ti-6Al-4V"',
        "actuator.preload = 10 N",
        "output.stroke=50 um",
        "modes.count=4",
        "provenance=mine",
    ]
    asked = study.read(path, overrides)
    design = asked.design
    assert design.dimensions["width"] == pytest.approx(15e-3)
    assert design.material.name == "Ti-6Al-4V"
    assert design.actuator is not None and design.actuator.preload == pytest.approx(10.0)
    assert design.provenance == "mine"
    assert (asked.mesh.levels, asked.modes.count) == (2, 4)
    assert asked.output.stroke == pytest.approx(50e-6)
    assert study.read(path).design.dimensions["width"] == pytest.approx(12e-3)  # the file is as it was


def test_the_last_override_counts(path: Path) -> None:
    asked = study.read(path, ["dimensions.width=15 mm", "dimensions.width=16 mm"])
    assert asked.design.dimensions["width"] == pytest.approx(16e-3)


def test_an_override_may_add_a_table(path: Path) -> None:
    path.write_text(DESIGN.partition("[actuator]")[0])
    asked = study.read(path, ["actuator.free_stroke=38 um", "actuator.stiffness=60 N/um"])
    assert asked.design.actuator is not None
    assert asked.design.actuator.stiffness == pytest.approx(60e6)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("0.5", 0.5),
        ("true", True),
        ("15 mm", "15 mm"),
        ('"15 mm"', "15 mm"),
        ("a=b", "a=b"),
        ('["0 V", "1 V"]', ["0 V", "1 V"]),
        ("", ""),
    ],
)
def test_the_value_of_an_override(text: str, value: object) -> None:
    content = {"mesh": {"levels": 3}}
    assert toml_files.overlay(content, [f" mesh.other = {text} "]) == {"mesh": {"levels": 3, "other": value}}
    assert content == {"mesh": {"levels": 3}}


@pytest.mark.parametrize(
    ("value", "multiple"),
    [(3, 3.75), (0.5, 0.625), ("0.46 um/V", "0.575 um/V"), ("2e-3 1/V", "0.0025 1/V"), ("-8mm", "-10 mm"), ("4", "5")],
)
def test_an_override_may_be_a_multiple(value: object, multiple: object) -> None:
    content = {"mesh": {"levels": value}}
    assert toml_files.overlay(content, ["mesh.levels *= 1.25"]) == {"mesh": {"levels": multiple}}
    assert content == {"mesh": {"levels": value}}


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("mesh.levels*=15 mm", "takes a factor, such as 1.2; write mesh.levels"),
        ("mesh.levels*=true", "takes a factor"),
        ("mesh.levels*=inf", "takes a factor"),
        ("mesh.method*=2", "no number in the file that could be multiplied"),
        ("mesh.growth*=2", "no number in the file that could be multiplied"),
    ],
)
def test_what_cannot_be_multiplied_is_refused(override: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        toml_files.overlay({"mesh": {"levels": 3, "method": "wild"}}, [override])
    key, _, value = override.partition("=")
    assert (caught.value.file, caught.value.field, caught.value.value) == ("command line", key, value)
    assert words in caught.value.remedy


def test_a_multiple_out_of_bounds_is_blamed_on_the_override(path: Path) -> None:
    with pytest.raises(InputError) as caught:
        study.read(path, ["dimensions.width*=1e6"])
    assert (caught.value.file, caught.value.field) == ("command line", "dimensions.width")


HYSTERETIC = """
[actuator.hysteresis]
model = "bouc-wen"
a = "77.3 nm/V"
b = "0.0165 1/V"
c = "0.004 1/V"
"""


@pytest.mark.parametrize(
    ("old", "new", "field", "words"),
    [
        ('"bouc-wen"', '"preisach"', "actuator.hysteresis.model", "'bouc-wen'"),
        ('"77.3 nm/V"', '"77.3 nm"', "actuator.hysteresis.a", "not a unit of gain"),
        ('b = "0.0165 1/V"\n', "", "actuator.hysteresis.b", "is missing"),
        ('"0.0165 1/V"', '"0 1/V"', "actuator.hysteresis.b", "allowed: more than 0"),
        ('c = "0.004 1/V"', "n = 2", "actuator.hysteresis.n", "is not a known key"),
    ],
)
def test_a_hysteresis_that_cannot_be_used(path: Path, old: str, new: str, field: str, words: str) -> None:
    stack = '\n[actuator]\nfree_stroke = "40 um"\nstiffness = "60 N/um"\n'
    text = DESIGN.partition("\n[actuator]")[0]
    path.write_text(text + stack + HYSTERETIC, encoding="utf-8")
    actuator = study.read(path).design.actuator
    assert actuator is not None and actuator.hysteresis is not None
    assert actuator.hysteresis.a == pytest.approx(77.3e-9) and not actuator.hysteresis.assumed
    assert old in HYSTERETIC
    path.write_text(text + stack + HYSTERETIC.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        study.read(path)
    assert caught.value.field == field
    assert words in caught.value.remedy


def test_an_override_is_blamed_for_what_it_overrides(path: Path) -> None:
    path.write_text(DESIGN.replace('"12 mm"', '"12 N"', 1))
    with pytest.raises(InputError) as caught:
        study.read(path, ["dimensions.arm_span=21 mm"])
    assert caught.value.file == str(path)
    with pytest.raises(InputError) as caught:
        study.read(path, ["dimensions.width=13 N"])
    assert (caught.value.file, caught.value.value) == ("command line", "13 N")


def test_a_changed_design_is_not_said_to_return_what_the_paper_prints() -> None:
    drawn, thinner = (
        designs.read(designs.find("lin2019_amplifier_xy"), changes)
        for changes in ([], ["dimensions.hinge_thickness=0.4 mm"])
    )
    assert drawn.provenance.endswith("return its printed stiffness and amplification")
    assert thinner.provenance.endswith("changed since, so that this no longer holds: dimensions.hinge_thickness")
