"""Amplification that changes over the stroke: a bridge or lever turns as it moves, and its ratio with it."""

from __future__ import annotations

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the slope."""
    return (values["slope"],)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Add slope d^2, with d the drive after hysteresis."""
    for node in range(3):
        out[node] += constants[0] * path[node] * path[node]


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the slope of the parabola at the bias."""
    return 2.0 * values["slope"] * bias


def settled(values: Values, bias: float) -> float:
    """Return slope d^2."""
    return values["slope"] * bias * bias


EFFECT = Effect(
    name="stroke_dependent_amplification",
    physics=(
        "The arms of a bridge or lever turn as the stack extends, so that the amplification changes along the stroke, "
        "by a tenth or so from end to end. It follows the extension, with its hysteresis, not the voltage."
    ),
    where="the amplifying mechanism between stack and table",
    reveal="small sines about several positions, reached from above and from below: the gain belongs to the position",
    remedy="the change over the stroke in the model, a shorter stroke, or feedback from a position sensor",
    remedies={
        PIEZO: "a longer or steeper bridge, the large-displacement amplification in the model, or feedback",
    },
    reference=(
        "N. Lobontiu and E. Garcia, Analytical model of displacement amplification and stiffness optimization for a "
        "class of flexure-based compliant mechanisms, Computers and Structures 81 (2003)"
    ),
    parameters=(
        Parameter("slope", "1/m", "1/mm", "relative growth of the drive with itself", 0.0, 500.0, (-5e3, 5e3)),
    ),
    faces=(Block(Socket.ACTUATOR, constants=constants, move=move, transfer=transfer, settled=settled),),
    confused_with=("electrostriction", "quadratic_stiffness"),
)
