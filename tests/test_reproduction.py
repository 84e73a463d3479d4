"""The paper reproduced: every printed number has a row, and every verdict follows from the numbers beside it."""

from __future__ import annotations

import contextlib
import io
import json
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from flexdesign import cli
from flexdesign.core import printed_numbers
from flexdesign.core.model import Quantity
from flexdesign.core.printed_numbers import Printed
from flexdesign.core.result_cache import Cache
from flexdesign.workflows import reproduction
from flexdesign.workflows.reproduction import VERDICTS, Item, Reproduction, bench, statics
from flexdesign.workflows.reproduction.items import compare, contradiction

ROOT = Path(__file__).resolve().parent.parent
#: Coarse enough for half a minute: finite elements are right within a few percent.
COARSE = ["mesh.levels=2", "mesh.at_root=1.0", "mesh.growth=1.5", 'mesh.largest="8 mm"']


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    store = Cache(tmp_path_factory.mktemp("cache"))
    store.prepare()
    return reproduction.reproduce(ROOT / "studies" / "lin2019.toml", store, overrides=COARSE)


def row(found: Reproduction, system: str, words: str) -> Item:
    (one,) = (item for item in found.items if item.system == system and words in item.what)
    return one


def test_every_printed_number_has_a_row(found: Reproduction) -> None:
    assert found.unused() == []


def test_every_system_of_the_paper_has_a_row(found: Reproduction) -> None:
    assert {item.system for item in found.items} == {f"P{number}" for number in range(1, 21)}


def test_verdicts_are_known_and_contradictions_say_why(found: Reproduction) -> None:
    for item in found.items:
        assert item.verdict in VERDICTS
        assert item.why or item.verdict != "contradictory", item
        assert item.theirs != "–" or item.verdict == "not printed", item


@pytest.mark.parametrize(
    ("system", "words", "verdict"),
    [
        ("P3", "λ of X/Y", "by construction"),
        ("P6", "coupling X–Y by (25)", "by construction"),
        ("P7", "K_in of X/Y, model", "by construction"),
        ("P7", "K_in of X/Y, FEA", "contradictory"),
        ("P7", "K_in of X/Y, error", "agrees"),
        ("P8", "loop span of Z", "by construction"),
        ("P8", "linearity” of X/Y", "agrees"),
        ("P11", "travel at 40 um over", "agrees"),
        ("P11", "coupling X–Y, (25)", "contradictory"),
        ("P12", "gain of X/Y", "contradictory"),
        ("P13", "gain of Z", "contradictory"),
        ("P15", "Kp of Z", "contradictory"),
        ("P16", "settling, open loop", "contradictory"),
        ("P17", "oscillation", "agrees"),
        ("P18", "range of Z", "contradictory"),
        ("P19", "largest distance", "agrees"),
        ("P20", "largest distance", "contradictory"),
    ],
)
def test_verdict(found: Reproduction, system: str, words: str, verdict: str) -> None:
    assert row(found, system, words).verdict == verdict


def test_what_follows_from_the_printed_numbers_is_told(found: Reproduction) -> None:
    """Worked out by hand from the paper's numbers."""
    closing = row(found, "P11", "travel at 40 um over")
    assert (closing.theirs, closing.ours) == ("1.1035", "1.1038")
    assert "36.25 um and 36.24 um" in closing.why
    for system, label, implied in (
        ("P18", "X/Y", 269.0),
        ("P18", "Z", 247.8),
        ("P19", "line", 198.0),
        ("P20", "line", 60.8),
    ):
        text = row(found, system, f"range of {label}" if system == "P18" else "range of the line").theirs
        assert float(text.split()[0]) == pytest.approx(implied, abs=0.05)
    errors = [row(found, "P6", f"coupling X–{axis}, error").ours for axis in "YZ"]
    assert errors == ["17 %", "18 %"]
    assert row(found, "P17", "oscillation").ours.startswith("X/Y 93 % and Z 73 %")
    assert row(found, "P12", "gain of X/Y").ours == "4.0460"


def test_the_irreconcilable_row_has_its_numbers(found: Reproduction) -> None:
    """Against K_b = 12.8 N/mm K_in is 1.8 N/um by (17); beside the amplifier 19.0 - 12.8 N/mm are left: less."""
    why = row(found, "P7", "K_in of X/Y, FEA").why
    assert "12.8 N/mm" in why and "6.2 N/mm" in why and why.endswith("No stage of this kind has 2.0 N/um")
    at_own, at_left = (float(why.split(words)[1].split()[0]) for words in ("By (17) it is ", "by (17) K_in is "))
    assert at_left < at_own == pytest.approx(1.8, rel=0.01)


def test_ours_is_written_in_the_unit_that_is_printed(found: Reproduction) -> None:
    """K_in in N/um and K_out in N/mm, as Table 1 has them; a number that is printed without a unit has ours in its."""
    for item in found.items:
        if item.system == "P7" and item.what.startswith(("K_in", "K_out")):
            assert item.ours.split()[-1] == item.theirs.split()[-1], item
    stiffness = [item for item in found.items if item.what.startswith("K_in")]
    assert stiffness and not any("N/mm" in item.theirs + item.ours for item in stiffness)
    motion = Quantity("travel", 2.5e-6, "m", "um", half_width=3e-9)
    both = compare("P7", "x", Printed("Table 1", "x", "2500 nm"), motion, known=1e-8)
    assert (both.theirs, both.ours) == ("2500 nm ± 10 nm", "2500.0 ± 3.0 nm")
    assert compare("P7", "x", Printed("Table 1", "x", "2"), Quantity("ratio", 2.0, "1", "")).ours == "2.000"


