"""A restoring force with Bouc-Wen hysteresis in the displacement: friction in joints and clamps, yielding, rubber.

    z' = alpha x' - beta (gamma |x'| |z|^(nu - 1) z + delta x' |z|^nu)

with z the force over the stiffness, as in J.-P. Noel and M. Schoukens, Hysteretic benchmark with a dynamic
nonlinearity (2016), where z is the force.
"""

from __future__ import annotations

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float, ...]:
    """Return alpha, gamma, delta (beta and the stiffness in them) and nu."""
    return values["alpha"], values["gamma"], values["delta"], values["nu"]


def flow(drive: float, position: float, velocity: float, state: Floats, rates: Floats, constants: Floats) -> float:
    """Return -z, and the rate of z."""
    z = state[0]
    size = abs(z) ** (constants[3] - 1.0)
    rates[0] = constants[0] * velocity - size * (constants[1] * abs(velocity) * z + constants[2] * velocity * abs(z))
    return -z


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the elastic force of small motions, after which z has come to zero."""
    return -values["alpha"]


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
        Parameter("alpha", "1", "", "stiffness of the hysteretic part over the linear one", 0.0, 0.1, (0.0, 10.0)),
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
    faces=(Block(Socket.FORCE, states=("z",), constants=constants, flow=flow, transfer=transfer),),
    is_hysteresis=True,
    confused_with=("coulomb_friction", "structural_damping", "bouc_wen"),
)
