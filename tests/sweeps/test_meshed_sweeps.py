"""Sweeps by finite elements beside the compliance model, and the plane beside space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexdesign.workflows import sweeps
from flexdesign.workflows.sweeps.store import Store

ROOT = Path(__file__).parents[2]
STUDY = f"""format = 1
design = "{ROOT / "geometry" / "lin2019_amplifier_xy.toml"}"
[vary]
"dimensions.hinge_thickness" = {{ from = "0.45 mm", to = "0.55 mm", count = 3 }}
"""
KEYS = ("K_in_output_free", "lambda_output_free", "K_out_input_free", "K_out_actuator_installed", "stroke_output_free")


def swept(folder: Path, evaluator: str) -> sweeps.Sweep:
    path = folder / "study.toml"
    path.write_text(STUDY)
    return sweeps.run(sweeps.read(path, [f"evaluator={evaluator}"]), Store(folder / evaluator), jobs=1)


def test_finite_elements_are_near_the_compliance_model_and_say_how_sure_they_are(tmp_path: Path) -> None:
    """The compliance model is within 3 % of converged FEM over two hundred designs (`studies.theory_against_fem`)."""
    fem, theory = swept(tmp_path, "fem"), swept(tmp_path, "analytic")
    assert not fem.failed
    for key in KEYS:
        assert fem.answers.column(key) == pytest.approx(theory.answers.column(key), rel=0.03)
        assert (np.abs(fem.answers.sigmas[key] / fem.answers.values[key]) < 0.011).all()  # 1 % is what was asked
        assert (fem.answers.sigmas[key] > 0).all()
    assert swept(tmp_path, "fem").computed == 0


@pytest.mark.slow
def test_the_plane_corrected_by_twelve_solids_is_space(tmp_path: Path) -> None:
    planar, fem = swept(tmp_path, "planar"), swept(tmp_path, "fem")
    for key in KEYS:
        assert planar.answers.column(key) == pytest.approx(fem.answers.column(key), rel=0.01)
