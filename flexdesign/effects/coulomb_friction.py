"""Coulomb friction with elastic presliding: joints and cables stick, and slide at a constant force.

Dahl's law, which is that of LuGre without the Stribeck effect:

    z' = x' - |x'| z / presliding,  f = -level z / presliding

It depends on the way alone, dz/dp = sigma - z / presliding over the travel p with sigma the sign of the velocity, so
that z is an exponential on every way without a turn. The force is counted from that at the start, where the stage is in
equilibrium.
"""

from __future__ import annotations

import math

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float, float, float]:
    """Return level, one over presliding, and friction at rest over the level."""
    return values["level"], 1.0 / values["presliding"], values.get("rest", 0.0)


def pull(begin: float, end: float, state: Floats, constants: Floats) -> float:
    """Take z / presliding along the way, and return the force over the stiffness."""
    way = end - begin
    left = math.copysign(1.0, way) - constants[2] - state[0]
    state[0] += left * (1.0 - math.exp(-abs(way) * constants[1]))
    return -constants[0] * state[0]


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the elastic force of what sticks: motions far below the presliding do not make it slide."""
    return -values["level"] / values["presliding"]


EFFECT = Effect(
    name="coulomb_friction",
    physics=(
        "A part of the support slides on another: it holds the table elastically until the friction force is reached, "
        "then drags with a constant force against the motion, however slow."
    ),
    where="sliding contacts, dowels, cables and seals between the moving table and the frame",
    reveal="slow triangles and small sines about a point: loops of constant height; small motions see a stiffer stage",
    remedy=(
        "less friction in guides, seals and drive, cables led away softly; its inverse in the feedforward; integral "
        "action with care"
    ),
    remedies={
        PIEZO: (
            "a monolithic flexure, clamps instead of sliding fits, cables led away softly; integral action with care"
        ),
        "voice coil": "a flexure or an air bearing as a guide, cables led away softly; integral action with care",
        "motor": (
            "guides and nut with less preload, a lubricant for slow motion, cables led away softly; its inverse in the "
            "feedforward; integral action with care"
        ),
    },
    reference=(
        "C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, A new model for control of systems with "
        "friction, IEEE Trans. Autom. Control 40 (1995); P. R. Dahl, A solid friction model (1968)"
    ),
    parameters=(
        Parameter("level", "m", "um", "friction force over stiffness", 0.0, 0.5e-6, (0.0, 1e-4), "log"),
        Parameter(
            "presliding",
            "m",
            "um",
            "travel over which it builds up",
            None,
            1e-6,
            (1e-9, 1e-4),
            "log",
            screen=(1e-7, 3e-7, 1e-6, 3e-6, 1e-5),
        ),
        Parameter("rest", "1", "", "friction at the start over its level", None, 0.0, (-1.0, 1.0), per_run=True),
    ),
    faces=(Block(Socket.FORCE, states=("z",), constants=constants, pull=pull, transfer=transfer),),
    confused_with=("hysteretic_spring", "bouc_wen", "structural_damping"),
)
