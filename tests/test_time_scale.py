"""A diagnosis does not hang on the unit of time: a stage at 5 Hz or 5 kHz gets the answer of one at 100 Hz."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexdesign.core.model import Parameter
from flexdesign.diagnosis import diagnose
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.models_without_physics import mode_response
from flexdesign.dynamics.axis import axis_parameters
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, StageModel
from flexdesign.measurements.noise_level import noise_floor
from flexdesign.measurements.recordings import Run

GAIN, VOLTS, NOISE, SAMPLES = 1e-6, 50.0, 20e-9, 1500
#: The hidden mode: share of the static response, frequency over that of the main one, damping ratio.
SHARE, RATIO, DAMPING_RATIO = 0.06, 2.3, 0.015
SPEEDS = (0.05, 1.0, 50.0)


def run(frequency: float, role: str, seed: int, late: float = 0.0) -> Run:
    """A held random command, at ten samples in a period of the main mode; a late stage has no other mode."""
    rng, period = np.random.default_rng(seed), 0.1 / frequency
    u = VOLTS * np.repeat(rng.uniform(0, 1, SAMPLES // 5), 5)
    main, second = (
        mode_response(u, f, zeta, period)[0] for f, zeta in ((frequency, 0.03), (RATIO * frequency, DAMPING_RATIO))
    )
    share = 0.0 if late else SHARE
    x = GAIN * ((1 - share) * main + share * second)
    x = np.interp(np.arange(SAMPLES) - late / period, np.arange(SAMPLES), x) + NOISE * rng.standard_normal(SAMPLES)
    time = period * np.arange(SAMPLES)
    return Run(f"run{seed}", time, {"u": u, "x": x}, {"u": "V", "x": "m"}, "hold", role, between_is_stated=True)


def design(frequency: float) -> StageModel:
    """The stage without the hidden mode, its numbers off by one and two percent."""
    actuator = ActuatorData(free_stroke=GAIN * VOLTS, voltage_range=(0.0, VOLTS))
    uncertainty = {"natural_frequency": 0.05, "gain": 0.1, "damping_ratio": 1.0}
    axis = AxisModel(1.01 * frequency, 0.03, 1.02 * GAIN, actuator=actuator, uncertainty=uncertainty)
    return StageModel({"x": axis})


@pytest.mark.parametrize("speed", [1e-4, *SPEEDS])
def test_a_second_mode_is_found_at_any_speed(speed: float) -> None:
    frequency = 100.0 * speed
    runs = [run(frequency, "identify", 1), run(frequency, "identify", 2), run(frequency, "validate", 3)]
    found = diagnose(design(frequency), runs)
    assert found.verdict == "effects-found" and [effect.name for effect in found.effects] == ["second_mode"]
    values = {v.parameter.name.rpartition(".")[2]: v.value for v in found.effects[0].values}
    assert values["frequency"] == pytest.approx(RATIO * frequency, rel=1e-3)
    assert values["share"] == pytest.approx(SHARE, rel=0.02)


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_delay_is_found_at_any_speed(speed: float) -> None:
    """Half a period of the mode late; of the slow stage, less than the 50 ms that a controller may take."""
    frequency = 100.0 * speed
    late = min(0.5 / frequency, 0.04)
    runs = [run(frequency, role, seed, late) for seed, role in ((1, "identify"), (2, "identify"), (3, "validate"))]
    found = diagnose(design(frequency), runs)
    (effect,) = (each for each in found.effects if each.name == "transport_delay")
    assert effect.values[0].value == pytest.approx(late, abs=0.05 * 0.1 / frequency)


@pytest.mark.parametrize("speed", [1.0, 7.0, 50.0])
def test_quiet_stretches_show_the_noise_at_any_speed(speed: float) -> None:
    """The samples are the same, and so are the stretches; a mode rings after each step of the command."""
    rng, period = np.random.default_rng(5), 1e-3 / speed
    u = np.repeat([0.0, 20.0, 50.0, 10.0], 700)
    position, _ = mode_response(u, 118.0 * speed, 0.03, period)
    x = GAIN * position + NOISE * rng.standard_normal(len(u))
    seen = Run("steps", period * np.arange(len(u)), {"u": u, "x": x}, {"u": "V", "x": "m"}, "hold")
    floor = noise_floor([seen], "x", settling_time=0.35 / speed)
    assert floor.known and floor.source.startswith("quiet stretches")
    assert floor.rms["steps"] == pytest.approx(NOISE, rel=0.08)


def tried(name: str, axis: AxisModel, highest: float = math.inf) -> list[float]:
    """The first number of each trial of an effect."""
    model = AxisDynamics("x", axis, max_command=VOLTS, highest=highest)
    (candidate,) = (each for each in candidates(model) if each.name == name)
    number = next(n for n in candidate.free if n.endswith(("frequency", "bandwidth", "slew")))
    return sorted({trial[number] for trial in candidate.trials})


@pytest.mark.parametrize("name", ["second_mode", "driver_bandwidth", "sensor_bandwidth", "driver_slew"])
def test_frequencies_are_tried_in_proportion_to_the_natural_frequency(name: str) -> None:
    slow, fast = (tried(name, AxisModel(f, 0.02, GAIN)) for f in (100.0, 300.0))
    assert fast == pytest.approx([3 * value for value in slow])
    # Where the samples do not show the mode, half of the highest frequency that they show counts.
    hidden = tried(name, AxisModel(1e4, 0.02, GAIN), 400.0)
    assert hidden == pytest.approx([2 * value for value in slow if name != "second_mode" or 2 * value < 400.0])


@pytest.mark.parametrize("name", ["base_motion", "mains_hum"])
def test_the_floor_and_the_mains_do_not_follow_the_stage(name: str) -> None:
    assert tried(name, AxisModel(100.0, 0.02, GAIN)) == tried(name, AxisModel(300.0, 0.02, GAIN))


@pytest.mark.parametrize("name", ["second_mode", "driver_bandwidth", "sensor_bandwidth"])
def test_a_slow_stage_may_have_slow_modes_and_lags(name: str) -> None:
    """At 10 mHz the trial values are those of a stage at 100 Hz, a ten thousandth: none is moved to a bound."""
    usual, slow = (tried(name, AxisModel(f, 0.02, GAIN)) for f in (100.0, 0.01))
    assert slow == pytest.approx([1e-4 * value for value in usual])


def test_no_effect_is_tried_at_frequencies_that_the_samples_do_not_show() -> None:
    model = AxisDynamics("x", AxisModel(0.01, 0.02, GAIN), max_command=VOLTS, highest=0.05)
    names = [candidate.name for candidate in candidates(model)]
    assert "second_mode" in names and not {"base_motion", "mains_hum"} & set(names)


def test_the_range_of_a_natural_frequency_ends_at_what_the_samples_show() -> None:
    about = Parameter("natural_frequency", "Hz", "Hz", "of the main mode", plausible=(10.0, 1e5))
    first = AxisModel(100.0, 0.02, GAIN)
    assert axis_parameters.observable_range(about, first, 500.0) == {"plausible": (10.0, 500.0)}
    assert axis_parameters.observable_range(about, first, 50.0) == {"plausible": (10.0, 1.2 * 100.0)}
