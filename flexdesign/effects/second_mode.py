"""A second mode: a further resonance of the axis, in addition to the main one."""

from __future__ import annotations

from flexdesign.core.model import Effect, Parameter, Resonance
from flexdesign.core.model.effect import Values


def mode(values: Values) -> tuple[float, float, float]:
    """Return frequency, damping ratio and share."""
    return values["frequency"], values["damping_ratio"], values["share"]


EFFECT = Effect(
    name="second_mode",
    physics=(
        "The table rocks, a guide swings by itself, or the frame gives way: a second resonance carries a part of the "
        "motion. Where its share is negative the sensor sees it move against the drive, and there is no antiresonance "
        "between the two."
    ),
    where="the table and its guides, the frame, or the sensor's holder",
    reveal="a multisine beyond the main resonance: a second peak, and an antiresonance before it or none",
    remedy="a stiffer part where the mode lives, a notch or a lower bandwidth in the loop, drive through its node",
    reference="A. J. Fleming and K. K. Leang, Design, Modeling and Control of Nanopositioning Systems (2014)",
    parameters=(
        Parameter("share", "1", "%", "part of the static response", 0.0, 0.02, (-0.5, 0.5)),
        Parameter(
            "frequency",
            "Hz",
            "Hz",
            "its natural frequency",
            None,
            300.0,
            (1.0, 1e5),
            "log",
            screen=(30.0, 50.0, 80.0, 130.0, 200.0, 280.0, 360.0, 450.0),
        ),
        Parameter(
            "damping_ratio", "1", "", "its damping ratio", None, 0.02, (1e-4, 0.3), "log", screen=(0.005, 0.02, 0.1)
        ),
    ),
    faces=(Resonance(mode),),
    confused_with=("driver_bandwidth", "sensor_bandwidth", "payload_mass"),
    is_linear=True,
)