def test_a_b_and_c_are_identified_from_the_simulated_recording(found: Reproduction) -> None:
    words = row(found, "P10", "a, b, c").ours.replace(",", "").split()
    a, b, c = (float(words[words.index(name) + 1]) for name in "abc")
    assert a == pytest.approx(0.460, rel=0.01)
    assert b == pytest.approx(0.0165, rel=0.01)
    assert c == pytest.approx(0.0040, rel=0.05)


def test_the_loop_is_straight_between_40_and_100_volts(found: Reproduction) -> None:
    one = bench.case(found.experiments, "P8 X")
    within, whole = (bench.straightness(one, "x", *ends) for ends in ((40.0, 100.0), (0.0, 120.0)))
    assert within[0] < within[1] < min(whole) / 3


def test_a_changed_printed_number_changes_the_verdict(found: Reproduction) -> None:
    """Rows are computed: with Fig 7's X span 1 % off, Figs 7 and 9 no longer show one amplification."""
    key = ("section 4.2, Fig 7", "span_xy")
    changed = {**found.paper.printed, key: Printed(*key, "241 um")}
    again = [item for item in statics.items(replace(found.paper, printed=changed), found.stage)]
    (closing,) = (item for item in again if "travel at 40 um over" in item.what)
    assert closing.verdict == "contradictory"
    key = ("Table 1, error", "K_out_xy")
    changed = {**found.paper.printed, key: Printed(*key, "4.7 %")}
    again = list(statics.items(replace(found.paper, printed=changed), found.stage))
    (error,) = (item for item in again if "K_out of X/Y, error" in item.what)
    assert error.verdict == "differs"


def test_judgement() -> None:
    theirs = Printed("Table 1", "K", "19.0 N/mm")
    ours = Quantity("K_out", 19.2e3, "N/m", "N/mm", half_width=0.1e3)
    assert compare("P7", "K", theirs, ours).verdict == "differs"  # 0.2 is more than 0.05 + 0.1
    assert compare("P7", "K", theirs, ours, known=60.0).verdict == "agrees"
    assert compare("P7", "K", theirs, ours, built="set").verdict == "by construction"
    assert compare("P7", "K", theirs, replace(ours, value=25e3), built="set").verdict == "differs"
    assert compare("P7", "K", theirs, ours, why="springs").verdict == "contradictory"
    assert compare("P7", "K", theirs, None).verdict == "not printed"
    assert compare("P7", "K", theirs, replace(ours, value=math.inf)).verdict == "differs"
    same = contradiction("P1", "K", [(theirs, "N/m")], 19.0, 19.04, "N/mm", "why")
    other = contradiction("P1", "K", [(theirs, "N/m")], 19.0, 19.06, "N/mm", "why")
    assert (same.verdict, other.verdict) == ("agrees", "contradictory")


@dataclass(frozen=True)
class Told:
    """What the command said and wrote."""

    stdout: str
    folder: Path


@pytest.fixture(scope="module")
def told(found: Reproduction, tmp_path_factory: pytest.TempPathFactory) -> Told:
    """Run the command, of which the report is drawn once for all tests."""
    folder, said = tmp_path_factory.mktemp("command"), io.StringIO()
    arguments = ["reproduce", "lin2019", "--out", str(folder / "out"), "--cache", str(folder / "cache"), "--json"]
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(said):
        patch.setattr(reproduction, "reproduce", lambda *_: found)
        patch.setattr(sys, "argv", ["flexdesign", *arguments])
        try:
            cli.main()
        except SystemExit as stop:
            assert not stop.code
    return Told(said.getvalue(), folder / "out")


def test_the_report_is_the_paper(told: Told) -> None:
    text = (told.folder / "report.md").read_text(encoding="utf-8")
    for words in ("Table 1", "Fig 13", "Figs 14 to 17", "Figs 18 and 19", "eight of them", "one realisation"):
        assert words in text
    for verdict in VERDICTS:
        assert f"| {verdict} |" in text
    for figure in ("P8_X_loop.svg", "P10_unknown_hysteresis_loop.svg", "P16_light_damping_time.svg", "P20_time.svg"):
        assert f"({figure})" in text and (told.folder / figure).is_file()


def test_command(found: Reproduction, told: Told) -> None:
    content = json.loads(told.stdout)
    assert content["kind"] == "reproduction" and len(content["rows"]) == len(found.items)
    assert json.loads((told.folder / "result.json").read_text(encoding="utf-8")) == content
    assert (told.folder / "report.html").is_file()


def test_the_kept_example_is_of_these_numbers() -> None:
    """`make example` made it after the last change of a printed number."""
    content = json.loads((ROOT / "reports" / "examples" / "lin2019" / "result.json").read_text(encoding="utf-8"))
    paper = printed_numbers.read("lin2019")
    used = {tuple(key) for row in content["rows"] for key in row["uses"]}
    assert used == set(paper.printed)
    for name in ("K_out_xy", "K_out_z"):
        text = paper("Table 1, FEA", name).text
        assert any(r["theirs"] == text and r["verdict"] == "by construction" for r in content["rows"])
    assert content["seconds"] < 300
