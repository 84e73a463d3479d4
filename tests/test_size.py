"""``flexdesign size``: what it finds, what it writes, what it says of its numbers, and what it refuses."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flexdesign.analytic import dimension_synthesis
from flexdesign.core.errors import InputError
from flexdesign.design import design

Run = Callable[..., Any]

ROOT = Path(__file__).parent.parent
TARGETS = ROOT / "studies" / "lin2019_targets.toml"
#: What was worked out by hand from the paper's numbers, with half a unit of the last digit, in display units.
BY_HAND = {
    ("lambda", "X/Y"): (4.046, 0.0005),
    ("lambda", "Z"): (3.991, 0.0005),
    ("K_b", "amplifiers"): (12.8, 0.05),
    ("L_1", "chains, X to Y"): (45.5, 0.05),
    ("L_2", "chains, X to Z"): (89.9, 0.05),
    ("K_r", "hinges"): (2842, 0.5),
    ("l_x", "amplifiers"): (21.07, 0.005),
    ("l_h", "hinges"): (3.30, 0.005),
    ("l_y", "X/Y"): (1.213, 0.0005),
    ("l_y", "Z"): (0.828, 0.0005),
    ("c_rod", "X/Y"): (0.4262, 0.00005),
    ("c_rod", "Z"): (0.3243, 0.00005),
    ("l_1", "X/Y"): (13.58, 0.005),
    ("l_1", "Z"): (12.43, 0.005),
}


def values(result: dict[str, Any]) -> dict[tuple[str, str], float]:
    return {(q["name"], q["boundary"]): q["value"] for q in result["quantities"]}


# --- what is found ------------------------------------------------------------------------------------------------


def test_the_paper_s_targets_give_the_dimensions_worked_out_by_hand(command_line: Run) -> None:
    ended = command_line("size", "lin2019_targets", "--json")
    assert (ended.code, ended.stderr) == (0, "")
    found = values(json.loads(ended.stdout))
    for key, (expected, half_digit) in BY_HAND.items():
        assert abs(found[key] - expected) <= half_digit, key
    assert not list(Path().iterdir())  # nothing is written without --out


def test_table_1_comes_back_and_is_called_circular() -> None:
    result = dimension_synthesis.size("lin2019_targets").result()
    back = [(row["value"], row["unit"], row["boundary"]) for row in result["returned"]]
    for printed, half_digit, unit, boundary in (
        (18.3, 0.05, "N/mm", "X/Y"),
        (25.6, 0.05, "N/mm", "Z"),
        (1.8, 0.05, "N/um", "X/Y"),
        (2.6, 0.05, "N/um", "Z"),
        (0.089, 0.0005, "%", "X to Y"),
        (0.045, 0.0005, "%", "X to Z"),
    ):
        (value,) = [v for v, u, b in back if (u, b) == (unit, boundary)]
        assert abs(value - printed) <= half_digit
    assert "circular by construction" in result["provenance"]


def test_every_target_and_choice_of_the_paper_has_its_source() -> None:
    given = dimension_synthesis.size(TARGETS).given
    assert len(given) == len(tomllib.loads(TARGETS.read_text())["sources"])
    for name, _, source in given:
        place = source.startswith(("Table", "eq (", "Fig", "section"))
        assert place is not name.startswith("choices."), name
        assert place or source.startswith("our choice")


def test_the_inconsistent_count_of_equation_21_is_shown(command_line: Run) -> None:
    ended = command_line("size", "lin2019_targets")
    said = " ".join(ended.stdout.split())
    assert "the mass of 4 amplifiers and the stiffness of 1" in said
    assert "the same elements make 56.70 N/mm, 3.1 times 18.30 N/mm" in said
    stiffness = {t["bending_amplifiers"]: t["value"] for t in dimension_synthesis.size(TARGETS).result()["topologies"]}
    # K_b + 5.5, twice that, 4 K_b + 5.5, with K_b = 12.8 N/mm
    assert stiffness == pytest.approx({1: 18.3, 2: 36.6, 4: 56.7}, rel=1e-9)


def test_the_terminal_says_what_the_dimensions_are(command_line: Run) -> None:
    ended = command_line("size", "lin2019_targets")
    assert ended.code == 0
    said = " ".join(ended.stdout.split())
    for words in ("reconstructed", "circular", "± by rounding", "eq. (17)", "45.46 mm", "2842 N*mm/rad"):
        assert words in said
    # With its output free: 1431 N/mm by hand.
    assert "K_in = 1.431 N/um" in said


# --- rounding -----------------------------------------------------------------------------------------------------


def test_half_widths_bound_what_rounding_does_to_products() -> None:
    """Where a dimension is a product of powers of targets, relative half-widths add up, each with its exponent."""
    halves = {"k": 0.05 / 18.3, "k_z": 0.05 / 25.6, "k_in": 0.05 / 1.8, "gain": 0.00005 / 6.0777, "eta": 0.0005 / 0.089}
    found = {(q.name, q.boundary): q for q in dimension_synthesis.size(TARGETS).quantities}

    def relative(*key: str) -> float:
        quantity = found[key]
        assert quantity.half_width is not None
        return quantity.half_width / quantity.value

    of_lambda = halves["k"] + halves["k_in"] + halves["gain"]
    # Central differences of 1/x and of x^2 are wrong by the square of the half-width: 0.03^2 = 1e-3 of itself.
    assert relative("lambda", "X/Y") == pytest.approx(of_lambda, rel=1e-3)
    assert relative("L_1", "chains, X to Y") == pytest.approx(of_lambda + halves["eta"], rel=1e-3)
    assert relative("K_b", "amplifiers") == pytest.approx(halves["k_z"], rel=1e-3)
    # K_r = (K_x - K_z / 2) L_1^2 / 4, and L_1 falls as K_x rises.
    guide = 5.5
    of_k_x = abs(0.05 / guide - 2 * halves["k"])
    others = 0.025 / guide + 2 * (halves["k_in"] + halves["gain"] + halves["eta"])
    assert relative("K_r", "hinges") == pytest.approx(of_k_x + others, rel=2e-3)


def test_targets_that_are_not_rounded_have_no_half_widths(command_line: Run) -> None:
    exact = dimension_synthesis.size(TARGETS, ["rounded=false"])
    assert all(quantity.half_width is None for quantity in exact.quantities)
    ended = command_line("size", "lin2019_targets", "--set", "rounded=false")
    assert ended.code == 0
    assert "rounding" not in ended.stdout


def test_rounding_that_contradicts_the_targets_is_refused() -> None:
    targets = ["material=AZ31B", 'targets.xy.output_stiffness="12.9 N/mm"', 'targets.z.output_stiffness="25 N/mm"']
    targets += ['choices.hinge_thickness="0.1 mm"', "rounded=true"]
    assert dimension_synthesis.size(TARGETS, [*targets[:-1], "rounded=false"]).found.hinge_stiffness > 0
    with pytest.raises(InputError, match="half a unit of its last digit") as refused:
        dimension_synthesis.size(TARGETS, [*targets[:1], 'targets.xy.output_stiffness="13 N/mm"', *targets[2:]])
    assert refused.value.field == "targets.xy.output_stiffness"


# --- other targets ------------------------------------------------------------------------------------------------


def test_other_targets_come_back(tmp_path: Path) -> None:
    """A file of our own: amplifications stated, outputs free, default topologies, another material."""
    file = tmp_path / "mine.toml"
    file.write_text(
        """\
