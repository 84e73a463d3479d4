"""Something pushes against the output."""

from __future__ import annotations

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Add a spring at the output."""
    return {**base, "output_load": base["output_load"] + values["stiffness"]}


EFFECT = Effect(
    name="output_load",
    physics=(
        "A guide, a table or a probe pushes against the output while the input is measured: the amplifier "
        "seems stiffer at its input, and its amplification falls."
    ),
    where="between output and ground",
    reveal="K_in and lambda with and without a known spring at the output",
    remedy="take the load off, or put it into the study as output.load",
    reference="Lin et al. (2019), eqs. (6)-(9)",
    parameters=(
        Parameter("stiffness", "N/m", "N/mm", "stiffness of what the output pushes against", 0.0, 1e3, (0.0, 1e9)),
    ),
    faces=(Adjust(apply, of="part"),),
    confused_with=("hinge_axial", "input_restraint"),
)
