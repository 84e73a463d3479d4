"""The Python face: what it offers, how light it is, and that ten lines go from a design to a diagnosis."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import flexdesign as fd
from flexdesign.cli.shared import app

ROOT = Path(__file__).resolve().parent.parent
DEMO = ROOT / "studies" / "hidden_effect_demo"
TEN_LINES = f"""
import flexdesign as fd
design = fd.read_design("bridge_amplifier", dimensions={{"hinge_thickness": "0.45 mm"}})
result = fd.validate(design, mesh={{"levels": 2, "at_root": 0.7, "independent": False}}, cache="cache")
print(result["K_in"])
print(len(fd.simulate(result.stage_model).cases))
model, runs = fd.read_model("{DEMO}/model.toml"), fd.read_recordings("{DEMO}/runs")
diagnosis = fd.diagnose(model, runs)
print(diagnosis.verdict, *diagnosis)
print(fd.compare(diagnosis.model, runs).noise.source)
diagnosis.report("out")
"""


def test_ten_lines_go_from_a_design_to_a_diagnosis(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(TEN_LINES)
    assert len(TEN_LINES.strip().splitlines()) == 10
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    stiffness, cases, verdict, _ = done.stdout.splitlines()
    assert stiffness.startswith("K_in (output free) = 1") and stiffness.endswith("N/mm")
    assert int(cases) > 4 and verdict == "effects-found stress_stiffening"
    assert {"report.html", "report.md", "result.json", "stage_model.toml"} <= {
        p.name for p in (tmp_path / "out").iterdir()
    }


def test_every_name_that_is_offered_is_there() -> None:
    assert len(fd.__all__) < 45
    for name in fd.__all__:
        assert getattr(fd, name) is not None, name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = fd.nothing


def test_type_checkers_are_told_the_same_names() -> None:
    """What stands under TYPE_CHECKING is what `__getattr__` finds."""
    tree = ast.parse(Path(fd.__file__).read_text(encoding="utf-8"))
    (guarded,) = (node for node in tree.body if isinstance(node, ast.If))
    told = {alias.name for node in guarded.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert told == set(fd.__all__)


def test_catalogues_are_mappings() -> None:
    assert fd.effects["creep"].name == "creep"
    assert "creep" in fd.effects and len(fd.effects) == len(list(fd.effects)) > 20
    assert fd.materials["Ti-6Al-4V"].youngs_modulus == pytest.approx(113.8e9)
    with pytest.raises(KeyError, match="Ti-6Al-4V"):
        _ = fd.materials["Ti-6Al4V"]


def test_a_simulation_prints_and_shows_itself() -> None:
    found = fd.simulate("lin2019_stage", axis={"x": {"damping_ratio": 0.02}})
    assert "experiments" in str(found) and found.model.axes["x"].damping_ratio == 0.02
    assert found._repr_html_().count("<tr>") == len(found.table.rows) + 1
    assert found.to_dict()["kind"] and list(found.to_dataframe().columns) == list(found.table.columns)


def test_verbs_hold_no_logic() -> None:
    """A command reads options, calls one function of the Python face, and writes."""
    for command in app.registered_commands:
        assert command.callback is not None
    for name in ("validate", "simulate", "compare", "identify", "diagnose", "add", "plan", "sweep", "optimize"):
        tree = ast.parse((ROOT / "flexdesign" / "cli" / f"{name}.py").read_text(encoding="utf-8"))
        modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
        assert any(module.startswith("flexdesign.api") for module in modules), name
        assert not any(
            m.startswith(("flexdesign.fem", "flexdesign.estimation", "flexdesign.workflows")) for m in modules
        )
