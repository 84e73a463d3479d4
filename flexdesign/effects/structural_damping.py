"""Structural damping: a loss factor that hardly depends on frequency, as materials and joints have it.

A constant loss factor over all frequencies is not causal. Over a band it is the sum of relaxations, spaced evenly over
the logarithm of frequency,

    f = -sum g (x - y_i),  tau_i y_i' = x - y_i

whose loss is g w tau / (1 + (w tau)^2) each: with the ratio R between neighbours their sum is g pi / (2 ln R), with a
ripple of 2 / cosh(pi^2 / ln R), less than a thousandth at two in a decade. The relaxations above the band act as a
dashpot within it.

A relaxation that is faster than a step of simulation would ask for shorter steps than the motion does. It is replaced
by one as fast as a step lasts and a dashpot, which have its loss and its storage at low frequencies: g / (1 + j w tau)
has the same first and second moment.

Storage grows with loss: between the ends of the band stiffness rises by g for each relaxation passed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values

#: Corner frequencies: 0.1 Hz to 1 kHz, two in a decade.
LOWEST, TERMS, RATIO = 0.1, 9, math.sqrt(10.0)


def constants(values: Values, step: float) -> tuple[float, ...]:
    """Return a dashpot [s], then for each relaxation its rate [1/s] and stiffness, over that of the stage.

    The dashpot stands for all relaxations above the band, and for those faster than a step.
    """
    g = 2.0 * math.log(RATIO) / math.pi * values["loss_factor"]
    rates = [2 * math.pi * LOWEST * RATIO**i for i in range(TERMS)]
    dashpot = g / (rates[-1] * RATIO) / (1.0 - 1.0 / RATIO)  # the sum of the times of those above the band
    numbers = list[float]()
    for rate in rates:
        slower = min(rate * step, 1.0) / (rate * step) if step else 1.0
        dashpot += g / rate * (1.0 - slower)
        numbers += [slower * rate, slower**2 * g]
    return dashpot, *numbers


def flow(drive: float, position: float, velocity: float, state: Floats, rates: Floats, constants: Floats) -> float:
    """Return the force of all relaxations, and the rates of their states."""
    force = -constants[0] * velocity
    for i in range(TERMS):
        off = position - state[i]
        rates[i] = constants[1 + 2 * i] * off
        force -= constants[2 + 2 * i] * off
    return force


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> NDArray[np.complex128]:
    """Return the force of all relaxations per displacement, over the stiffness."""
    dashpot, *numbers = constants(values, 0.0)
    w = 2j * math.pi * frequency
    pairs = zip(numbers[::2], numbers[1::2], strict=True)
    return np.asarray(-dashpot * w - sum(g * w / (w + rate) for rate, g in pairs))


def relaxing(values: Values) -> list[tuple[float, float]]:
    """Return the time constants of the relaxations, and by what share of the stroke each may be from rest."""
    _, *numbers = constants(values, 0.0)
    return [(1.0 / rate, g) for rate, g in zip(numbers[::2], numbers[1::2], strict=True)]


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
            states=tuple(f"y{i}" for i in range(TERMS)),
            constants=constants,
            flow=flow,
            transfer=transfer,
            relaxing=relaxing,
        ),
    ),
    confused_with=("creep", "hysteretic_spring", "coulomb_friction"),
    is_linear=True,
)