format = 1
material = "Al 7075-T6"

[targets.xy]
output_stiffness = "80 N/mm"
input_stiffness = "12 N/um"
amplification = 7
load_ratio = 0

[targets.z]
output_stiffness = "100 N/mm"
input_stiffness = "9 N/um"
amplification = 5
load_ratio = 0

[targets.coupling]
input_stroke = "15 um"
y_from_x = "0.1 %"
z_from_x = "0.05 %"

[choices]
width = "15 mm"
hinge_thickness = "0.4 mm"
rod_thickness = "4 mm"
"""
    )
    found = dimension_synthesis.size(file)
    assert found.title == "mine"
    for asked, back in found.recomputed_targets():
        assert back.value == pytest.approx(asked.value, rel=1e-12)
    assert found.found.xy.youngs_modulus == pytest.approx(71.7e9)
    assert found.found.xy.amplification() == pytest.approx(7)  # output free
    named = {(q.name, q.boundary): q.source for q in found.quantities}
    assert named["lambda", "X/Y"] == "stated"
    assert "load generalised" in named["l_y", "Z"]
    assert {given.source for given in found.given} == {"not stated"}


def test_an_amplification_from_the_command_line_takes_the_place_of_the_gain() -> None:
    found = dimension_synthesis.size("lin2019_targets", ["targets.xy.amplification=6.0777"])
    # 20 um times 6.0777 over twice 0.089 %
    assert abs(found.found.chain_length_y - 68.3e-3) <= 0.05e-3
    sources = {given.name: given.source for given in found.given}
    assert sources["targets.xy.amplification"] == "command line"
    assert "targets.xy.gain" not in sources


# --- what is written ----------------------------------------------------------------------------------------------


def test_files_go_to_out(tmp_path: Path, command_line: Run) -> None:
    ended = command_line("size", "lin2019_targets", "--out", "sized")
    assert ended.code == 0
    folder = tmp_path / "sized"
    assert {file.name for file in folder.iterdir()} == {"dimensions.toml", "report.html", "report.md", "result.json"}
    written = json.loads((folder / "result.json").read_text())
    assert written.pop("inputs")["command"] == "size"
    assert written == dimension_synthesis.size("lin2019_targets").result()
    report = (folder / "report.md").read_text()
    assert "circular" in report and "Table 1, model row" in report


def test_the_dimensions_are_those_of_a_design() -> None:
    """Laid over the amplifier's design they are read, and are what that design has to four digits."""
    written = tomllib.loads(dimension_synthesis.size("lin2019_targets").to_toml())
    assert "circular by construction" in written["provenance"]
    dimensions = written["amplifier"]["xy"]["dimensions"]
    file = ROOT / "geometry" / "lin2019_amplifier_xy.toml"
    laid = design.read(file, [f'dimensions.{name}="{text}"' for name, text in dimensions.items()]).dimensions
    own = design.read(file).dimensions
    assert set(dimensions) < set(own)
    for name in dimensions:
        assert laid[name] == pytest.approx(own[name], rel=5e-4), name
    assert written["stage"] == {"chain_length_y": "45.4603 mm", "chain_length_z": "89.9104 mm"}


