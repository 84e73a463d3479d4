"""Quadratic stiffness: a stage that is stiffer to one side than to the other."""

from __future__ import annotations

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the quadratic stiffness over the linear one."""
    return (values["quadratic"],)


def flow(drive: float, position: float, velocity: float, state: Floats, rates: Floats, constants: Floats) -> float:
    """Return -k2/k x^2."""
    return -constants[0] * position * position


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the slope of the force at a position."""
    return -2.0 * values["quadratic"] * bias


def settled(values: Values, bias: float) -> float:
    """Return -k2/k x^2."""
    return -values["quadratic"] * bias * bias


EFFECT = Effect(
    name="quadratic_stiffness",
    physics=(
        "Curved or inclined guides, and contacts, are stiffer to one side than to the other: stiffness grows or falls "
        "in proportion to travel, and the resonance moves with the working point."
    ),
    where="the guides and joints of the moving table",
    reveal="small multisines about several bias voltages: the resonance moves with the bias, to either side",
    remedy="a symmetric arrangement of the guides, a shorter stroke, or the square in the feedforward",
    reference="A. H. Nayfeh and D. T. Mook, Nonlinear Oscillations (1979)",
    parameters=(
        Parameter("quadratic", "1/m", "1/mm", "quadratic stiffness over linear stiffness", 0.0, 500.0, (-2e4, 2e4)),
    ),
    faces=(Block(Socket.FORCE, constants=constants, flow=flow, transfer=transfer, settled=settled),),
    confused_with=("electrostriction", "stroke_dependent_amplification", "preload_loss"),
)
