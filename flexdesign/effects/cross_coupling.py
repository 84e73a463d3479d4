"""Coupling between axes: guides turn the motion of another axis into motion of this one."""

from __future__ import annotations

from collections.abc import Mapping

from flexdesign.core.model import OTHER, Disturbance, Effect, Parameter
from flexdesign.core.model.effect import Floats, Values


def reading(values: Values, recorded: Mapping[str, Floats], time: Floats) -> Floats:
    """Return the linear and the quadratic part of the other axis' motion."""
    other = recorded[OTHER]
    return (values["linear"] + values["quadratic"] * other) * other


EFFECT = Effect(
    name="cross_coupling",
    physics=(
        "Guides that are not quite square or not quite alike push this axis as another moves, in proportion; leaf "
        "springs that bend also shorten, with the square of the motion."
    ),
    where="the guides that join the axes",
    reveal="the other axis driven alone over its whole range, slowly: a slope and a parabola",
    remedy="a decoupled or mirror-symmetric design, the coupling's inverse in the command, or feedback on both axes",
    reference=(
        "Y. K. Yong, S. S. Aphale and S. O. R. Moheimani, Design, identification, and control of a flexure-based XY "
        "stage for fast nanoscale positioning, IEEE Trans. Nanotechnol. 8 (2009)"
    ),
    parameters=(
        Parameter("linear", "1", "%", "motion per motion of the other axis", 0.0, 0.01, (-0.3, 0.3)),
        Parameter("quadratic", "1/m", "1/mm", "motion per its square", 0.0, 100.0, (-1e4, 1e4)),
    ),
    faces=(Disturbance(reading, columns=(OTHER,)),),
    confused_with=("abbe_error", "sensor_misalignment", "pair_mismatch"),
)
