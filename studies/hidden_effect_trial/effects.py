"""The effects that can be hidden in a stage, and how strong and of what kind they may be there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.hidden_effect_trial.kernel import COUNT, PLAYS, P

Array = NDArray[np.float64]
#: Values of one effect, SI, its strength first.
Values = dict[str, float]


@dataclass(frozen=True)
class Stage:
    """The base of a bench: what a stage model without effects says, true values in SI, and its range.

    Parameters
    ----------
    gain, omega, zeta, a, b, c
        Coefficient of the voltage [m/V], natural frequency [rad/s], damping ratio, Bouc-Wen [m/V, 1/V, 1/V].
    volts
        Commands lie between zero and this [V].
    """

    gain: float
    omega: float
    zeta: float
    a: float
    b: float
    c: float
    volts: float

    @property
    def stroke(self) -> float:
        """Gain times voltage range [m]."""
        return self.gain * self.volts


@dataclass(frozen=True)
class Hidden:
    """An effect.

    Parameters
    ----------
    name
        As the package calls it.
    units
        SI unit of each number; the first is the strength.
    largest
        Strength at which it is as strong as makes sense, on a stage. A limit is "strong" where it is low: then strength
        counts as its reciprocal, or for a voltage level as what it cuts off.
    constants
        Draws the other numbers.
    places
        Where the numbers go in the kernel, and how.
    outside
        Whether no catalogue holds it.
    samples
        Settings of the other parameters that represent all, when the effect is tried in place of another.
    """

    name: str
    units: Mapping[str, str]
    largest: Callable[[Stage], float]
    constants: Callable[[np.random.Generator, Stage], Values] = lambda rng, stage: {}
    places: Mapping[str, tuple[P, Callable[[float], float]]] | None = None
    outside: bool = False
    samples: Callable[[Stage], list[Values]] = lambda stage: [{}]

    @property
    def strength(self) -> str:
        """Name of its strength."""
        return next(iter(self.units))

    def at(self, amount: float, constants: Values, stage: Stage) -> Values:
        """Return its values at an amount between 0, not there, and 1, as strong as makes sense."""
        most = self.largest(stage)
        if self.name == "driver_saturation":
            value = stage.volts - amount * (stage.volts - most)
        elif self.name in INVERSE_STRENGTH:
            value = most / amount if amount > 0 else math.inf
        else:
            value = amount * most
        return {self.strength: value, **constants}


#: Effects that are strong where their strength is low.
INVERSE_STRENGTH = ("driver_bandwidth", "driver_slew", "sensor_bandwidth")


def _as_is(value: float) -> float:
    return value


def _hertz(value: float) -> float:
    return 2.0 * math.pi * value


def _lag(bandwidth: float) -> float:
    return 0.0 if math.isinf(bandwidth) else 1.0 / (2.0 * math.pi * bandwidth)


def _finite(value: float) -> float:
    return 0.0 if math.isinf(value) else value


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


_NATURAL = {"omega": P.OMEGA, "zeta": P.ZETA, "gain": P.GAIN, "a": P.A, "b": P.B, "c": P.C}

CATALOGUE: tuple[Hidden, ...] = (
    Hidden(
        "creep",
        {"per_decade": "1", "t0": "s"},
        lambda stage: 0.1,
        lambda rng, stage: {"t0": _log(rng, 0.05, 0.3)},
        {"per_decade": (P.CREEP, _as_is), "t0": (P.CREEP_T0, _as_is)},
        samples=lambda stage: [{"t0": t0} for t0 in (0.02, 0.1, 0.5)],
    ),
    Hidden("driver_bandwidth", {"bandwidth": "Hz"}, lambda s: 60.0, places={"bandwidth": (P.DRIVER_LAG, _lag)}),
    Hidden("driver_slew", {"slew": "V/s"}, lambda s: 10.0 * s.volts, places={"slew": (P.SLEW, _finite)}),
    Hidden("driver_saturation", {"level": "V"}, lambda s: 0.7 * s.volts, places={"level": (P.LEVEL, _finite)}),
    Hidden("transport_delay", {"delay": "s"}, lambda stage: 0.01),
    Hidden(
        "electrostriction",
        {"quadratic": "1/V"},
        lambda s: 0.3 / s.volts,
        places={"quadratic": (P.ELECTROSTRICTION, _as_is)},
    ),
    Hidden(
        "prandtl_ishlinskii",
        {"weight": "m/V", "reach": "V", "shape": "1"},
        lambda s: 0.4 * s.gain,
        lambda rng, s: {"reach": s.volts * _uniform(rng, 0.2, 0.8), "shape": 0.0},
        {"weight": (P.PLAY_WEIGHT, _as_is), "reach": (P.PLAY_REACH, _as_is), "shape": (P.PLAY_SHAPE, _as_is)},
        samples=lambda s: [{"reach": s.volts * share, "shape": 0.0} for share in (0.1, 0.3, 0.8)],
    ),
    Hidden(
        "asymmetric_hysteresis",
        {"strength": "m/V^2", "b": "1/V"},
        lambda s: 0.15 * s.gain / s.volts,
        lambda rng, s: {"b": _log(rng, 1.0, 3.0) / s.volts},
        {"strength": (P.ASYMMETRY, _as_is), "b": (P.ASYMMETRY_B, _as_is)},
        samples=lambda s: [{"b": share / s.volts} for share in (0.7, 2.0, 5.0)],
    ),
    Hidden(
        "rate_dependent_hysteresis",
        {"weight": "m/V", "threshold": "V", "slope": "s"},
        lambda s: 0.4 * s.gain,
        lambda rng, s: {
            "threshold": s.volts * _uniform(rng, 0.02, 0.08),
            "slope": s.volts * _log(rng, 0.02, 0.1) / (2.0 * math.pi * 20.0 * 0.4 * s.volts),
        },
        {
            "weight": (P.RATE_WEIGHT, _as_is),
            "threshold": (P.RATE_THRESHOLD, _as_is),
            "slope": (P.RATE_SLOPE, _as_is),
        },
        samples=lambda s: [{"threshold": r * s.volts, "slope": k} for r in (0.03, 0.1) for k in (4e-4, 1.5e-3)],
    ),
    Hidden("stress_stiffening", {"cubic": "1/m^2"}, lambda s: 0.3 / s.stroke**2, places={"cubic": (P.CUBIC, _as_is)}),
    Hidden(
        "quadratic_stiffness",
        {"quadratic": "1/m"},
        lambda s: 0.3 / s.stroke,
        places={"quadratic": (P.QUADRATIC, _as_is)},
    ),
    Hidden(
        "coulomb_friction",
        {"level": "m", "presliding": "m"},
        lambda s: 0.05 * s.stroke,
        lambda rng, s: {"presliding": s.stroke * _log(rng, 0.002, 0.02)},
        {"level": (P.FRICTION, _as_is), "presliding": (P.PRESLIDING, _as_is)},
        samples=lambda s: [{"presliding": share * s.stroke} for share in (0.003, 0.02)],
    ),
    Hidden("structural_damping", {"loss_factor": "1"}, lambda s: 0.1, places={"loss_factor": (P.LOSS, _as_is)}),
    Hidden(
        "preload_loss",
        {"ratio": "1", "onset": "m"},
        lambda s: 0.6,
        lambda rng, s: {"onset": s.stroke * _uniform(rng, 0.15, 0.4)},
        {"ratio": (P.OPENING, _as_is), "onset": (P.ONSET, _as_is)},
        samples=lambda s: [{"onset": share * s.stroke} for share in (0.1, 0.25, 0.45)],
    ),
    Hidden(
        "second_mode",
        {"share": "1", "frequency": "Hz", "damping_ratio": "1"},
        lambda s: 0.2,
        lambda rng, s: {
            "frequency": s.omega / (2.0 * math.pi) * _uniform(rng, 1.5, min(3.0, 2.7e3 / s.omega)),
            "damping_ratio": _log(rng, 0.01, 0.04),
        },
        {"share": (P.SHARE, _as_is), "frequency": (P.OMEGA_2, _hertz), "damping_ratio": (P.ZETA_2, _as_is)},
        samples=lambda s: [
            {"frequency": s.omega / (2.0 * math.pi) * ratio, "damping_ratio": 0.02} for ratio in (1.4, 2.0, 3.0)
        ],
    ),
    Hidden("payload_mass", {"ratio": "1"}, lambda s: 0.5),
    Hidden("stiffness_loss", {"ratio": "1"}, lambda s: 0.35),
    Hidden(
        "stroke_dependent_amplification",
        {"slope": "1/m"},
        lambda s: 0.3 / s.stroke,
        places={"slope": (P.AMPLIFICATION, _as_is)},
    ),
    Hidden("sensor_bandwidth", {"bandwidth": "Hz"}, lambda s: 60.0, places={"bandwidth": (P.SENSOR_LAG, _lag)}),
    Hidden("quantisation", {"step": "m"}, lambda s: 0.02 * s.stroke),
    Hidden("sensor_drift", {"rate": "m/s"}, lambda s: 0.02 * s.stroke),
    Hidden(
        "mains_hum",
        {"amplitude": "m", "frequency": "Hz"},
        lambda s: 0.03 * s.stroke,
        lambda rng, s: {"frequency": float(rng.choice([50.0, 60.0]))},
        samples=lambda s: [{"frequency": 50.0}, {"frequency": 60.0}],
    ),
    Hidden(
        "base_motion",
        {"amplitude": "m", "frequency": "Hz"},
        lambda s: 0.03 * s.stroke,
        lambda rng, s: {"frequency": _uniform(rng, 8.0, 45.0)},
        {"amplitude": (P.SHAKE, _as_is), "frequency": (P.SHAKE_HZ, _as_is)},
        samples=lambda s: [{"frequency": 50.0}, {"frequency": 60.0}],
    ),
    Hidden("bouc_wen", {"a": "m/V", "b": "1/V", "c": "1/V"}, lambda s: s.a, lambda rng, s: {"b": s.b, "c": s.c}),
)

OUTSIDE: tuple[Hidden, ...] = (
    Hidden("quadratic_sensor", {"share": "1"}, lambda s: 0.05, outside=True),
    Hidden("s_shaped_sensor", {"share": "1"}, lambda s: 0.05, outside=True),
    Hidden("backlash", {"slack": "m"}, lambda s: 0.02 * s.stroke, places={"slack": (P.SLACK, _as_is)}, outside=True),
    Hidden(
        "contact_spring",
        {"ratio": "1", "low": "m", "high": "m"},
        lambda s: 0.8,
        lambda rng, s: (lambda low: {"low": low, "high": low + s.stroke * _uniform(rng, 0.08, 0.2)})(
            s.stroke * _uniform(rng, 0.25, 0.5)
        ),
        {"ratio": (P.STOP_STIFFNESS, _as_is), "low": (P.STOP_LOW, _as_is), "high": (P.STOP_HIGH, _as_is)},
        outside=True,
    ),
    Hidden("telegraph_jump", {"jump": "m"}, lambda s: 0.05 * s.stroke, outside=True),
    Hidden(
        "quadratic_drag",
        {"drag": "s^2/m"},
        lambda s: 2.0 / (s.stroke * s.omega**2),
        places={"drag": (P.DRAG, _as_is)},
        outside=True,
    ),
    Hidden(
        "interpolation_error",
        {"amplitude": "m", "pitch": "m"},
        lambda s: 0.03 * s.stroke,
        lambda rng, s: {"pitch": s.stroke * _log(rng, 0.02, 0.1)},
        outside=True,
    ),
    Hidden("stick_slip", {"kick": "m/s"}, lambda s: 0.1 * s.stroke * s.omega, outside=True),
    Hidden(
        "two_slope_gain",
        {"slope": "1", "knee": "m"},
        lambda s: 0.3,
        lambda rng, s: {"knee": s.stroke * _uniform(rng, 0.35, 0.6)},
        {"slope": (P.KNEE_SLOPE, _as_is), "knee": (P.KNEE, _as_is)},
        outside=True,
    ),
    Hidden("lost_samples", {"share": "1"}, lambda s: 0.3, outside=True),
)

#: Friction as others write it, F tanh(v / v_s): an effect of the catalogue by another law.
SMOOTH_FRICTION = Hidden(
    "smooth_friction",
    {"level": "m", "speed": "m/s"},
    lambda s: 0.05 * s.stroke,
    lambda rng, s: {"speed": _log(rng, 20e-6, 100e-6)},
    {"level": (P.SMOOTH_LEVEL, _as_is), "speed": (P.SMOOTH_SPEED, _as_is)},
)
#: What the catalogue calls an effect that has another name here.
CATALOGUE_NAMES = {SMOOTH_FRICTION.name: "coulomb_friction"}

BY_NAME: dict[str, Hidden] = {effect.name: effect for effect in (*CATALOGUE, *OUTSIDE, SMOOTH_FRICTION)}


def vector(stage: Stage, effects: Mapping[str, Values]) -> Array:
    """Return the kernel's parameters of a stage with effects.

    A payload lowers frequency and damping ratio; lost stiffness lowers the frequency, and raises gain and damping
    ratio. Both stand at constant damping coefficient.
    """
    p = np.zeros(COUNT)
    for name, place in _NATURAL.items():
        p[place] = getattr(stage, name)
    if "bouc_wen" in effects:
        p[P.A], p[P.B], p[P.C] = (effects["bouc_wen"][name] for name in ("a", "b", "c"))
    if "payload_mass" in effects:
        share = math.sqrt(1.0 + effects["payload_mass"]["ratio"])
        p[P.OMEGA], p[P.ZETA] = p[P.OMEGA] / share, p[P.ZETA] / share
    if "stiffness_loss" in effects:
        left = 1.0 - effects["stiffness_loss"]["ratio"]
        p[P.OMEGA] *= math.sqrt(left)
        p[P.ZETA] /= math.sqrt(left)
        p[P.GAIN] /= left
    for name, values in effects.items():
        for key, (place, turned) in (BY_NAME[name].places or {}).items():
            p[place] = turned(values[key])
    # The weights of all plays add up to the one that is stated.
    p[P.PLAY_WEIGHT] /= np.exp(-p[P.PLAY_SHAPE] * np.arange(1, PLAYS + 1) / PLAYS).mean()
    return p
