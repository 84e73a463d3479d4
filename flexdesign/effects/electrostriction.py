"""Electrostriction: a part of the extension grows with the square of the voltage."""

from __future__ import annotations

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the extension per square of the voltage."""
    return (values["quadratic"],)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Add quadratic v^2; upside down the voltage has the same square."""
    for node in range(3):
        out[node] += constants[0] * path[node] * path[node]


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the slope of the parabola at the bias."""
    return 2.0 * values["quadratic"] * bias


def settled(values: Values, bias: float) -> float:
    """Return quadratic v^2."""
    return values["quadratic"] * bias * bias


EFFECT = Effect(
    name="electrostriction",
    physics=(
        "The ceramic's strain has a part that goes with the square of the field, and the piezoelectric coefficient "
        "itself grows with the field as more domain walls move: the gain is larger at high voltage than at low."
    ),
    where="the piezo stack, between its voltage and its extension",
    reveal="small sines about several bias voltages: the gain grows with the bias; second harmonic of a large sine",
    remedy="the square in the feedforward, or feedback from a position sensor",
    remedies={
        PIEZO: "the square in the feedforward, a charge amplifier, or feedback from a position sensor",
    },
    reference=(
        "D. Damjanovic, Ferroelectric, dielectric and piezoelectric properties of ferroelectric thin films and "
        "ceramics, Rep. Prog. Phys. 61 (1998)"
    ),
    parameters=(
        Parameter("quadratic", "m/V^2", "nm/V^2", "extension per square of the voltage", 0.0, 1e-9, (-1e-8, 1e-8)),
    ),
    faces=(Block(Socket.HYSTERESIS, constants=constants, move=move, transfer=transfer, settled=settled),),
    confused_with=("stroke_dependent_amplification", "quadratic_stiffness"),
    actuators=(PIEZO, "other"),
)
