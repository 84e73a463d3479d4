"""Static tables: reading, uncertainty, comparison and diagnosis, on amplifiers that independent hexahedra solved."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flexdesign import design, static_tables
from flexdesign.cli import app
from flexdesign.comparison import tables as comparison
from flexdesign.diagnosis import tables
from flexdesign.effects import statics
from flexdesign.errors import InputError
from flexdesign.static_tables import Row, StaticModel, StaticTable
from studies.static_trial.__main__ import is_right
from studies.static_trial.cases import case

BRIDGE = design.read(design.find("bridge_amplifier"))
MODEL = static_tables.of_design(BRIDGE)
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
    first, second, third = static_tables.read([path], BRIDGE).rows
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
        static_tables.read([written(tmp_path, text, head)], BRIDGE)
    for word in words:
        assert word in str(error.value)


def test_a_value_a_thousand_times_too_large_is_a_wrong_unit(tmp_path):
    table = static_tables.read([written(tmp_path, "K_in,1950,N/um,,free,\n")], BRIDGE)
    with pytest.raises(InputError, match="1000 times"):
        tables.diagnose(MODEL, table)


def test_what_is_written_is_read_again(tmp_path):
    found = list(MODEL.compliance({}).quantities().values())
    path = tmp_path / "model.csv"
    path.write_text(static_tables.to_csv(found), encoding="utf-8")
    table = static_tables.read([path], BRIDGE)
    assert [row.value for row in table.rows] == pytest.approx([q.value for q in found], rel=1e-6)
    assert MODEL.predict(table) == pytest.approx(table.measured(), rel=1e-6)


# --- uncertainty ------------------------------------------------------------------------------------------------


def test_the_uncertainty_of_the_inputs_is_that_of_many_parts():
    """Against a thousand parts drawn within the tolerances, each with its own dimensions and modulus."""
    rows = tuple(Row(name, boundary, 1.0, 1.0, "") for name, boundary in FREE)
    table = StaticTable("", rows)
    linear = static_tables.uncertainty(MODEL, table).inputs / np.abs(MODEL.predict(table))
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


@pytest.mark.parametrize("number", [0, 7, 12, 19, 23, 33])
@pytest.mark.parametrize(
    "kind",
    ["none", "over_cut", "modulus", "base_compliance", "contact_stiffness", "input_restraint", "output_load",
     "outside: other offset"],
)  # fmt: skip
def test_what_is_hidden_in_independent_tables_is_found(kind, number):
    given = case(number, kind)
    found = tables.diagnose(static_tables.of_design(given.design), given.table)
    assert is_right(given, found), (found.verdict, found.found.names, found.groups)


def test_a_thickness_series_gives_the_over_cut_with_its_interval():
    found = tables.diagnose(MODEL, made({"over_cut": {"thinner": 20e-6}}))
    assert found.verdict == "effects-found"
    assert found.found.names == ("over_cut",)
    assert found.groups == ()
    (value,) = found.found.values
    assert value.interval[0] < 20e-6 < value.interval[1]
    before, after, unseen = (rung.error for rung in found.ladder)
    assert max(after, unseen) < 0.3 * before


def test_one_thickness_cannot_tell_modulus_from_over_cut_and_two_can():
    """Stiffness alone, of one part: a lower modulus and a thinner hinge are one answer, and a series would tell."""
    keys = (("K_in", "output free"), ("K_out", "input free"))
    one = tables.diagnose(MODEL, made({"modulus": {"excess": -0.12}}, [{}], keys))
    assert one.verdict == "effects-found"
    assert {"modulus", "over_cut"} <= {name for group in one.groups for name in group}
    best = one.tellings[0]
    assert best.apart > 0.02
    two = tables.diagnose(MODEL, made({"modulus": {"excess": -0.12}}, SERIES, keys))
    assert two.found.names == ("modulus",)
    assert "over_cut" not in {name for group in two.groups for name in group}


def test_the_pseudo_rigid_model_is_diagnosed_by_its_own_means():
    """Beside the full model, the bare one lacks something that every one of its own effects can be told by."""
    bare = static_tables.of_design(BRIDGE, bare=True)
    found = tables.diagnose(bare, made({}, SERIES, noise=0.002))
    assert found.verdict != "nothing-missing"
    assert found.tried[0].cost < found.before.cost


def test_adding_says_whether_it_is_needed():
    needless = tables.add(MODEL, "fillet", made({}))
    assert any("not needed" in remark for remark in needless.remarks)
    needed = tables.add(MODEL, "over_cut", made({"over_cut": {"thinner": 30e-6}}))
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


# --- effects of a user's own -----------------------------------------------------------------------------------

#: The ground block's screws, by way of the base; and hinges whose surface carries nothing, by way of their shape.
SCREWS = '''
"""Screws that give way."""

from flexdesign.model import Adjust, Effect, Parameter


def apply(base, values):
    """Let the ground move along the output."""
    return {**base, "base_compliance": base["base_compliance"] + values["softness"]}


EFFECT = Effect(
    name="loose_screws",
    physics="The screws of the ground block give way.",
    where="below the amplifier",
    reveal="a second sensor",
    remedy="tighten them",
    reference="none",
    parameters=(Parameter("softness", "m/N", "um/N", "motion per output force", 0.0, 1e-7, (0.0, 1e-3)),),
    faces=(Adjust(apply, of="part"),),
)
'''
SKIN = '''
"""A dead surface."""

from dataclasses import replace

from flexdesign.model import Effect, Parameter, Reshape


def shape(member, values):
    """Return what carries."""
    return replace(member, width=member.width - 2 * values["depth"], thickness=member.thickness - 2 * values["depth"])


EFFECT = Effect(
    name="dead_skin",
    physics="The surface carries nothing.",
    where="the hinges",
    reveal="a microscope",
    remedy="etch it off",
    reference="none",
    parameters=(Parameter("depth", "m", "um", "depth of the skin", 0.0, 5e-6, (0.0, 1e-4)),),
    faces=(Reshape(("hinge",), shape),),
)
'''


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A folder with both effects, in which commands run."""
    (tmp_path / "loose_screws.py").write_text(SCREWS, encoding="utf-8")
    (tmp_path / "dead_skin.py").write_text(SKIN, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def table_of(folder, effects):
    lines = [f"{r.quantity},{r.value:.8g},{u},{r.sigma:.3g},{r.boundary},{1e3 * r.dimensions['hinge_thickness']}"
             for r in made(effects).rows for u in ["1" if r.quantity == "lambda" else "N/m"]]  # fmt: skip
    return written(folder, "\n".join(lines) + "\n")


def test_an_effect_of_ones_own_is_the_formula_it_states(own):
    """Screws are in series with the output alone; the skin is a thinner and narrower hinge."""
    plain, path = MODEL.compliance({}).quantities(), str(own / "loose_screws.py")
    soft = StaticModel(BRIDGE, {**MODEL.effects, path: {"softness": 3e-6}}).compliance({}).quantities()
    assert soft["K_out_input_free"].value == pytest.approx(1 / (1 / plain["K_out_input_free"].value + 3e-6), rel=1e-12)
    assert soft["K_in_output_free"].value == plain["K_in_output_free"].value
    bare = static_tables.of_design(BRIDGE, bare=True)
    skin = {str(own / "dead_skin.py"): {"depth": 10e-6}}
    ratio = [StaticModel(BRIDGE, e).compliance({}).quantities()["K_out_input_free"].value for e in (skin, {})]
    t, w = (BRIDGE.dimensions[name] for name in ("hinge_thickness", "width"))
    expected = (1 - 20e-6 / t) ** 3 * (1 - 20e-6 / w)  # K_out = 2 K_r / l_x^2, K_r = E w t^3 / 12 l
    assert not bare.effects
    assert ratio[0] / ratio[1] == pytest.approx(expected, rel=1e-12)


def test_an_effect_of_ones_own_at_its_null_changes_nothing(own):
    for name, parameter in (("loose_screws.py", "softness"), ("dead_skin.py", "depth")):
        with_it = StaticModel(BRIDGE, {**MODEL.effects, str(own / name): {parameter: 0.0}})
        for key, quantity in MODEL.compliance({}).quantities().items():
            assert with_it.compliance({}).quantities()[key].value == quantity.value


def test_an_effect_of_ones_own_is_found_added_and_compared(own):
    path = table_of(own, {"over_cut": {"thinner": 0.0}, "base_compliance": {"compliance": 5e-6}})
    found = run("diagnose", "bridge_amplifier", path, "--effect", "loose_screws.py", "--out", "found", "--json")
    assert found.exit_code == 0, found.output
    result = json.loads(found.stdout)
    assert result["verdict"] == "effects-found"
    assert {"base_compliance", "loose_screws"} == set(result["confusable"][0])
    added = run("add", "bridge_amplifier", "loose_screws.py", path, "-o", "designs/better.toml", "--json")
    assert added.exit_code == 0, added.output
    low, high = json.loads(added.stdout)["effects"]["loose_screws"]["softness"]["interval_95"]
    assert low < 5 < high
    better = own / "designs" / "better.toml"
    assert '[effects."../loose_screws.py"]' in better.read_text(encoding="utf-8")
    read = design.read(better)
    assert list(read.effects) == [str(own / "loose_screws.py")]
    assert (comparison.compare(static_tables.of_design(read), static_tables.read([path], read)).significance < 1).all()
    page = (own / "reports" / "bridge_amplifier_with_loose_screws" / "report.md").read_text(encoding="utf-8")
    assert "loose screws" in page and str(own) not in page


def test_an_effect_of_ones_own_has_a_page(own):
    ended = run("effects", "loose_screws.py", "--json")
    assert ended.exit_code == 0, ended.output
    changes = json.loads(ended.stdout)["signature"]["relative_changes"]
    assert changes["K_in_output_free"] == 0
    assert changes["K_out_input_free"] < 0
    other = run("effects", "dead_skin.py", "--model", "lin2019_amplifier_xy", "--json")
    assert json.loads(other.stdout)["signature"]["design"] == "lin2019_amplifier_xy"


IN_TIME = 'from pathlib import Path\nfrom flexdesign.effects import find\nEFFECT = find("creep")\n'


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("add", "bridge_amplifier", "missing.py", "TABLE"), ("EFFECT", "missing.py", "is no Python file; tried")),
        (("diagnose", "bridge_amplifier", "TABLE", "--effect", "missing.py"), ("--effect", "is no Python file")),
        (
            ("diagnose", "bridge_amplifier", "TABLE", "--effect", "broken.py"),
            ("broken.py", "cannot be loaded", "Syntax"),
        ),
        (("diagnose", "bridge_amplifier", "TABLE", "--effect", "other.py"), ("EFFECT that is no flexdesign.model.Ef",)),
        (("diagnose", "bridge_amplifier", "TABLE", "--effect", "in_time.py"), ("in_time.py", "in time alone", "Term")),
        (("add", "lin2019_stage", "loose_screws.py", "TABLE"), ("EFFECT", "loose_screws.py", "parts at rest alone")),
    ],
)
def test_an_effect_of_ones_own_that_cannot_be_used_is_refused(own, arguments, words):
    (own / "broken.py").write_text("EFFECT = (", encoding="utf-8")
    (own / "other.py").write_text("EFFECT = 3", encoding="utf-8")
    (own / "in_time.py").write_text(IN_TIME, encoding="utf-8")
    path = written(own, "K_in,1950,N/mm,20,free,0.5\n")
    answer = run(*(path if a == "TABLE" else a for a in arguments))
    assert answer.exit_code != 0
    for word in words:
        assert word in str(answer.exception)


def test_an_installed_package_adds_static_effects(own, monkeypatch):
    (own / "their_screws.py").write_text(SCREWS, encoding="utf-8")
    info = own / "their_screws-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-screws\nVersion: 1.0\n", encoding="utf-8")
    places = "[flexdesign.static_effects]\nloose_screws = their_screws:EFFECT\nother_name = their_screws:EFFECT\n"
    (info / "entry_points.txt").write_text(places, encoding="utf-8")
    monkeypatch.syspath_prepend(own)
    forget = (statics.names, statics._added, statics._found)
    for cached in forget:
        cached.cache_clear()
    try:
        assert statics.find("loose_screws").parameters[0].name == "softness"
        with pytest.raises(ValueError, match="is called loose_screws by itself"):
            statics.find("other_name")
        assert {"loose_screws", "over_cut"} < set(statics.names())
        path = table_of(own, {"base_compliance": {"compliance": 5e-6}})
        assert run("add", "bridge_amplifier", "loose_screws", path, "-o", "better.toml").exit_code == 0
        assert list(design.read(own / "better.toml").effects) == ["loose_screws"]
        assert run("effects", "loose_screws", "--json").exit_code == 0
    finally:
        monkeypatch.undo()
        for cached in forget:
            cached.cache_clear()


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
