"""Static tables: reading, uncertainty, comparison and diagnosis, on amplifiers that independent hexahedra solved."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from flexdesign.analytic import static_model
from flexdesign.analytic.static_model import Row, StaticModel, StaticTable
from flexdesign.cli import app
from flexdesign.core.errors import InputError
from flexdesign.design import design
from flexdesign.diagnosis.comparison import static_table as comparison
from flexdesign.diagnosis.static_tables import diagnose
from studies.static_trial.__main__ import is_right
from studies.static_trial.cases import case

BRIDGE = design.read(design.find("bridge_amplifier"))
MODEL = static_model.of_design(BRIDGE)
HEAD = "quantity,value,unit,sigma,boundary,hinge_thickness [mm]\n"
FREE = (("K_in", "output free"), ("lambda", "output free"), ("K_out", "input free"))
SERIES = tuple({"hinge_thickness": t} for t in (0.35e-3, 0.5e-3, 0.7e-3))


def written(tmp_path, text, head=HEAD):
    path = tmp_path / "bench.csv"
    path.write_text(head + text, encoding="utf-8")
    return path


def made(effects, variants=SERIES, keys=FREE, noise=0.01, seed=1):
    """Return the table of a part that has effects, as its own model sees it, with noise."""
    rows = [Row(name, boundary, 1.0, None, "", part) for part in variants for name, boundary in keys]
    rng, blank = np.random.default_rng(seed), StaticTable("made", tuple(rows))
    values = StaticModel(BRIDGE, {**MODEL.effects, **effects}).predict(blank)
    return StaticTable(
        "made",
        tuple(
            Row(r.quantity, r.boundary, v * (1 + noise * rng.standard_normal()), noise * abs(v), "", r.dimensions)
            for r, v in zip(rows, values, strict=True)
        ),
    )


# --- reading ----------------------------------------------------------------------------------------------------


def test_a_table_is_read_in_si(tmp_path):
    path = written(tmp_path, "K_in,1950,N/mm,20,free,0.5\nlambda,-11,1,1 %,free,\nK_out,0.12,N/um,,held,0.4\n")
    first, second, third = static_model.read([path], BRIDGE).rows
    assert (first.quantity, first.boundary, first.value, first.sigma) == ("K_in", "output free", 1.95e6, 2e4)
    assert first.dimensions == {"hinge_thickness": pytest.approx(0.5e-3)}
    assert (second.value, second.sigma, second.dimensions) == (-11.0, pytest.approx(0.11), {})
    assert (third.boundary, third.value, third.sigma) == ("input held", pytest.approx(1.2e5), None)


@pytest.mark.parametrize(
    ("text", "head", "words"),
    [
        ("K_inn,1,N/mm,,free,\n", HEAD, ("line 2, column quantity", "K_inn", "did you mean K_in")),
        ("K_in,1,N/mm,,loose,\n", HEAD, ("column boundary", "loose", "free, held")),
        ("K_in,one,N/mm,,free,\n", HEAD, ("column value", "one", "no number")),
        ("K_in,-5,N/mm,,free,\n", HEAD, ("column value", "-5", "above zero")),
        ("K_in,5,mm,,free,\n", HEAD, ("column unit", "mm")),
        ("K_in,5,N/mm,0,free,\n", HEAD, ("column sigma", "above zero")),
        ("lambda,5,1,,held,\n", HEAD, ("column boundary", "does not move")),
        ("K_in,5,N/mm,,free,500\n", HEAD, ("hinge_thickness", "500", "allowed")),
        ("K_in,5,N/mm,,free\n", HEAD, ("line 2", "5 cells", "header has 6")),
        ("K_in,5,N/mm,,free,1\n", HEAD.replace("hinge_thickness", "hing_thickness"), ("header", "hinge_thickness")),
        ("K_in,5,,free\n", "quantity,value,unit,sigma\n", ("header", "no column boundary")),
        ("", HEAD, ("holds no measurement",)),
        ("", "", ("is empty",)),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, text, head, words):
    with pytest.raises(InputError) as error:
        static_model.read([written(tmp_path, text, head)], BRIDGE)
    for word in words:
        assert word in str(error.value)


def test_a_value_a_thousand_times_too_large_is_a_wrong_unit(tmp_path):
    table = static_model.read([written(tmp_path, "K_in,1950,N/um,,free,\n")], BRIDGE)
    with pytest.raises(InputError, match="1000 times"):
        diagnose.diagnose(MODEL, table)


@pytest.mark.parametrize("value", ["1e308", "-1e308", "1e-300", "3e8"])
def test_a_value_millions_of_times_off_is_refused(tmp_path, value):
    table = static_model.read([written(tmp_path, f"lambda,{value},1,0.1,free,\n")], BRIDGE)
    with pytest.raises(InputError, match="times what the model expects"):
        comparison.compare(MODEL, table)


def test_what_is_written_is_read_again(tmp_path):
    found = list(MODEL.compliance({}).quantities().values())
    path = tmp_path / "model.csv"
    path.write_text(static_model.to_csv(found), encoding="utf-8")
    table = static_model.read([path], BRIDGE)
    assert [row.value for row in table.rows] == pytest.approx([q.value for q in found], rel=1e-6)
    assert MODEL.predict(table) == pytest.approx(table.measured(), rel=1e-6)


# --- uncertainty ------------------------------------------------------------------------------------------------


def test_the_uncertainty_of_the_inputs_is_that_of_many_parts():
    """Against a thousand parts drawn within the tolerances, each with its own dimensions and modulus."""
    rows = tuple(Row(name, boundary, 1.0, 1.0, "") for name, boundary in FREE)
    table = StaticTable("", rows)
    linear = static_model.uncertainty(MODEL, table).inputs / np.abs(table.measured())
    rng, found = np.random.default_rng(0), []
    for _ in range(300):
        larger = {name: rng.uniform(-5e-6, 5e-6) for name, value in BRIDGE.dimensions.items() if value > 0}
        values = StaticModel(BRIDGE, MODEL.effects, larger).predict(table)
        found.append(values * np.array([modulus := 1 + rng.uniform(-0.02, 0.02), 1.0, modulus]))
    assert np.std(found, axis=0) / np.abs(np.mean(found, axis=0)) == pytest.approx(linear, rel=0.12)


def test_a_difference_within_the_uncertainty_says_nothing():
    agreed = comparison.compare(MODEL, made({}))
    assert (agreed.significance < 1).all()
    differs = comparison.compare(MODEL, made({"over_cut": {"thinner": 25e-6}}))
    assert (differs.significance[0::3] > 1).all()  # K_in of each thickness


# --- diagnosis --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (7, 12, 19, 23, 33))])
@pytest.mark.parametrize(
    "kind",
    ["none", "over_cut", "modulus", "base_compliance", "contact_stiffness", "input_restraint", "output_load",
     pytest.param("outside: other offset", marks=pytest.mark.slow)],
)  # fmt: skip
def test_what_is_hidden_in_independent_tables_is_found(kind, number):
    given = case(number, kind)
    found = diagnose.diagnose(static_model.of_design(given.design), given.table)
    assert is_right(given, found), (found.verdict, found.found.names, found.groups)


def test_a_thickness_series_gives_the_over_cut_with_its_interval():
    found = diagnose.diagnose(MODEL, made({"over_cut": {"thinner": 20e-6}}))
    assert found.verdict == "effects-found"
    assert found.found.names == ("over_cut",)
    assert found.groups == ()
    (value,) = found.found.values
    assert value.interval[0] < 20e-6 < value.interval[1]
    before, after, unseen = (rung.error for rung in found.error_ladder)
    assert max(after, unseen) < 0.3 * before


def test_an_effect_that_is_there_or_not_is_before_fitted_ones_that_do_no_better():
    """Long leaves are plates; a fitted modulus is half a percent nearer to four stiffnesses. Lambda is zero."""
    model = static_model.of_design(design.read(design.find("parallelogram_guide")))
    plates = replace(model, effects={**model.effects, "plate_stiffening": {"share": 1.0}})
    blank = StaticTable(
        "", tuple(Row("K_in", "output free", 1.0, None, "", {"length": L}) for L in (0.2, 0.25, 0.35, 0.5))
    )
    values = plates.predict(blank) * (1 + np.array([0.004, 0.0, 0.003, 0.005]))
    rows = (replace(row, value=v, sigma=0.01 * v) for row, v in zip(blank.rows, values, strict=True))
    found = diagnose.diagnose(model, StaticTable("", tuple(rows)))
    assert found.found.names == ("plate_stiffening",)
    assert found.alike[0].cost < found.found.cost
    assert {"modulus", "over_cut"} <= set(found.groups[0])
    assert "lambda" not in {offer.row.quantity for offer in found.proposals}


def test_one_thickness_cannot_tell_modulus_from_over_cut_and_two_can():
    """Stiffness alone, of one part: a lower modulus and a thinner hinge are one answer, and a series would tell."""
    keys = (("K_in", "output free"), ("K_out", "input free"))
    one = diagnose.diagnose(MODEL, made({"modulus": {"excess": -0.12}}, [{}], keys))
    assert one.verdict == "effects-found"
    assert {"modulus", "over_cut"} <= {name for group in one.groups for name in group}
    best = one.proposals[0]
    assert best.apart > 0.02
    two = diagnose.diagnose(MODEL, made({"modulus": {"excess": -0.12}}, SERIES, keys))
    assert two.found.names == ("modulus",)
    assert "over_cut" not in {name for group in two.groups for name in group}


@pytest.mark.slow
def test_the_pseudo_rigid_model_is_diagnosed_by_its_own_means():
    """Beside the full model, the bare one lacks something that every one of its own effects can be told by."""
    bare = static_model.of_design(BRIDGE, bare=True)
    found = diagnose.diagnose(bare, made({}, SERIES, noise=0.002))
    assert found.verdict != "nothing-missing"
    assert found.tried[0].cost < found.before.cost


def test_adding_says_whether_it_is_needed():
    needless = diagnose.add(MODEL, "fillet", made({}))
    assert any("not needed" in remark for remark in needless.remarks)
    needed = diagnose.add(MODEL, "over_cut", made({"over_cut": {"thinner": 30e-6}}))
    assert not needed.remarks


# --- commands ---------------------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def test_diagnose_writes_a_design_that_compare_agrees_with(tmp_path):
    rows = made({"over_cut": {"thinner": 30e-6}}).rows
    lines = [f"{r.quantity},{r.value:.8g},{u},{r.sigma:.3g},{r.boundary},{1e3 * r.dimensions['hinge_thickness']}"
             for r in rows for u in ["1" if r.quantity == "lambda" else "N/m"]]  # fmt: skip
    path = written(tmp_path, "\n".join(lines) + "\n")
    out = tmp_path / "out"
    answer = run("diagnose", "bridge_amplifier", path, "--out", out, "-o", tmp_path / "cut.toml", "--json")
    assert answer.exit_code == 0, answer.output
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["verdict"] == "effects-found"
    assert result["effects"]["over_cut"]["thinner"]["unit"] == "um"
    low, high = result["effects"]["over_cut"]["thinner"]["interval_95"]
    assert low < 30 < high
    again = run("compare", tmp_path / "cut.toml", path, "--out", tmp_path / "again", "--json")
    assert again.exit_code == 0, again.output
    rows_after = json.loads((tmp_path / "again" / "result.json").read_text(encoding="utf-8"))["rows"]
    errors = [abs(r["predicted_si"] / r["measured_si"] - 1) for r in rows_after]
    assert max(errors) < 0.04
    added = run("add", "bridge_amplifier", "over_cut", path, "--out", tmp_path / "added", "--json")
    assert added.exit_code == 0, added.output
    page = (out / "report.md").read_text(encoding="utf-8")
    assert "over cut" in page
    assert "differences_after.svg" in page


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("diagnose", "bridge_amplifier", "TABLE", "--axis", "x"), ("--axis", "not for static tables")),
        (("add", "bridge_amplifier", "overcut", "TABLE"), ("EFFECT", "over_cut")),
        (("diagnose", "lin2019_stage", "TABLE", "--bare"), ("--bare", "designs")),
        (("compare", "lin2019_xyz_stage", "TABLE"), ("header", "no column axis")),
    ],
)
def test_what_cannot_be_asked_is_refused(tmp_path, arguments, words):
    path = written(tmp_path, "K_in,1950,N/mm,20,free,0.5\n")
    answer = run(*(path if a == "TABLE" else a for a in arguments), "--out", tmp_path / "out")
    assert answer.exit_code != 0
    for word in words:
        assert word in str(answer.exception)


def test_a_design_says_what_it_cannot_have(tmp_path):
    text = BRIDGE.file.read_text(encoding="utf-8")
    for more, words in (
        ('[effects.over_cutt]\nthinner = "1 um"\n', ("effects.over_cutt", "over_cut")),
        ("[effects.over_cut]\n", ("effects.over_cut.thinner", "missing")),
        ('[effects.over_cut]\nthinner = "1 mm"\n', ("effects.over_cut.thinner", "allowed")),
        ('[tolerances]\nmodulus = "80 %"\n', ("tolerances.modulus", "allowed")),
    ):
        path = tmp_path / "mine.toml"
        path.write_text(text + more, encoding="utf-8")
        with pytest.raises(InputError) as error:
            design.read(path)
        for word in words:
            assert word in str(error.value)
