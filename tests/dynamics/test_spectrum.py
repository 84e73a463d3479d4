"""Frequency responses in closed form beside those measured on the time engine: small multisines, and sines of a size.

After a rise to the bias and two periods a third one is read, and its spectrum divided by that of the command. What is
left between the two is ringing that has not decayed, curvature of the smallest order, and the engine's own error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core.model import Block
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.simulate import Loop, Stage, simulate
from flexdesign.dynamics.spectrum import WorkingPoint, response, shows
from flexdesign.dynamics.stage_model import AxisModel, Driver, Mode
from flexdesign.dynamics.stage_model import Sensor as AxisSensor
from flexdesign.measurements.recordings import FrequencyResponse

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
PERIOD = 1e-4
BASE = AxisModel(118.3, 0.0242, 1e-6)
#: Lines of a multisine of one second [Hz].
LINES = np.array([1, 2, 3, 5, 8, 13, 20, 32, 50, 80, 100, 110, 118, 125, 140, 180, 250, 400])
#: An effect, values unlike those of a fit's beginning, bias [V], and the largest relative difference.
SMALL: list[tuple[str, Mapping[str, float], float, float]] = [
    ("creep", {"per_decade": 0.05, "t0": 0.01}, 0.0, 1e-4),
    ("structural_damping", {"loss_factor": 0.05}, 0.0, 1e-4),
    ("second_mode", {"share": 0.1, "frequency": 250.0}, 0.0, 1e-5),
    ("payload_mass", {"ratio": 0.3}, 0.0, 1e-5),
    ("stiffness_loss", {"ratio": 0.3}, 0.0, 1e-5),
    ("sensor_gain", {"error": 0.1}, 0.0, 1e-5),
    ("sensor_misalignment", {"angle": 0.2}, 0.0, 1e-5),
    ("electrostriction", {"quadratic": 3e-9}, 50.0, 1e-5),
    ("stroke_dependent_amplification", {"slope": 2000.0}, 50.0, 1e-5),
    ("quadratic_stiffness", {"quadratic": 3000.0}, 50.0, 5e-5),
    ("stress_stiffening", {"cubic": 1e8}, 50.0, 5e-5),
    ("preload_loss", {"ratio": 0.2, "onset": 7e-5}, 50.0, 1e-5),
    ("coulomb_friction", {"level": 5e-8, "presliding": 1e-6}, 0.0, 1e-2),
    ("bouc_wen", {"a": 2e-7, "b": 0.02, "c": 0.005}, 0.0, 3e-4),
    ("prandtl_ishlinskii", {"weight": 2e-7}, 0.0, 1e-5),
    ("rate_dependent_hysteresis", {"weight": 2e-7, "threshold": 2.0}, 0.0, 1e-5),
]
#: Hysteresis under one sine of some amplitude about a bias [V].
LARGE: list[tuple[str, Mapping[str, float], float, float, float]] = [
    ("bouc_wen", {"a": 2e-7, "b": 0.02, "c": 0.005}, 0.0, 50.0, 1e-5),
    ("bouc_wen", {"a": 2e-7, "b": 0.02, "c": 0.005}, 50.0, 20.0, 1e-3),
    ("bouc_wen", {"a": 2e-7, "b": 0.02, "n": 1.5}, 0.0, 50.0, 1e-5),
    ("prandtl_ishlinskii", {"weight": 2e-7, "shape": 1.0}, 50.0, 40.0, 1e-6),
    ("rate_dependent_hysteresis", {"weight": 2e-7, "threshold": 2.0, "slope": 3e-3}, 50.0, 20.0, 3e-5),
    ("rate_dependent_hysteresis", {"weight": 2e-7, "threshold": 0.0, "slope": 3e-3}, 50.0, 20.0, 3e-5),
    ("asymmetric_hysteresis", {"strength": 1e-9, "b": 0.02}, 50.0, 40.0, 3e-5),
]


def with_effect(name: str, values: Mapping[str, float], base: AxisModel = BASE) -> AxisModel:
    begun = {p.name: p.start if p.start is not None else 0.0 for p in effects.find(name).parameters}
    return replace(base, effects={**base.effects, name: {**begun, **values}})


def respond(axis: AxisModel, command: Array, delay: float = 0.0, between: str = "smooth", steps: int = 2) -> Array:
    stage = Stage((stages.chain("x", axis),))
    found = simulate(stage, {"x": Loop(command)}, PERIOD, delay=delay, between_samples=between, substeps=steps)
    return found.reading[0]


def rising(bias: float, samples: int) -> Array:
    return bias * 0.5 * (1 - np.cos(np.pi * np.minimum(4 * np.arange(samples) / samples, 1.0)))


def multisine(axis: AxisModel, bias: float, delay: float = 0.0, between: str = "smooth") -> Complex:
    """Return reading over command at the lines, from a multisine of a millivolt."""
    count = round(1 / PERIOD)
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, len(LINES))
    wave = np.sin(2 * np.pi * PERIOD * np.outer(np.arange(count), LINES) + phases).sum(axis=1)
    wave *= 1e-3 / np.abs(wave).max()
    command = np.concatenate([rising(bias, count), *[bias + wave] * 3, [bias + wave[0]]])
    read = respond(axis, command, delay, between)[-count - 1 : -1]
    return np.asarray(np.fft.rfft(read)[LINES] / np.fft.rfft(wave)[LINES])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("name", "values", "bias", "tolerance"), SMALL, ids=[each[0] for each in SMALL])
def test_small_sines_pass_an_effect_as_the_engine_has_it(
    name: str, values: Mapping[str, float], bias: float, tolerance: float, sign: float
) -> None:
    """The difference without the effect is at least ten times the tolerance somewhere."""
    base = replace(BASE, gain=sign * BASE.gain)
    axis, f = with_effect(name, values, base), LINES.astype(float)
    measured, about = multisine(axis, bias), WorkingPoint(bias)
    assert np.abs(response(stages.chain("x", axis), f, about) / measured - 1).max() < tolerance
    assert np.abs(response(stages.chain("x", base), f, about) / measured - 1).max() > 10 * tolerance


def test_small_sines_do_not_show_a_hysteretic_spring() -> None:
    """Its stiffness is that of small motions."""
    axis = with_effect("hysteretic_spring", {"share": 0.5, "gamma": 1e4})
    with_it, without = multisine(axis, 0.0), multisine(BASE, 0.0)
    assert np.abs(with_it / without - 1).max() < 1e-3
    found, plain = (response(stages.chain("x", of), LINES.astype(float), WorkingPoint(0.0)) for of in (axis, BASE))
    assert found == pytest.approx(plain, rel=1e-12)


@pytest.mark.parametrize(("name", "values", "bias", "size", "tolerance"), LARGE)
def test_hysteresis_answers_a_sine_of_a_size_with_its_describing_function(
    name: str, values: Mapping[str, float], bias: float, size: float, tolerance: float
) -> None:
    frequency, cycles = 5.0, 6
    axis, count = with_effect(name, values), round(1 / (5.0 * PERIOD))
    wave = bias + size * np.sin(2 * np.pi * np.arange(count * cycles + 1) / count)
    read = respond(axis, np.concatenate([rising(bias, 4000), wave]), steps=4)[-count - 1 : -1]
    measured = np.fft.rfft(read)[1] / np.fft.rfft(wave[-count - 1 : -1])[1]
    (found,) = response(stages.chain("x", axis), np.array([frequency]), WorkingPoint(bias, size))
    assert abs(found / measured - 1) < tolerance


def test_small_sines_pass_a_whole_chain_as_the_engine_has_it() -> None:
    """Amplifier, lags on both sides, a further mode, hysteresis, three effects that hang on the bias, and a delay."""
    base = replace(
        BASE,
        gain=-2e-7,
        driver=Driver(gain=5.0, bandwidth=300.0),
        sensor=AxisSensor(bandwidth=500.0),
        modes=(Mode(260.0, 0.01, 0.05),),
    )
    for name, values in (
        ("electrostriction", {"quadratic": 1e-9}),
        ("stroke_dependent_amplification", {"slope": 1000.0}),
        ("stress_stiffening", {"cubic": 5e7}),
        ("prandtl_ishlinskii", {"weight": 2e-8}),
    ):
        base = with_effect(name, values, base)
    measured = multisine(base, 10.0, delay=3.7e-4)
    found = response(stages.chain("x", base), LINES.astype(float), WorkingPoint(10.0, delay=3.7e-4))
    assert np.abs(found / measured - 1).max() < 1e-3


def test_a_held_command_lags_by_half_a_sample_and_shows_its_images() -> None:
    axis, f = replace(BASE, driver=Driver(bandwidth=800.0)), LINES.astype(float)
    measured = multisine(axis, 0.0, delay=2.5e-4, between="hold")
    chain, held = stages.chain("x", axis), WorkingPoint(delay=2.5e-4, period=PERIOD)
    assert np.abs(response(chain, f, held) / measured - 1).max() < 1e-5
    late = WorkingPoint(delay=2.5e-4 + 0.5 * PERIOD)
    assert 1e-3 < np.abs(response(chain, f, late) / measured - 1).max() < 1e-2


def test_what_small_sines_cannot_show_is_no_matter_of_frequency_responses() -> None:
    shown = {name for name in effects.names() if shows(effects.find(name))}
    assert {each[0] for each in SMALL} | {each[0] for each in LARGE} < shown
    assert shown - {each[0] for each in SMALL} - {each[0] for each in LARGE} == {
        "driver_bandwidth",
        "sensor_bandwidth",
        "sensor_delay",
        "transport_delay",
    }
    blocks = [face for name in effects.names() for face in effects.find(name).faces if isinstance(face, Block)]
    assert all(block.transfer is not None for block in blocks if block.settled is not None)


def test_an_axis_predicts_a_response_in_its_own_unit_per_volt_of_what_drove_it() -> None:
    """At the stack there is neither amplifier nor delay; a known mass lowers the resonance by its square root."""
    axis = replace(
        BASE, mass=0.03, stiffness=0.03 * (2 * np.pi * 118.3) ** 2, driver=Driver(gain=10.0, bandwidth=200.0)
    )
    model, f = AxisDynamics("x", axis, delay=1e-3), np.linspace(5.0, 200.0, 20)
    mode = lambda f0, zeta: 1e-6 / (1 - (f / f0) ** 2 + 2j * zeta * f / f0)  # noqa: E731
    sent = FrequencyResponse("sent", f, np.zeros(20, complex))
    expected = 10.0 * mode(118.3, 0.0242) / (1 + 1j * f / 200.0) * np.exp(-2j * np.pi * f * 1e-3)
    assert model.response(sent) == pytest.approx(expected, rel=1e-12)
    at_stack = replace(sent, command_is="stack", payload=0.01)
    slower = np.sqrt(0.03 / 0.04)
    assert model.response(at_stack) == pytest.approx(mode(118.3 * slower, 0.0242 * slower), rel=1e-12)
    assert model.predict(at_stack) == pytest.approx(
        np.concatenate([model.response(at_stack).real, model.response(at_stack).imag])
    )