# --- what is refused ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "place", "words"),
    [
        ("targets.xy.amplification=9", "command line: targets.xy.amplification = 9", "below 8.385"),
        ("targets.xy.gain=2.7", "command line: targets.xy.gain = 2.7", "below 8.385"),
        ('targets.z.output_stiffness="40 N/mm"', "targets.xy.output_stiffness = 18.3 N/mm", "nothing is left"),
        ("topology.xy.bending_amplifiers=4", "targets.xy.output_stiffness = 18.3 N/mm", "51.2 N/mm"),
        ("topology.xy.guide_hinges=0", "command line: topology.xy.guide_hinges = 0", "1 at least"),
        ('choices.hinge_thickness="1 mm"', "command line: choices.hinge_thickness = 1 mm", "thinner than 0.9277 mm"),
        ('targets.coupling.y_from_x="120 %"', "command line: targets.coupling.y_from_x = 120 %", "allowed"),
        ('targets.xy.output_stiffness="18 N"', "targets.xy.output_stiffness = 18 N", "stiffness"),
        ("targets.xy.foo=3", "command line: targets.xy.foo = 3", "is not a known key"),
        ("topology.z.amplifier_share=1e-320", "topology.z.amplifier_share = 1e-320", "allowed: 0.001 to 1"),
        ("material=Foo", "command line: material = Foo", "is not in the library"),
        ('sources.foo="x"', "command line: sources.foo = x", "is the source of no number"),
        ("sources.foo=3", "command line: sources.foo = 3", "expected text"),
        ("targets.xy", "command line: --set", "="),
    ],
)
def test_bad_input_ends_with_its_place_and_a_remedy(command_line: Run, override: str, place: str, words: str) -> None:
    ended = command_line("size", "lin2019_targets", "--set", override, "--out", "sized")
    assert (ended.code, ended.stdout) == (2, "")
    assert place in ended.stderr and words in ended.stderr
    assert len(ended.stderr.splitlines()) == 1
    assert not Path("sized").exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("gain = 6.0777", "", "targets.xy: needs either an amplification, or a gain"),
        ("gain = 6.0777", "gain = 6.0777\namplification = 4", "and not both"),
        ("gain = 6.0777\nload_ratio = 1.0", "gain = 6.0777", "targets.xy.load_ratio: is missing"),
        ("format = 1", "format = 2", "this version reads format = 1"),
    ],
)
def test_files_that_do_not_say_enough(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = TARGETS.read_text()
    assert text.count(old) == 1
    file = tmp_path / "mine.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=re.escape(words)) as refused:
        dimension_synthesis.size(file)
    assert refused.value.file == str(file)


def test_names_that_are_none(command_line: Run, tmp_path: Path) -> None:
    ended = command_line("size", "lin2019_target")
    assert ended.code == 2
    assert "did you mean lin2019_targets?" in ended.stderr
    empty = tmp_path / "empty.toml"
    empty.touch()
    with pytest.raises(InputError, match="is empty; it needs"):
        dimension_synthesis.size(empty)
