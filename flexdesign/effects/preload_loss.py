"""Loss of preload: a contact opens on one side of a position, and the stiffness is another there.

    f = -ratio min(x - onset, 0)

counted from the force at the start, where the stage is in equilibrium.
"""

from __future__ import annotations

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float, float, float]:
    """Return ratio, onset, and the travel beyond it at the start."""
    return values["ratio"], values["onset"], min(-values["onset"], 0.0)


def pull(begin: float, end: float, state: Floats, constants: Floats) -> float:
    """Return the force of what begins or ends to act below the onset."""
    return -constants[0] * (min(end - constants[1], 0.0) - constants[2])


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the change of stiffness, below the onset."""
    return -values["ratio"] if bias < values["onset"] else 0.0


def settled(values: Values, bias: float) -> float:
    """Return the force at a position, counted from that at the start."""
    ratio, onset, begun = constants(values, 0.0)
    return -ratio * (min(bias - onset, 0.0) - begun)


def cautions(values: Values) -> tuple[str, ...]:
    """Say where no stiffness is left below the onset."""
    if values["ratio"] <= -1.0:
        return (f"preload_loss with a ratio of {values['ratio']:.4g} leaves no stiffness below the onset",)
    return ()


EFFECT = Effect(
    name="preload_loss",
    physics=(
        "The stack is pressed against its seats by a preload. Where that runs out the contact opens, and the stiffness "
        "at the output changes from one value to another at a position: the spring is bilinear."
    ),
    where="the contact between stack and mechanism, or a stop or cable that touches on one side",
    reveal="small multisines about several positions: the resonance has one value below the onset, another above",
    remedy="more preload, stiffer contacts, or a range of motion on one side of the onset",
    remedies={
        PIEZO: "more preload, harder seats, or a range of motion on one side of the onset",
        "motor": "a preloaded nut or gear, stiffer contacts, or a range of motion on one side of the onset",
    },
    reference="S. W. Shaw and P. J. Holmes, A periodically forced piecewise linear oscillator, J. Sound Vib. 90 (1983)",
    parameters=(
        Parameter("ratio", "1", "", "change of stiffness below the onset, relative", 0.0, 0.1, (-0.9, 0.9)),
        Parameter(
            "onset",
            "m",
            "um",
            "position below which it acts",
            None,
            3e-5,
            (-1e-3, 1e-3),
            screen=(-2e-5, 1e-6, 1e-5, 2e-5, 3e-5, 5e-5, 7e-5, 9e-5),
        ),
    ),
    faces=(Block(Socket.FORCE, constants=constants, pull=pull, transfer=transfer, settled=settled),),
    confused_with=("quadratic_stiffness", "stress_stiffening"),
    cautions=cautions,
)
