"""Saturation of the voltage amplifier: its supply ends before the command does."""

from __future__ import annotations

import math

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the level."""
    return (values["level"],)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Cut the voltage off at the level, above and below."""
    for node in range(3):
        out[node] += min(max(path[node], -constants[0]), constants[0])


EFFECT = Effect(
    name="driver_saturation",
    physics=(
        "The amplifier cannot give more than its supply: commands beyond are cut off flat, and the stage stands still "
        "while the command goes on."
    ),
    where="the voltage amplifier, between command and stack",
    reveal="a slow sine over the whole range of commands: its top is flat, and stays so however slow it is",
    remedy="commands within the range, an amplifier with a higher supply, or limits and anti-windup in the controller",
    reference="A. J. Fleming and K. K. Leang, Design, Modeling and Control of Nanopositioning Systems (2014)",
    parameters=(
        Parameter(
            "level",
            "V",
            "V",
            "largest voltage of either sign",
            math.inf,
            90.0,
            (0.1, 1e4),
            "inverse",
            screen=(55.0, 70.0, 82.0, 90.0, 94.0, 97.0, 98.5, 99.3),
        ),
    ),
    faces=(Block(Socket.DRIVER, mode="replace", constants=constants, move=move),),
    confused_with=("driver_slew", "electrostriction"),
)
