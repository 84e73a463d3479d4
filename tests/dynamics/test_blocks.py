"""What holds for every effect of the catalogue, and how hooks become machine code."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexdesign import effects
from flexdesign.dynamics import kernels
from flexdesign.dynamics.chain import AxisChain, Oscillator
from flexdesign.dynamics.simulate import Loop, Stage, simulate
from flexdesign.effects import bouc_wen
from flexdesign.model import Block, Effect, Socket

PERIOD = 1e-3
NAMES = effects.names()
COMMAND = np.concatenate([np.zeros(5), np.full(40, 50.0), 60 - 60 * np.cos(0.2 * np.arange(200))])


def start(effect: Effect) -> dict[str, float]:
    return {p.name: p.start if p.start is not None else 0.0 for p in effect.parameters}


def strength(effect: Effect) -> str:
    return next(p.name for p in effect.parameters if p.null is not None)


def response(*given: tuple[Effect, dict[str, float]]) -> np.ndarray:
    chain = AxisChain("x", 2e-6, (Oscillator(118.3, 0.0242),), given)
    return simulate(Stage((chain,)), {"x": Loop(COMMAND)}, PERIOD, substeps=16).reading[0]


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_states_everything_a_user_needs(name: str) -> None:
    effect = effects.find(name)
    assert effect.name == name
    for text in (effect.physics, effect.where, effect.reveal, effect.remedy, effect.reference):
        assert len(text) > 15
    for parameter in effect.parameters:
        assert parameter.meaning and parameter.start is not None and parameter.is_plausible(parameter.start)
    assert any(p.null is not None for p in effect.parameters)
    assert not effect.cautions(start(effect))


@pytest.mark.parametrize("name", NAMES)
def test_at_null_an_effect_leaves_the_base_bit_for_bit(name: str) -> None:
    effect = effects.find(name)
    for parameter in effect.parameters:
        if parameter.null is not None:
            assert np.array_equal(response((effect, start(effect) | {parameter.name: parameter.null})), response())


@pytest.mark.parametrize("name", NAMES)
def test_towards_null_the_response_tends_to_the_base(name: str) -> None:
    """A thousandth of the strength (or a thousand times the limit) leaves far less of the effect."""
    effect, base = effects.find(name), response()
    parameter = next(p for p in effect.parameters if p.null is not None)
    assert parameter.start is not None
    weaker = parameter.start * (1e-3 if parameter.null == 0 else 1e3)
    full = np.abs(response((effect, start(effect))) - base).max()
    weak = np.abs(response((effect, start(effect) | {parameter.name: weaker})) - base).max()
    assert weak < 0.02 * full, (weak, full)


def test_order_of_addition_does_not_matter() -> None:
    given = [(effects.find(name), start(effects.find(name))) for name in NAMES]
    assert np.array_equal(response(*given), response(*reversed(given)))


HOOKS = [(name, face) for name in NAMES for face in effects.find(name).faces if isinstance(face, Block)]


@pytest.mark.parametrize(("name", "block"), HOOKS, ids=[name for name, _ in HOOKS])
def test_compiled_hooks_do_what_the_source_says(name: str, block: Block) -> None:
    """The undecorated function on NumPy arrays, with bounds checked, against machine code through its address."""
    generator = np.random.default_rng(1)
    effect = effects.find(name)
    constants = np.array(block.constants(start(effect), 1e-4))
    states = np.zeros(len(block.states) + block.memory)
    if block.move is not None:
        through = AxisChain("x", 1.0, (Oscillator(50.0, 0.5),), ((effect, start(effect)),))
        command = 50 * generator.random(30)
        found = simulate(Stage((through,)), {"x": Loop(command)}, 1e-4, between_samples="linear", substeps=1)
        for k in range(29):
            if block.socket is Socket.SENSOR:
                continue
            path = np.array([command[k], 0.5 * (command[k] + command[k + 1]), command[k + 1]])
            out = np.zeros(3) if block.mode == "replace" else path.copy()
            block.move(path, out, states, constants)
            signal = found.voltage if block.socket is Socket.DRIVER else found.drive
            assert signal[0, k + 1] == pytest.approx(out[2], rel=1e-13)
    if block.tick is not None:
        values = generator.random(30) * 1e-6
        expected = [block.tick(value, states, constants) for value in values]
        assert kernels.ticked(block.tick, values, len(states), constants) == pytest.approx(expected, rel=1e-13)


def test_a_hook_that_reaches_into_another_file_is_refused() -> None:
    def outside(value: float, state: np.ndarray, constants: np.ndarray) -> float:
        return value

    with pytest.raises(TypeError, match="of another file"):
        kernels.address(_calls_elsewhere, "tick")
    with pytest.raises(TypeError, match="uses NAMES"):
        kernels.address(_uses_a_list, "tick")
    del outside


advance = bouc_wen.advance


def _calls_elsewhere(value: float, state: np.ndarray, constants: np.ndarray) -> float:
    return advance(value, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0)


def _uses_a_list(value: float, state: np.ndarray, constants: np.ndarray) -> float:
    return value + len(NAMES)


def test_a_users_effect_comes_from_a_file(tmp_path: Path) -> None:
    source = Path(effects.__file__).with_name("quantisation.py").read_text(encoding="utf-8")
    (tmp_path / "mine.py").write_text(source.replace('name="quantisation"', 'name="mine"'), encoding="utf-8")
    mine = effects.find(str(tmp_path / "mine.py"))
    coarse = {"step": 1e-6}
    assert np.array_equal(response((mine, coarse)), response((effects.find("quantisation"), coarse)))


def test_unknown_effects_are_refused_with_a_suggestion() -> None:
    with pytest.raises(ValueError, match="did you mean bouc_wen"):
        effects.find("bouc_wenn")
    with pytest.raises(ValueError, match="is no Python file"):
        effects.find("nowhere.py")


# --- Bouc-Wen ---------------------------------------------------------------------------------------------------

positive = st.floats(1e-3, 1.0)
voltages = st.lists(st.floats(-150.0, 150.0), min_size=2, max_size=12)
orders = st.sampled_from([1.0, 1.3, 2.0, 3.0])


def follow(path: list[float], a: float, b: float, c: float, n: float, h: float = 0.0) -> list[float]:
    """Hysteresis along straight stretches from voltage to voltage, in um."""
    found = [h]
    for v0, v1 in pairwise(path):
        found.append(bouc_wen.advance(found[-1], v0, v1, a, b, c, n))
    return found


@given(voltages, positive, st.floats(1e-3, 0.1), st.floats(-1.0, 1.0), orders)
def test_bounded_for_b_at_least_c(path: list[float], a: float, b: float, ratio: float, n: float) -> None:
    """|h| <= (a / (b + c sign))^(1/n): the slope there is zero (Ikhouane and Rodellar, 2007)."""
    c = 0.9 * ratio * b
    bound = (a / (b - abs(c))) ** (1 / n)
    assert max(map(abs, follow([0.0, *path], a, b, c, n))) <= bound * (1 + 1e-6)


@given(voltages, positive, st.floats(1e-3, 0.1), st.floats(-1.0, 1.0), orders)
def test_dissipative_for_b_at_least_c(path: list[float], a: float, b: float, ratio: float, n: float) -> None:
    """The work of h on the voltage path, less what is stored, is not negative: integral of h dv >= h^2 / 2a."""
    c = ratio * b
    fine = [v for v0, v1 in zip([0.0, *path][:-1], path, strict=True) for v in np.linspace(v0, v1, 60)]
    h = np.array(follow(fine, a, b, c, n))
    work = float(np.sum(0.5 * (h[1:] + h[:-1]) * np.diff(fine)))
    scale = float(np.max(np.abs(h)) * np.sum(np.abs(np.diff(fine))))
    assert work - h[-1] ** 2 / (2 * a) >= -1e-3 * scale


@given(voltages, positive, st.floats(1e-3, 0.1), st.floats(-1.0, 1.0), orders)
def test_odd_symmetric(path: list[float], a: float, b: float, ratio: float, n: float) -> None:
    c = 0.9 * ratio * b
    up = follow([0.0, *path], a, b, c, n)
    down = follow([0.0, *(-v for v in path)], a, b, c, n)
    assert up == pytest.approx([-h for h in down], rel=1e-9, abs=1e-12)


@given(voltages, positive, st.floats(1e-3, 0.1), st.floats(-1.0, 1.0), orders)
def test_independent_of_how_a_stretch_is_divided(path: list[float], a: float, b: float, ratio: float, n: float) -> None:
    """Rate independence: h depends on the voltages passed, not on how many samples that takes."""
    c = 0.9 * ratio * b
    along = follow([0.0, *path], a, b, c, n)
    divided = [v for v0, v1 in zip([0.0, *path][:-1], path, strict=True) for v in np.linspace(v0, v1, 7)]
    assert follow(divided, a, b, c, n)[-1] == pytest.approx(along[-1], abs=3e-6 * max(map(abs, along)))


@pytest.mark.parametrize("slowdown", [2, 10])
def test_loop_is_independent_of_the_rate(slowdown: int) -> None:
    """The drive at the same phase of a sine is the same, whatever the frequency."""
    effect = effects.find("bouc_wen")
    chain = AxisChain("x", 2e-6, (Oscillator(118.3, 0.0242),), ((effect, start(effect)),))

    def drive(count: int) -> np.ndarray:
        command = 60 - 60 * np.cos(2 * np.pi * np.arange(2 * count) / count)
        loops = {"x": Loop(command)}
        return simulate(Stage((chain,)), loops, PERIOD, between_samples="linear", substeps=1).drive[0]

    assert drive(400 * slowdown)[::slowdown] == pytest.approx(drive(400), rel=1e-9, abs=1e-18)


def test_a_cycled_stage_rests_at_zero_and_repeats_its_loop() -> None:
    """With the remanence of a steady loop as its rest, every cycle is the last one, from zero back to zero."""
    bw = effects.find("bouc_wen")
    values = start(bw)
    rest = follow([0.0, *[120.0, 0.0] * 6], values["a"], values["b"], values["c"], values["n"])[-1]
    chain = AxisChain("x", 2e-6, (Oscillator(118.3, 0.0242),), ((bw, values | {"rest": rest}),))
    command = 60 - 60 * np.cos(2 * np.pi * np.arange(801) / 400)
    drive = simulate(Stage((chain,)), {"x": Loop(command)}, PERIOD, between_samples="linear", substeps=1).drive[0]
    assert abs(drive[0]) < 1e-18
    assert drive[400] == pytest.approx(0.0, abs=1e-12) and drive[800] == pytest.approx(0.0, abs=1e-12)
    assert drive[200] == pytest.approx(drive[600], rel=1e-6)


def test_n_1_is_the_printed_equation_29() -> None:
    """Slopes of the four cases of eq (29), by small increments."""
    a, b, c, dv = 0.4, 0.02, 0.007, 1e-6
    for h in (-3.0, 3.0):
        for sign in (-1.0, 1.0):
            rising, positive_h = sign > 0, h > 0
            slope = {
                (True, True): a - (b + c) * h,
                (True, False): a - (b - c) * h,
                (False, True): a + (b - c) * h,
                (False, False): a + (b + c) * h,
            }[rising, positive_h]
            change = bouc_wen.advance(h, 10.0, 10.0 + sign * dv, a, b, c, 1.0) - h
            assert change / (sign * dv) == pytest.approx(slope, rel=1e-6)


def test_outside_b_at_least_c_it_warns() -> None:
    effect = effects.find("bouc_wen")
    assert "neither bounded nor dissipative" in effect.cautions({"a": 1.0, "b": 0.01, "c": -0.02, "n": 1.0})[0]


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=20), orders)
def test_inverse_gives_the_voltage_back(path: list[float], n: float) -> None:
    gain, a, b, c = 2.0, 0.4, 0.02, 0.004
    voltages, state = np.array([0.0, *(100 * v for v in path)]), np.zeros(2)
    h = follow(list(voltages), a, b, c, n)
    wanted = gain * voltages[1:] - np.array(h[1:])
    constants = np.array([gain, a, b, c, n, 0.0])
    found = [bouc_wen.invert(w, state, constants) for w in wanted]
    assert found == pytest.approx(list(voltages[1:]), abs=1e-5)
    assert math.isfinite(state[0])
