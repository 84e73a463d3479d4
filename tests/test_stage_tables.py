"""Static tables of a whole stage: read, compared with finite elements, diagnosed; and the ladder of its theory."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flexdesign.analytic import static_model
from flexdesign.analytic.static_model import Row, StaticModel, StaticTable
from flexdesign.cli import app
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design import design
from flexdesign.diagnosis.comparison import static_table as comparison
from flexdesign.diagnosis.static_tables import diagnose
from flexdesign.effects import statics
from flexdesign.workflows.validation import model_hierarchy
from tests.analytic.test_stage_compliance import FEM
from tests.conftest import FOUR_SIDED

STAGE = design.read(FOUR_SIDED)
MODEL = static_model.of_design(STAGE)
HEAD = "quantity,value,unit,sigma,boundary,axis\n"


def quantities(values):
    """Return numbers by their keys as quantities."""
    found = []
    for key, value in values.items():
        axis = "x" if "_x_" in key else "z"
        name, boundary = key.split(f"_{axis}_")
        unit = "1" if name == "lambda" else "N/m"
        found.append(Quantity(name, value, unit, "", f"{axis}, {boundary.replace('_', ' ')}"))
    return found


BENCH = quantities(FEM)


def written(tmp_path, text):
    path = tmp_path / "stage.csv"
    path.write_text(text, encoding="utf-8")
    return path


def made(effects, noise=0.01, seed=1):
    """Return the table of a stage that has effects, as its own model sees it, with noise."""
    asked = [Row(q.name, q.boundary, 1.0, None, "") for q in BENCH if "held" not in q.boundary]
    values = StaticModel(STAGE, {**MODEL.effects, **effects}).predict(StaticTable("", tuple(asked)))
    rng = np.random.default_rng(seed)
    rows = (
        Row(r.quantity, r.boundary, v * (1 + noise * rng.standard_normal()), noise * abs(v), "")
        for r, v in zip(asked, values, strict=True)
    )
    return StaticTable("made", tuple(rows))


# --- reading ------------------------------------------------------------------------------------------------------


def test_a_table_of_a_stage_names_axes(tmp_path):
    path = written(tmp_path, HEAD + "K_in,1.2,N/um,1 %,free,x\nK_out,31,N/mm,,held,z\nlambda,9.6,1,,table free,z\n")
    first, second, third = static_model.read([path], STAGE).rows
    assert (first.key, first.boundary, first.value) == ("K_in_x_table_free", "x, table free", 1.2e6)
    assert (second.key, second.kind, third.key) == ("K_out_z_inputs_held", "K_out_inputs_held", "lambda_z_table_free")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + "K_in,1.2,N/um,,free,w\n", ("line 2, column axis", "w", "is no axis of this stage")),
        (HEAD + "K_in,1.2,N/um,,free,\n", ("column axis", "is no axis")),
        (HEAD + "K_in,1.2,N/um,,held,x\n", ("column boundary", "held", "free")),
        (HEAD.replace(",axis", ",lateral_branches [mm]") + "K_in,1,N/um,,free,2\n", ("no column axis",)),
        (
            "quantity,value,unit,boundary,axis,lateral_branches [mm]\nK_in,1,N/um,free,x,2\n",
            ("lateral_branches", "nor"),
        ),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, text, words):
    with pytest.raises(InputError) as error:
        static_model.read([written(tmp_path, text)], STAGE)
    for word in words:
        assert word in str(error.value)


def test_what_is_written_is_read_again(tmp_path):
    found = list(MODEL.compliance({}).quantities().values())
    table = static_model.read([written(tmp_path, static_model.to_csv(found))], STAGE)
    assert [(row.quantity, row.boundary) for row in table.rows] == [(q.name, q.boundary) for q in found]
    assert MODEL.predict(table) == pytest.approx([q.value for q in found], rel=1e-7)
    assert {(row.quantity, row.boundary) for row in table.rows} == set(static_model.measurable(STAGE))


# --- beside finite elements ---------------------------------------------------------------------------------------


def test_finite_elements_agree_with_the_model_and_not_with_the_papers():
    table = StaticTable("fem", tuple(Row(q.name, q.boundary, q.value, 0.003 * q.value, "") for q in BENCH))
    assert (comparison.compare(MODEL, table).significance < 1).all()
    bare = comparison.compare(static_model.of_design(STAGE, bare=True), StaticTable("", table.rows[:3]))
    assert (bare.significance > 1).all()


@pytest.mark.slow
def test_the_ladder_leads_from_the_papers_formulas_to_finite_elements():
    fem = {quantity.key: quantity for quantity in BENCH}
    fem |= {key.replace("_x_", "_y_"): quantity for key, quantity in fem.items() if "_x_" in key}
    found = model_hierarchy.model_hierarchy(STAGE, fem)
    assert found is not None
    first, *further = found.rungs
    assert {"free_bodies", "out_of_plane", *statics.BY_DRAWING} == {rung.effect for rung in further}
    assert list(first.errors) == [key for key in FEM if key.endswith(("table_free", "inputs_free"))]  # y is as x
    assert first.size > 0.2
    assert further[-1].size < 0.01
    assert 0.005 < found.tolerances["K_out_x_inputs_free"] < 0.1  # 2 % of the modulus, 5 um of 0.25 to 0.63 mm, cubed


# --- diagnosis ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"), [("over_cut", {"thinner": 25e-6}), ("base_compliance", {"compliance": 5e-6})]
)
def test_what_is_hidden_in_a_stage_is_found_with_its_interval(name, values):
    found = diagnose.diagnose(MODEL, made({name: values}))
    assert (found.verdict, found.found.names, found.groups) == ("effects-found", (name,), ())
    (value,) = found.found.values
    assert value.interval[0] < next(iter(values.values())) < value.interval[1]


@pytest.mark.slow
def test_adding_writes_a_design_that_compare_agrees_with(tmp_path):
    rows = made({"modulus": {"excess": -0.12}}).rows
    lines = [
        f"{r.quantity},{r.value:.8g},{'1' if r.quantity == 'lambda' else 'N/m'},{r.sigma:.3g},"
        f"{r.boundary.partition(', ')[2]},{r.boundary[0]}"
        for r in rows
    ]
    path = written(tmp_path, HEAD + "\n".join(lines) + "\n")
    softer = tmp_path / "softer.toml"
    run = CliRunner().invoke
    out = str(tmp_path / "out")
    added = run(app, ["add", str(FOUR_SIDED), "modulus", str(path), "-o", str(softer), "--out", out, "--json"])
    assert added.exit_code == 0, added.output
    low, high = json.loads(added.stdout)["effects"]["modulus"]["excess"]["interval_95"]
    assert low < -12 < high
    read = design.read(softer)
    assert read.is_stage
    table = static_model.read([path], read)
    assert (comparison.compare(static_model.of_design(read), table).significance < 1).all()


def test_effects_of_stages_are_shown_on_a_stage_and_are_none_of_a_part(tmp_path):
    ended = CliRunner().invoke(app, ["effects", "free_bodies", "--out", str(tmp_path / "page"), "--json"])
    assert ended.exit_code == 0, ended.output
    signature = json.loads(ended.stdout)["signature"]
    assert signature["design"] == "lin2019_xyz_stage"
    assert signature["relative_changes"]["K_out_x_inputs_free"] < -0.01
    part = design.read(design.find("bridge_amplifier"))
    assert not set(static_model.nominal_effects(part)) & set(statics.OF_STAGES)
