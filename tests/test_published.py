"""Published mechanisms: their numbers are those of the formulas, and the effect that was left out is found."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

import flexdesign as fd
from flexdesign.analytic import notch, published_bridges, static_model
from flexdesign.analytic.static_model import Row, StaticTable
from flexdesign.core.errors import InputError
from flexdesign.core.printed_numbers import Printed
from flexdesign.effects import statics
from flexdesign.workflows.published import folder as folders
from flexdesign.workflows.published.closing import closing, model_of, neglected_effects
from flexdesign.workflows.published.folder import PublishedNumber
from flexdesign.workflows.validation.model_hierarchy import model_hierarchy

ROOT = Path(__file__).resolve().parent.parent
SHIPPED = ROOT / "studies" / "published"
HEAD = ",".join(folders.HEAD)


def numbers(name: str) -> dict[str, float]:
    """Return the published numbers of a folder, SI, by their places."""
    si = {"K_out": "N/m", "lambda": "1", "K_in": "N/m"}
    return {n.printed.place: n.printed.value(si[n.quantity]) for n in folders.read(SHIPPED / name).numbers}


def test_every_shipped_folder_is_read() -> None:
    found = folders.find()
    assert {"leaf_pivot", "circular_notch_pivot", "ling2019_rhombic", "ling2019_parallel", "ling2019_aligned",
            "lin2019_stage", "apa300ml"} <= {path.name for path in found}  # fmt: skip
    for path in found:
        read = folders.read(path)
        assert read.numbers and read.source


def test_the_hinges_have_the_numbers_of_their_formulas() -> None:
    """The levers are pushed at h above the middle of the hinge: 1 / K = h^2 / K_theta, and the sway of the hinge."""
    young, nu = (getattr(fd.materials["Al 7075-T6"], name) for name in ("youngs_modulus", "poissons_ratio"))
    leaf = notch.leaf(young, 10e-3, 0.5e-3, 5e-3)
    turned = 1 / (17.5e-3**2 * leaf.rotation)
    swayed = 1 / (1 / turned + 1 / leaf.sway_stiffness)
    assert list(numbers("leaf_pivot").values()) == pytest.approx([turned, swayed], rel=2e-4)
    full, _ = notch.paros_weisbord(young, 10e-3, 0.5e-3, 2e-3)
    thin = notch.thin_neck(young, 10e-3, 0.5e-3, 2e-3).rotation
    sheared = notch.lobontiu_circular(young, 10e-3, 0.5e-3, 2e-3).with_shear(nu)
    expected = [1 / (17e-3**2 * full), 1 / (17e-3**2 * thin)]
    expected.append(1 / (17e-3**2 * sheared.rotation + 1 / sheared.sway_stiffness))
    assert list(numbers("circular_notch_pivot").values()) == pytest.approx(expected, rel=3e-4)


def test_the_bridges_have_the_numbers_of_their_formulas() -> None:
    young, tilt = fd.materials["Al 6061-T6"].youngs_modulus, math.radians(10)
    cot = 1 / math.tan(tilt)
    leaf = published_bridges.rhombic_leaf(young, 10e-3, 1e-3, 15e-3 * math.cos(tilt), 15e-3 * math.sin(tilt))
    assert list(numbers("ling2019_rhombic").values()) == pytest.approx([-cot, -leaf], rel=1e-4)
    hinge = notch.leaf(young, 10e-3, 0.5e-3, 3e-3)
    parallel = published_bridges.parallel(hinge.rotational_stiffness, hinge.axial_stiffness, 12e-3, 2e-3)
    assert list(numbers("ling2019_parallel").values()) == pytest.approx([-6.0, -parallel], rel=1e-4)
    arm = 1 / (2 / hinge.axial_stiffness + 9e-3 / (young * 4e-3 * 10e-3))
    spans = 12e-3 * math.cos(tilt), 12e-3 * math.sin(tilt)
    aligned = published_bridges.rhombic(hinge.rotational_stiffness, arm, *spans)
    assert list(numbers("ling2019_aligned").values()) == pytest.approx([-cot, -aligned], rel=1e-4)


def test_the_stage_has_the_numbers_of_the_reproduced_paper() -> None:
    """`studies/lin2019.toml` holds every printed number once; the folder repeats those of Table 1."""
    from flexdesign.core import printed_numbers

    paper = printed_numbers.read(ROOT / "studies" / "lin2019.toml")
    for number in folders.read(SHIPPED / "lin2019_stage").numbers:
        axis = {"x": "xy", "z": "z"}[number.boundary[0]]
        assert paper(number.printed.place, f"{number.quantity}_{axis}").text == number.printed.text


def test_the_actuators_shell_has_the_outline_of_its_step_file() -> None:
    """Corners of the section, as the STEP file prints them, in mm."""
    shell = fd.read_design(SHIPPED / "apa300ml" / "apa300ml.toml").part().solid()
    printed = [
        (4.5, 15.00105),
        (4.5, 13.46262),
        (5.2, 12.76262),
        (7.10555, 12.59632),
        (34.55469, 7.76825),
        (39.3969, 2.0),
    ]
    own = [(v.X, v.Y) for v in shell.Vertices()]
    for x, y in printed:
        assert min(math.dist((x, y), corner) for corner in own) < 1e-3
    box = shell.BoundingBox()
    assert (box.xlen, box.ylen) == pytest.approx((78.7938, 30.0021), abs=1e-3)


# --- which effect closes the gap


def published(value: float, quantity: str, neglects: tuple[str, ...] = ()) -> PublishedNumber:
    boundary = {"K_in": "output free", "lambda": "output free", "K_out": "input free"}[quantity]
    return PublishedNumber(quantity, boundary, Printed("here", quantity, f"{value}"), "", "formula", neglects, 2)


@pytest.mark.parametrize(("effect", "quantity"), [("hinge_axial", "lambda"), ("root_flexibility", "K_out")])
def test_a_formula_without_an_effect_is_explained_by_it(effect: str, quantity: str) -> None:
    """The published number is the frame's own without the effect, and ours the frame's with it."""
    model = model_of(fd.read_design("bridge_amplifier"))
    assert model is not None
    boundary = "output free" if quantity == "lambda" else "input free"
    table = StaticTable("", (Row(quantity, boundary, 1.0, None, ""),))
    without = replace(model, effects={name: own for name, own in model.effects.items() if name != effect})
    ratio = float(without.predict(table)[0] / model.predict(table)[0])
    assert abs(ratio - 1) > 0.02
    found = closing(model, published(1.0, quantity), ratio, allowed=1e-3)
    assert found is not None and found.effects == (effect,)
    assert found.remaining == pytest.approx(0.0, abs=1e-9)


def test_a_gap_that_no_effect_makes_is_left_open() -> None:
    model = static_model.of_design(fd.read_design("bridge_amplifier"))
    assert closing(model, published(1.0, "lambda"), 3.0, allowed=1e-3) is None
    assert closing(model, published(1.0, "lambda", ("plane_strain",)), 1.11, allowed=1e-3) is None


def test_what_a_formula_neglects_is_told_where_it_closes_no_gap() -> None:
    """Each effect alone and all of them, by the frame itself without them."""
    model = model_of(fd.read_design("bridge_amplifier"))
    assert model is not None
    names = ("hinge_axial", "plane_strain")
    table = StaticTable("", (Row("lambda", "output free", 1.0, None, ""),))
    kept = {name: own for name, own in model.effects.items() if name not in names}
    together = float(replace(model, effects=kept).predict(table)[0] / model.predict(table)[0]) - 1
    found = neglected_effects(model, published(1.0, "lambda", names))
    assert set(found) == {*names, ""}
    assert found[""] == pytest.approx(together, rel=1e-12)
    assert (1 + found["hinge_axial"]) * (1 + found["plane_strain"]) - 1 == pytest.approx(together, rel=0.05)
    assert neglected_effects(model, published(1.0, "lambda")) == {}


def test_effects_that_may_be_neglected_are_those_of_a_drawing() -> None:
    for path in folders.find():
        for number in folders.read(path).numbers:
            assert {*number.neglects} <= {*statics.BY_DRAWING}


def test_a_part_that_hinges_without_sway_do_not_move_has_a_ladder() -> None:
    """The arms of the rhombic bridge end in blocks that cannot turn: the pseudo-rigid model is rigid, and left out."""
    design = fd.read_design(SHIPPED / "ling2019_rhombic" / "ling2019_rhombic.toml")
    fem = static_model.of_design(design).compliance({}).quantities()
    found = model_hierarchy(design, fem)
    assert found is not None
    assert all(math.isfinite(rung.size) for rung in found.rungs)
    assert found.rungs[-1].size == pytest.approx(0.0, abs=1e-9)
    assert "" not in [rung.effect for rung in found.rungs]


# --- bad folders


def test_a_folder_that_is_not_there() -> None:
    with pytest.raises(InputError, match=r"MECHANISM = leaf_pivott: is no folder .*did you mean leaf_pivot"):
        folders.find(["leaf_pivott"])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("K_out,1,N/mm,,input free,book,formula", r"line 2 = 7 cells: the header has 8"),
        ("K_out,one,N/mm,,input free,book,formula,", r"line 2, column value = one: is no number"),
        ("K_out,1,N/mm,-1,input free,book,formula,", r"line 2, column sigma = -1: is no number"),
        ("K_out,1,N/mm,,input free,book,guess,", r"line 2, column kind = guess: is none of formula, simulation"),
        (
            "K_out,1,N/mm,,input free,book,formula,hinge_shea",
            r"neglects = hinge_shea: .*did you mean hinge_shear",
        ),
        ("K_out,1,N/mm,,,book,formula,", r"line 2, column boundary: is empty"),
    ],
)
def test_a_line_that_cannot_be_used(line: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "part.toml").write_text((SHIPPED / "leaf_pivot" / "leaf_pivot.toml").read_text())
    (tmp_path / "numbers.csv").write_text(f"{HEAD}\n{line}\n")
    with pytest.raises(InputError, match=message):
        folders.read(tmp_path)


def test_a_note_may_stand_beside_a_number(tmp_path: Path) -> None:
    (tmp_path / "part.toml").write_text((SHIPPED / "leaf_pivot" / "leaf_pivot.toml").read_text())
    (tmp_path / "numbers.csv").write_text(f'{HEAD},note\nK_out,1,N/mm,,input free,book,formula,,"a misprint, surely"\n')
    assert [number.note for number in folders.read(tmp_path).numbers] == ["a misprint, surely"]


def test_a_folder_without_its_two_files(tmp_path: Path) -> None:
    (tmp_path / "numbers.csv").write_text(HEAD)
    with pytest.raises(InputError, match=r"\*.toml = 0 files: has to hold one TOML file"):
        folders.read(tmp_path)


@pytest.mark.slow
def test_the_page_of_one_folder(tmp_path: Path) -> None:
    """The leaf's gap is closed by what a beam has not: roots that give way, and a width that cannot contract."""
    found = fd.published("leaf_pivot", cache=tmp_path / "cache")
    assert found.counted()["differs"] == 0
    beam = found.found.rows[1]
    assert beam.closing is not None and {*beam.closing.effects} == {"root_flexibility", "plane_strain"}
    written = {path.name: path for path in found.report(tmp_path / "page")}
    assert {"report.html", "report.md", "result.json", "gaps.svg"} <= {*written}
    kept = json.loads(written["result.json"].read_text())
    assert len(kept["rows"]) == 2
    picture = Path(written["gaps.svg"]).read_text()
    assert "with the named effects from -0.0" in picture  # the differences [%], and not the places of the rows
    page = Path(written["report.md"]).read_text()
    assert "2 are explained." in page and "| -1.01 % |" in page
