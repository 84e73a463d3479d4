"""A restoring force with Bouc-Wen hysteresis in the displacement: friction in joints and clamps, yielding, rubber.

    force / stiffness = (1 - share) x + z
    z' = share x' - gamma |x'| |z|^(nu - 1) z - delta x' |z|^nu

The stiffness is that of small motions (Wen 1976, ASCE Journal of the Engineering Mechanics Division 102, 249-263), so
that natural frequency and gain of small motions do not depend on the share. In the benchmark of J.-P. Noel and M.
Schoukens (2016) z is the force, the elastic spring k and the hysteretic one alpha: share = alpha / (k + alpha).
"""

from __future__ import annotations

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float, ...]:
    """Return share, gamma, delta and nu."""
    return values["share"], values["gamma"], values["delta"], values["nu"]


def flow(drive: float, position: float, velocity: float, state: Floats, rates: Floats, constants: Floats) -> float:
    """Return share x - z, the force less that of the linear spring, and the rate of z."""
    z = state[0]
    size = abs(z) ** (constants[3] - 1.0)
    rates[0] = constants[0] * velocity - size * (constants[1] * abs(velocity) * z + constants[2] * velocity * abs(z))
    return constants[0] * position - z


EFFECT = Effect(
    name="hysteretic_spring",
    physics=(
        "Some of the restoring force depends on where the motion came from: micro-slip in clamped joints, or material "
        "damping. The loop between force and displacement stays open however slow the motion."
    ),
    where="joints, clamps and cables between the moving table and the frame",
    reveal="slow force over displacement with the actuator unpowered; decay that depends on amplitude",
    remedy="joints tightened or bonded, cables led away softly, nothing that slides in the path of the force",
    remedies={
        PIEZO: "a monolithic mechanism, joints tightened or bonded, cables led away softly",
        "motor": "couplings and tendons tightened, nuts and gears preloaded, a sensor at the load",
    },
    reference="J.-P. Noel and M. Schoukens, Hysteretic benchmark with a dynamic nonlinearity (2016)",
    parameters=(
        Parameter("share", "1", "%", "hysteretic part of the stiffness of small motions", 0.0, 0.1, (0.0, 0.99)),
        Parameter(
            "gamma",
            "1/m",
            "1/mm",
            "how fast it saturates (at nu = 1)",
            None,
            1e3,
            (0.0, 1e9),
            screen=(3e3, 1e4, 3e4, 1e5, 3e5),
        ),
        Parameter("delta", "1/m", "1/mm", "how the branches differ (at nu = 1)", None, 0.0, (-1e9, 1e9)),
        Parameter("nu", "1", "", "sharpness of the bend", None, 1.0, (1.0, 5.0)),
    ),
    faces=(Block(Socket.FORCE, states=("z",), constants=constants, flow=flow),),
    is_hysteresis=True,
    confused_with=("coulomb_friction", "structural_damping", "bouc_wen"),
)
