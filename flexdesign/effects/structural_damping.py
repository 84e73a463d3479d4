"""Structural damping: a loss factor that hardly depends on frequency, as materials and joints have it.

A constant loss factor over all frequencies is not causal. Over a band it is the sum of relaxations, spaced evenly over
the logarithm of frequency,

    f = -sum g (x - y_i),  tau_i y_i' = x - y_i

whose loss is g w tau / (1 + (w tau)^2) each: with the ratio R between neighbours their sum is g pi / (2 ln R), with a
ripple of 2 / cosh(pi^2 / ln R), less than a thousandth at two in a decade. The relaxations above the band act as a
dashpot within it.

Storage grows with loss: between the ends of the band stiffness rises by g for each relaxation passed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import PIEZO, Block, Effect, Maxwell, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values

#: Corner frequencies: 0.1 Hz to 1 kHz, two in a decade.
LOWEST, TERMS, RATIO = 0.1, 9, math.sqrt(10.0)


def maxwell(values: Values) -> Maxwell:
    """Return the relaxations, and a dashpot that stands for all above the band."""
    g = 2.0 * math.log(RATIO) / math.pi * values["loss_factor"]
    rates = [2 * math.pi * LOWEST * RATIO**i for i in range(TERMS)]
    # The sum of the times of those above the band.
    return Maxwell(g / (rates[-1] * RATIO) / (1.0 - 1.0 / RATIO), tuple((rate, g) for rate in rates))


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> NDArray[np.complex128]:
    """Return the force of all relaxations per displacement, over the stiffness."""
    force, w = maxwell(values), 2j * math.pi * frequency
    return np.asarray(-force.dashpot * w - sum(g * w / (w + rate) for rate, g in force.elements))


def relaxing(values: Values) -> list[tuple[float, float]]:
    """Return the time constants of the relaxations, and by what share of the stroke each may be from rest."""
    return [(1.0 / rate, g) for rate, g in maxwell(values).elements]


EFFECT = Effect(
    name="structural_damping",
    physics=(
        "Metal, glue and clamped joints lose the same share of energy in each cycle at any frequency, while a dashpot "
        "loses more the faster it goes: phase lags at frequencies far below the resonance, and slow motion creeps a "
        "little."
    ),
    where="the flexures and clamped joints of the mechanism",
    reveal="a frequency response over three decades: a phase lag that stays as the frequency falls",
    remedy="fewer joints and less glue; in the model, the loss factor in addition to the damping ratio",
    remedies={
        PIEZO: "a monolithic mechanism without glue; in the model, the loss factor in addition to the damping ratio",
    },
    reference="S. H. Crandall, The role of damping in vibration theory, J. Sound Vib. 11 (1970)",
    parameters=(Parameter("loss_factor", "1", "", "energy lost per radian, over that stored", 0.0, 0.01, (0.0, 0.3)),),
    faces=(
        Block(
            Socket.FORCE,
            maxwell=maxwell,
            transfer=transfer,
            relaxing=relaxing,
        ),
    ),
    confused_with=("creep", "hysteretic_spring", "coulomb_friction"),
    is_linear=True,
)
