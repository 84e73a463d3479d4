"""What a record began with: states that relax, and models compared with the initial conditions of each run fitted.

Relaxations are written down here as sums of exponentials and laid beside the simulation of the effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import newton

from flexdesign import effects
from flexdesign.core.model import Block
from flexdesign.diagnosis import initialised_comparison
from flexdesign.diagnosis.comparison import Comparison
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    initial_conditions,
    modes,
    prior_of_initial_condition,
    relaxing,
)
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report.diagnosis import comparison_report
from tests.effects.bench import respond

Array = NDArray[np.float64]
PERIOD, VOLTS, NOISE = 1e-3, 50.0, 5e-9
AXIS = AxisModel(400.0, 0.3, 1e-6)
CREEP, DAMPING = {"per_decade": 0.02, "t0": 0.1}, {"loss_factor": 0.02}


def acting(**added: Mapping[str, float]) -> AxisModel:
    return replace(AXIS, effects=added)


def made(name: str, command: Array, response: Array | None = None, **more: Any) -> Run:
    response = np.zeros(len(command)) if response is None else response
    time = PERIOD * np.arange(len(command))
    return Run(name, time, {"u": command, "x": response}, {"u": "V", "x": "m"}, "hold", **more)


def simulated(axis: AxisModel, command: Array) -> Array:
    return AxisDynamics("x", axis, VOLTS, tolerance=1e-8).predict(made("run", command))


def pairs(name: str, values: Mapping[str, float]) -> list[tuple[float, float]]:
    """Time constants and shares, as an effect states them."""
    (block,) = [face for face in effects.find(name).faces if isinstance(face, Block)]
    assert block.relaxing is not None
    return list(block.relaxing(values))


# --- relaxations ----------------------------------------------------------------------------------------------------


def after_a_step(name: str, values: Mapping[str, float], seconds: float) -> tuple[Array, Array]:
    """Time since a step from rest, and the response over what it is without the effect, when the mode has rung down."""
    time = PERIOD * np.arange(round(seconds / PERIOD))
    given = respond({name: values}, np.full(len(time), VOLTS), AXIS, between_samples="hold", tolerance=1e-7)
    rung_down = time > 0.05
    return time[rung_down], given.reading[0][rung_down] / (AXIS.gain * VOLTS)


def test_creep_relaxes_as_the_sum_of_its_states() -> None:
    """From rest each state z goes to the drive s as 1 - exp(-t / tau), and adds its share of it.

    The mode lets through what is slow, later by 2 zeta / w.
    """
    time, response = after_a_step("creep", CREEP, 30.0)
    states = pairs("creep", CREEP)
    assert [tau for tau, _ in states] == pytest.approx([0.1, 1.0, 10.0, 100.0])
    late = time - 2 * AXIS.damping_ratio / (2 * math.pi * AXIS.natural_frequency)
    expected = 1 + sum(share * -np.expm1(-late / tau) for tau, share in states)
    assert np.abs(response - expected).max() < 1e-3 * CREEP["per_decade"]


def test_structural_damping_relaxes_as_the_sum_of_its_states() -> None:
    """k (x + g sum (x - y)) = F and tau y' = x - y: the modes of this system, by its eigenvalues.

    Each relaxation is taken alone, which neglects a share g of its rate.
    """
    states = pairs("structural_damping", DAMPING)
    tau, g = np.array([t for t, _ in states]), states[0][1]
    assert all(share == g for _, share in states)
    count = len(tau)
    system = np.diag(1 / tau) @ (g / (1 + g * count) * np.ones((count, count)) - np.eye(count))
    rates, modes = np.linalg.eig(system)
    assert np.sort(-rates) == pytest.approx(np.sort(1 / tau), rel=g)
    # x = (F / k + g sum y) / (1 + g n), from y = 0 to y = F / k.
    time, response = after_a_step("structural_damping", DAMPING, 8.0)
    amounts = np.linalg.solve(modes, -np.ones(count))
    states_then = 1 + np.real(modes @ (amounts[:, None] * np.exp(np.outer(rates, time))))
    exact = (1 + g * states_then.sum(axis=0)) / (1 + g * count)
    assert np.abs(response - exact).max() < 0.01 * g
    # What the stated time constants make of it, in amounts that are no larger than stated.
    slow = [t for t in tau if t > 0.02]
    columns = np.column_stack([np.exp(-time / t) for t in slow])
    found = np.linalg.lstsq(columns, response - 1)[0]
    assert np.abs(columns @ found - (response - 1)).max() < 0.05 * g
    assert -found == pytest.approx(np.full(len(slow), g), rel=0.25)


def test_only_effects_with_slow_states_relax() -> None:
    assert relaxing(AXIS) == []
    assert relaxing(acting(quadratic_stiffness={"quadratic": 100.0})) == []
    assert relaxing(acting(creep={**CREEP, "per_decade": 0.0})) == []
    both = relaxing(acting(creep=CREEP, structural_damping=DAMPING))
    assert both == [*pairs("creep", CREEP), *pairs("structural_damping", DAMPING)]


def test_initial_conditions_are_an_offset_a_mode_that_rings_and_slow_states() -> None:
    run, stroke = made("run", np.zeros(500)), AXIS.gain * VOLTS
    columns, sizes = initial_conditions(acting(creep=CREEP), stroke)(run)
    offset, cosine, sine, *slow = columns.T
    t, w = run.time, 2 * math.pi * AXIS.natural_frequency
    assert np.all(offset == 1) and math.isinf(sizes[0])
    # Both solve the equation of a mode with no force on it: by their values every other sample, it recurs.
    decay, damped = np.exp(-AXIS.damping_ratio * w * PERIOD), w * PERIOD * math.sqrt(1 - AXIS.damping_ratio**2)
    for part, begun in ((cosine, 1.0), (sine, 0.0)):
        assert part[0] == begun
        assert part[2:] == pytest.approx(2 * decay * math.cos(damped) * part[1:-1] - decay**2 * part[:-2], abs=1e-12)
    assert len(slow) == 4
    for column, size, (tau, share) in zip(slow, sizes[3:], pairs("creep", CREEP), strict=True):
        assert column == pytest.approx(np.exp(-t / tau))
        assert size == pytest.approx(share * stroke)
    columns, sizes = initial_conditions(AXIS, stroke)(run)
    assert columns.shape == (500, 3)
    sweep = FrequencyResponse("sweep", np.array([1.0, 2.0]), np.ones(2, dtype=complex))
    assert initial_conditions(acting(creep=CREEP), stroke)(sweep)[0].shape == (4, 0)


def test_a_mode_rings_at_the_eigenvalue_that_linear_forces_give_it() -> None:
    """A root of s^2 + 2 zeta w s + w^2 + w^2 (c s + the sum of g s / (s + rate)), found by the secant method."""
    (block,) = [face for face in effects.find("structural_damping").faces if isinstance(face, Block)]
    assert block.maxwell is not None
    force, w = block.maxwell(DAMPING), 2 * math.pi * AXIS.natural_frequency

    def characteristic(s: complex) -> complex:
        relaxations = sum(g * s / (s + rate) for rate, g in force.elements)
        return s**2 + 2 * AXIS.damping_ratio * w * s + w**2 * (1 + force.dashpot * s + relaxations)

    root = newton(characteristic, w * complex(-AXIS.damping_ratio, 0.9))
    ((frequency, damping_ratio),) = modes(acting(structural_damping=DAMPING))
    assert frequency == pytest.approx(abs(root) / (2 * math.pi), rel=1e-9)
    assert damping_ratio == pytest.approx(-root.real / abs(root), rel=1e-9)
    assert frequency > 1.02 * AXIS.natural_frequency


def test_every_mode_of_an_axis_rings() -> None:
    axis = acting(second_mode={"share": 0.1, "frequency": 170.0, "damping_ratio": 0.01})
    run = made("run", np.zeros(500))
    columns, sizes = initial_conditions(axis, 50e-6)(run)
    assert columns.shape == (500, 5) and sizes[1:] == pytest.approx([0.3 * 50e-6] * 4)
    # Released from 1 um, a mode alone: x = e^(-zeta w t) (cos w_d t + zeta w / w_d sin w_d t).
    w, zeta = 2 * math.pi * 170.0, 0.01
    damped = w * math.sqrt(1 - zeta**2)
    released = np.exp(-zeta * w * run.time) * (
        np.cos(damped * run.time) + zeta * w / damped * np.sin(damped * run.time)
    )
    assert columns[:, 3] + zeta * w / damped * columns[:, 4] == pytest.approx(released)


# --- comparisons ----------------------------------------------------------------------------------------------------


def cut(name: str, axis: AxisModel, seed: int, **more: Any) -> Run:
    """A record that begins two seconds after a jump of the command, which is not in it; with an offset and noise."""
    rng = np.random.default_rng(seed)
    time = PERIOD * np.arange(6000)
    command = np.where(time < 4.0, VOLTS, VOLTS / 2)
    reading = simulated(axis, np.concatenate([np.zeros(100), command]))[100:]
    reading = reading + rng.normal(0, 1e-6) + NOISE * rng.standard_normal(len(time))
    return made(name, command[2000:], reading[2000:], **more)


def compared(axis: AxisModel, **more: Any) -> Comparison:
    records = [cut("one", acting(creep=CREEP), 1), cut("two", acting(creep=CREEP), 2)]
    return initialised_comparison.compare(StageModel({"x": axis}), records, noise=NOISE, **more)


def test_a_right_model_is_at_the_noise_whatever_its_states_were() -> None:
    """Of 4000 values the deviation is known to 1.1 %; four times that, and some numbers are fitted."""
    found = compared(acting(creep=CREEP))
    for run in found.runs:
        assert run.rms == pytest.approx(NOISE, rel=0.05)
        assert run.offset_rms is not None and run.offset_rms > 3 * NOISE


def test_initial_conditions_hide_no_effect() -> None:
    """Without creep in the model nothing slow is free: what creeps stays in the residual."""
    found = compared(AXIS)
    for run in found.runs:
        assert run.rms > 10 * NOISE
        assert run.offset_rms == pytest.approx(run.rms, rel=0.2)


def test_what_initial_conditions_explain_is_a_column_of_the_table() -> None:
    table = comparison_report.errors(compared(acting(creep=CREEP)))
    assert table.columns[-1] == "offset alone"
    assert len({len(row) for row in table.rows} | {len(table.columns)}) == 1
    assert "initial conditions of each run are fitted" in table.caption


def test_roles_and_order_change_nothing() -> None:
    records = [cut("one", acting(creep=CREEP), 1), cut("two", acting(creep=CREEP), 2)]
    roles = [replace(r, role=role, role_is_stated=True) for r, role in zip(records, ("test", "validate"), strict=True)]
    model = StageModel({"x": acting(creep=CREEP)})
    plain, other = (initialised_comparison.compare(model, runs, noise=NOISE) for runs in (records, roles[::-1]))
    assert {r.name: r.rms for r in other.runs} == pytest.approx({r.name: r.rms for r in plain.runs}, rel=1e-3)
    assert {r.name: r.role for r in other.runs} == {"one": "test", "two": "validate"}


@pytest.mark.parametrize(("bipolar", "range_"), [(False, (0.0, 100.0)), (True, (-100.0, 100.0))])
def test_what_happened_before_a_record_may_be_anywhere(bipolar: bool, range_: tuple[float, float]) -> None:
    """A record begins at any moment of a sample, after a reversal at any command of the range."""
    model = AxisDynamics("x", acting(bouc_wen={"a": 1e-7, "b": 0.02, "c": 0.0, "n": 1.0}), 100.0, bipolar=bipolar)
    model, seen = model.set_apart(["run"]), made("run", np.zeros(10))
    rng = np.random.default_rng(0)
    for name, (low, high) in {"turn.1": range_, "turn.2": range_, "trigger": (-PERIOD / 2, PERIOD / 2)}.items():
        (number,) = [p for p in model.parameters() if p.name == f"run:{name}"]
        prior = prior_of_initial_condition(number, [seen], 100.0, model)
        drawn = rng.uniform(low, high, 100_000)
        assert prior == pytest.approx((drawn.mean(), drawn.std()), rel=0.01, abs=0.01 * (high - low))
