"""Something holds the inputs that were said to be free."""

from __future__ import annotations

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Add a spring between the inputs where they are free."""
    return {**base, "input_restraint": base["input_restraint"] + values["stiffness"]}


EFFECT = Effect(
    name="input_restraint",
    physics=(
        "The output was pushed with the actuator still in place, or with the inputs clamped: a number written "
        "down as measured with the input free was measured with it held. The output seems several times "
        "stiffer."
    ),
    where="between the inputs, as K_out is measured",
    reveal="K_out with the actuator out, and with it in: a true pair differs by a known ratio",
    remedy="measure again with the actuator out, or name the boundary that was there",
    reference="K. J. Bathe, Finite Element Procedures (1996), on boundary conditions",
    parameters=(
        Parameter("stiffness", "N/m", "N/um", "stiffness of what holds the inputs", 0.0, 1e7, (1e3, 1e12), "log"),
    ),
    faces=(Adjust(apply, of="part"),),
    confused_with=("modulus",),
)
