"""Limited current of the voltage amplifier: it charges the stack's capacitance at a limited rate."""

from __future__ import annotations

import math

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values

#: A command further from the voltage than this share of what half a step can change has jumped.
ROUNDING = 1e-9
#: A first value nearer to where the voltage was than this share of the step's way would be taken for the voltage by
#: hysteresis, and the parabola's own turn for one of the voltage. Where the ramp ends in the first half of a step, so
#: that the parabola turns, it stays so far off; elsewhere it is the voltage.
APART = 0.02


def constants(values: Values, step: float) -> tuple[float]:
    """Return the largest change of voltage over half a step."""
    return (0.5 * values["slew"] * step,)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Follow the command, no faster than the limit.

    As with a lag, after a jump the first of the three values is set so that their parabola has the ramp's own mean.
    """
    v, most = state[0], constants[0]
    was, mean, middle = v, 0.0, v
    jump, rests = abs(path[0] - v) > ROUNDING * most, abs(path[1] - v) < most
    for half in range(2):
        left = path[half + 1] - v
        change = min(max(left, -most), most)
        # A ramp of the largest rate to `change`, then rest; twice the part of the mean that belongs to this half.
        mean += v + change - 0.5 * change * abs(change) / most
        v = path[half + 1] if change == left else v + change
        out[half + 1] += v
        if half == 0:
            middle = v
    first = was
    if jump:
        aside, least = 3.0 * mean - 4.0 * middle - v - was, APART * abs(v - was)
        first += aside if abs(aside) >= least else math.copysign(least, aside) if rests else 0.0
    out[0] += first
    state[0] = v


EFFECT = Effect(
    name="driver_slew",
    physics="The amplifier's current charges the stack's capacitance at a limited rate, so large steps become ramps.",
    where="the voltage amplifier, between command and stack",
    reveal="steps of several sizes: the rise of large ones takes a time proportional to their size",
    remedy="an amplifier that follows faster, or commands within the limit",
    remedies={
        PIEZO: "an amplifier with more current, less capacitance, or commands within the limit",
        "voice coil": "an amplifier with more voltage for the inductance of the coil, or commands within the limit",
    },
    reference="A. J. Fleming and K. K. Leang, Design, Modeling and Control of Nanopositioning Systems (2014)",
    parameters=(
        Parameter(
            "slew",
            "V/s",
            "V/s",
            "largest rate of the voltage",
            math.inf,
            1e5,
            (1.0, 1e9),
            "inverse",
            screen=(3e2, 1e3, 3e3, 1e4, 3e4, 1e5),
        ),
    ),
    faces=(Block(Socket.DRIVER, mode="replace", states=("v",), constants=constants, move=move),),
    confused_with=("driver_bandwidth", "driver_saturation", "rate_dependent_hysteresis"),
)
