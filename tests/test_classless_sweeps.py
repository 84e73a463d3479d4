"""Designs without a class on the command line: a STEP part is swept, the numbers of a sketch are optimised."""

from __future__ import annotations

from pathlib import Path

import cadquery as cq
import pytest
from typer.testing import CliRunner

import flexdesign as fd
from flexdesign.analytic import static_model
from flexdesign.analytic.static_model import Row, StaticTable
from flexdesign.cli import app
from tests.fem.solids import notched

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.slow
def test_a_step_part_is_swept_over_materials_on_the_command_line(tmp_path: Path) -> None:
    """Stiffness follows Young's modulus; Poisson's ratios of 0.33 and 0.35 change it by less than 2 %."""
    cq.exporters.export(notched((14, 8, 1.5), 0.5), str(tmp_path / "notch.step"))
    (tmp_path / "notch.toml").write_text(
        'format = 1\npart = "notch.step"\nmaterial = "Al 7075-T6"\n[ports.ground]\nplane = "x = min"\n'
        '[ports.input]\nplane = "y = max"\n[ports.output]\nplane = "x = max"\n'
    )
    (tmp_path / "study.toml").write_text(
        'format = 1\ndesign = "notch.toml"\nevaluator = "fem"\nshow = ["K_out_input_free"]\n'
        '[vary]\nmaterial = ["Al 7075-T6", "AZ31B"]\n[mesh]\nlevels = 2\n'
    )
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["sweep", str(tmp_path / "study.toml"), "--jobs", "1", "--out", str(out)])
    assert done.exit_code == 0, done.output
    rows = [line.split(",") for line in (out / "cases.csv").read_text().splitlines() if line[0] != "#"]
    column = next(i for i, name in enumerate(rows[0]) if name.startswith("K_out_input_free"))
    one, other = (float(row[column]) for row in rows[1:3])
    young = [fd.materials[name].youngs_modulus for name in ("Al 7075-T6", "AZ31B")]
    assert one / other == pytest.approx(young[0] / young[1], rel=0.02)


@pytest.mark.slow
def test_the_numbers_of_a_sketch_are_optimised_on_the_command_line(tmp_path: Path) -> None:
    """The stiffest bridge that still amplifies nine times has the hinges at which the model says nine."""
    sketch = ROOT / "geometry" / "sketches" / "bridge.toml"
    (tmp_path / "study.toml").write_text(
        f'format = 1\ndesign = "{sketch}"\nevaluator = "analytic"\n[vary]\n'
        '"dimensions.hinge_thickness" = { from = "0.3 mm", to = "0.8 mm" }\n'
        '[limits]\n"|lambda_output_free|" = "> 9"\n[aim]\nmaximise = "K_in_output_free"\n'
    )
    study, out = str(tmp_path / "study.toml"), tmp_path / "out"
    done = CliRunner().invoke(app, ["optimize", study, "--no-check", "--out", str(out)])
    assert done.exit_code == 0, done.output
    found = fd.read_design(out / "optimum.toml")
    assert 0.7e-3 < found.dimensions["hinge_thickness"] < 0.8e-3
    table = StaticTable("", (Row("lambda", "output free", 1.0, None, ""),))
    assert abs(float(static_model.of_design(found).predict(table)[0])) == pytest.approx(9.0, rel=1e-4)
