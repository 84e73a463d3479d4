"""The command ``python -m studies.hidden_over_cut``."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import cast

import numpy as np

from flexdesign.design import design
from studies.error_bars import bridge
from studies.error_bars.bridge import Bridge, Fineness
from studies.error_bars.trial import LEVELS, extrapolate

FOLDER = Path(__file__).parent
THICKNESSES = (0.35, 0.5, 0.7)
NOISE, SEED = 0.005, 7
ROWS = (
    ("K_in", "K_in_output_free", "N/mm", 1e3, "free"),
    ("lambda", "lambda_output_free", "1", 1.0, "free"),
    ("K_out", "K_out_input_free", "N/mm", 1e3, "free"),
    ("K_out", "K_out_input_held", "N/mm", 1e3, "held"),
)


def main() -> int:
    """Solve the true parts and write what a bench would measure of them."""
    answer = tomllib.loads((FOLDER / "answer.toml").read_text(encoding="utf-8"))
    thinner = float(answer["effects"]["over_cut"]["thinner"].split()[0]) * 1e-3
    rng = np.random.default_rng(SEED)
    lines = ["# Amplifiers of three hinge thicknesses, input and output measured one after the other, 0.5 % noise."]
    lines.append("quantity,value,unit,sigma,boundary,hinge_thickness [mm]")
    for drawn in THICKNESSES:
        true = design.read(design.find("bridge_amplifier"), [f"dimensions.hinge_thickness={drawn - thinner:g} mm"])
        metal, part = true.material, cast(Bridge, true.part())
        print(f"solving {drawn - thinner:g} mm", file=sys.stderr, flush=True)
        meshes = [
            bridge.solve(part, metal.youngs_modulus, metal.poissons_ratio, fineness=Fineness.of(level))
            for level in LEVELS
        ]
        found = extrapolate(*meshes).values
        for quantity, key, unit, scale, boundary in ROWS:
            value = found[key] / scale * (1 + NOISE * rng.standard_normal())
            lines.append(f"{quantity},{value:.5g},{unit},{100 * NOISE:g} %,{boundary},{drawn:g}")
    (FOLDER / "bench.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
