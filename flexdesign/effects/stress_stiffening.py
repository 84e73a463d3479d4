"""Stress stiffening: guides that stretch as they bend add a force that grows with the cube of travel."""

from __future__ import annotations

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the cubic stiffness over the linear one."""
    return (values["cubic"],)


def flow(drive: float, position: float, velocity: float, state: Floats, rates: Floats, constants: Floats) -> float:
    """Return -k3/k x^3."""
    return -constants[0] * position * position * position


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the slope of the force at a position."""
    return -3.0 * values["cubic"] * bias * bias


def settled(values: Values, bias: float) -> float:
    """Return -k3/k x^3."""
    return -values["cubic"] * bias**3


EFFECT = Effect(
    name="stress_stiffening",
    physics=(
        "A leaf guide clamped at both ends must stretch as it bends; its tension adds a restoring force that grows "
        "with the cube of travel, so that the stage gets stiffer and its resonance rises with amplitude."
    ),
    where="the guides of the moving table",
    reveal="multisines of several levels: the resonance rises with the level; static force over the whole stroke",
    remedy="folded guides that let the ends move, a shorter stroke, or the cubic term in the feedforward",
    reference="S. Awtar and A. H. Slocum, ASME Journal of Mechanical Design 129 (2007), on XY flexure stages",
    parameters=(Parameter("cubic", "1/m^2", "1/mm^2", "cubic stiffness over linear stiffness", 0.0, 1e5, (-1e9, 1e9)),),
    faces=(Block(Socket.FORCE, constants=constants, flow=flow, transfer=transfer, settled=settled),),
    confused_with=("electrostriction", "preload_loss"),
)
