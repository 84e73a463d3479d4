"""Mismatch of paired actuators: two stacks that drive another axis together differ, and push this one too."""

from __future__ import annotations

from collections.abc import Mapping

from flexdesign.core.model import OTHER, PIEZO, Disturbance, Effect, Parameter
from flexdesign.core.model.effect import Floats, Values


def reading(values: Values, recorded: Mapping[str, Floats], time: Floats) -> Floats:
    """Return what the difference of the other axis' pair moves here."""
    return values["ratio"] * recorded[OTHER]


EFFECT = Effect(
    name="pair_mismatch",
    physics=(
        "An axis is driven by two stacks, one on each side. If one extends more than the other the table is drawn "
        "sideways, so that this axis moves in proportion to the other."
    ),
    where="the pair of stacks, or of amplifiers, of another axis",
    reveal="each stack of the other axis driven alone: their effects on this axis do not cancel",
    remedy="select actuators in pairs, trim one amplifier's gain, or take the coupling out of the commands",
    remedies={
        PIEZO: "select stacks in pairs, trim one amplifier's gain, or take the coupling out of the commands",
    },
    reference=(
        "Y. K. Yong, S. S. Aphale and S. O. R. Moheimani, Design, identification, and control of a flexure-based XY "
        "stage for fast nanoscale positioning, IEEE Trans. Nanotechnol. 8 (2009)"
    ),
    parameters=(Parameter("ratio", "1", "%", "motion per motion of the other axis", 0.0, 0.01, (-0.3, 0.3)),),
    faces=(Disturbance(reading, columns=(OTHER,)),),
    confused_with=("cross_coupling", "abbe_error", "sensor_misalignment"),
    is_linear=True,
    actuators=(PIEZO, "other"),
)
