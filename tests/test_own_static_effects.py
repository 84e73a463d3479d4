"""Static effects of a user's own: by path and by entry point, in diagnose, add, effects and designs."""

from __future__ import annotations

import json

import pytest

from flexdesign.analytic import static_model
from flexdesign.analytic.static_model import StaticModel
from flexdesign.design import design
from flexdesign.diagnosis.comparison import static_table as comparison
from flexdesign.effects import statics
from tests.test_static_tables import BRIDGE, MODEL, made, run, written

#: The ground block's screws, by way of the base; and hinges whose surface carries nothing, by way of their shape.
SCREWS = '''
"""Screws that give way."""

from flexdesign import Adjust, Effect, Parameter


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

from flexdesign import Effect, Parameter, Reshape


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
    bare = static_model.of_design(BRIDGE, bare=True)
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
    assert (comparison.compare(static_model.of_design(read), static_model.read([path], read)).significance < 1).all()
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
        (
            ("diagnose", "bridge_amplifier", "TABLE", "--effect", "old.py"),
            ("old.py", "imports from flexdesign.model what is not there", "write from flexdesign import Effect, Param"),
        ),
        (
            ("diagnose", "bridge_amplifier", "TABLE", "--effect", "other.py"),
            ("EFFECT that is no flexdesign.Effect",),
        ),
        (("diagnose", "bridge_amplifier", "TABLE", "--effect", "in_time.py"), ("in_time.py", "in time alone", "Term")),
        (("add", "lin2019_stage", "loose_screws.py", "TABLE"), ("EFFECT", "loose_screws.py", "parts at rest alone")),
    ],
)
def test_an_effect_of_ones_own_that_cannot_be_used_is_refused(own, arguments, words):
    (own / "broken.py").write_text("EFFECT = (", encoding="utf-8")
    (own / "old.py").write_text(
        SCREWS.replace("from flexdesign import", "from flexdesign.model import"), encoding="utf-8"
    )
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
    forget = (statics.names, statics._entry_points, statics._load)
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
