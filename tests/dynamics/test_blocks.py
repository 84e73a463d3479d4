"""How hooks become machine code, effects from files, and the properties of Bouc-Wen hysteresis."""

from __future__ import annotations

import ctypes
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexdesign import effects
from flexdesign.core.model import Block, Effect, Socket
from flexdesign.dynamics.signal_chain import kernels
from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator
from flexdesign.dynamics.simulate import Loop, Stage, simulate
from flexdesign.effects import bouc_wen

PERIOD = 1e-3
NAMES = effects.names()
COMMAND = np.concatenate([np.zeros(5), np.full(40, 50.0), 60 - 60 * np.cos(0.2 * np.arange(200))])


def start(effect: Effect) -> dict[str, float]:
    return {p.name: p.start if p.start is not None else 0.0 for p in effect.parameters}


def response(*given: tuple[Effect, dict[str, float]]) -> np.ndarray:
    chain = AxisChain("x", 2e-6, (Oscillator(118.3, 0.0242),), given)
    return simulate(Stage((chain,)), {"x": Loop(COMMAND)}, PERIOD, substeps=16).reading[0]


HOOKS = [
    (name, face, kind)
    for name in NAMES
    for face in effects.find(name).faces
    if isinstance(face, Block)
    for kind in ("move", "flow", "pull", "tick")
    if getattr(face, kind) is not None
]


#: Of each kind of hook: how many numbers it is given, and how many triples of values before its state.
ARGUMENTS = {"move": (0, 2), "flow": (3, 0), "pull": (2, 0), "tick": (1, 0)}


@pytest.mark.parametrize(("name", "block", "kind"), HOOKS, ids=[f"{name}-{kind}" for name, _, kind in HOOKS])
def test_compiled_hooks_do_what_the_source_says(name: str, block: Block, kind: str) -> None:
    """The undecorated function on NumPy arrays, with bounds checked, against machine code through its address.

    Both may round differently, and each call goes on from the state that the last one left.
    """
    generator = np.random.default_rng(1)
    hook, (numbers, triples) = getattr(block, kind), ARGUMENTS[kind]
    constants = np.array(block.constants(start(effects.find(name)), 1e-4))
    lengths = [3] * triples + [len(block.states) + block.memory] * (2 if kind == "flow" else 1)
    left, right = ([np.zeros(length) for length in lengths] for _ in range(2))
    kinds = [ctypes.c_double] * numbers + [ctypes.c_void_p] * (len(lengths) + 1)
    machine = ctypes.CFUNCTYPE(None if kind == "move" else ctypes.c_double, *kinds)(kernels.address(hook, kind))
    scale = 50.0 if block.socket in (Socket.DRIVER, Socket.HYSTERESIS) else 50e-6
    for _ in range(100):
        given = scale * generator.standard_normal(numbers)
        for i in range(triples):
            left[i][:] = right[i][:] = scale * generator.standard_normal(3)
        by_source = hook(*given, *left, constants)
        by_machine = machine(*given, *(each.ctypes.data for each in right), constants.ctypes.data)
        assert by_machine == (None if by_source is None else pytest.approx(by_source, rel=1e-11, abs=1e-18))
        for one, other in zip(left, right, strict=True):
            assert other == pytest.approx(one, rel=1e-11, abs=1e-18)
        if kind == "flow":  # state, then rates
            left[0] += 1e-6 * left[1]
            right[0] += 1e-6 * right[1]


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


@settings(max_examples=30)
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
