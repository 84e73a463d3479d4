"""Saturation of the voltage amplifier: its supply ends before the command does."""

from __future__ import annotations

import math

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the level."""
    return (values["level"],)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Cut the voltage off at the level, above and below; a corner within the step keeps the mean over the step."""
    level = constants[0]
    first, middle, last = _cut(path[0], level), _cut(path[1], level), _cut(path[2], level)
    within = int(first == path[0]) + int(middle == path[1]) + int(last == path[2])
    if 0 < within < 3:  # the parabola through the three values has the mean (first + 4 middle + last) / 6
        mean = 0.5 * (_mean(path[0], path[1], level) + _mean(path[1], path[2], level))
        middle = 1.5 * mean - 0.25 * (first + last)
    out[0] += first
    out[1] += middle
    out[2] += last


def _cut(voltage: float, level: float) -> float:
    return min(max(voltage, -level), level)


def _mean(begin: float, end: float, level: float) -> float:
    """Return the mean of the limited voltage along a straight line between two commands."""
    if begin == end:
        return _cut(begin, level)
    return (_area(end, level) - _area(begin, level)) / (end - begin)


def _area(voltage: float, level: float) -> float:
    """Return the integral of the limited voltage, from zero to a command."""
    return 0.5 * voltage * voltage if abs(voltage) < level else level * (abs(voltage) - 0.5 * level)


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
