"""What holds for every effect of the catalogue: words, nulls, order of addition."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from flexdesign import effects
from flexdesign.core.model import OTHER, Adjust, Block, Disturbance, Resonance, Socket
from flexdesign.dynamics.stage_model import fields
from tests.effects.bench import Array, reading, start, strengths

NAMES = effects.names()
#: The catalogue that diagnosis promises, beside numbers of the driver and the sensor.
PROMISED = {
    "abbe_error",
    "asymmetric_hysteresis",
    "base_motion",
    "bouc_wen",
    "coulomb_friction",
    "creep",
    "cross_coupling",
    "driver_bandwidth",
    "driver_saturation",
    "driver_slew",
    "electrostriction",
    "mains_hum",
    "pair_mismatch",
    "payload_mass",
    "prandtl_ishlinskii",
    "preload_loss",
    "quadratic_stiffness",
    "quantisation",
    "rate_dependent_hysteresis",
    "second_mode",
    "sensor_bandwidth",
    "sensor_delay",
    "sensor_drift",
    "sensor_gain",
    "sensor_misalignment",
    "stiffness_loss",
    "stress_stiffening",
    "stroke_dependent_amplification",
    "structural_damping",
    "thermal_expansion",
    "transport_delay",
}


def test_the_catalogue_is_complete() -> None:
    assert set(NAMES) >= PROMISED


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_states_everything_a_user_needs(name: str) -> None:
    effect = effects.find(name)
    assert effect.name == name
    for text in (effect.physics, effect.where, effect.reveal, effect.remedy, effect.reference):
        assert len(text) > 15
    for parameter in effect.parameters:
        assert parameter.meaning and parameter.start is not None and parameter.is_plausible(parameter.start)
    assert any(p.null is not None for p in effect.parameters) and effect.parameters[0].null is not None
    assert not effect.cautions(start(name))
    assert set(effect.confused_with) <= set(NAMES) - {name}
    assert effect.faces or name in fields.AXIS_FIELDS


@pytest.mark.parametrize("name", NAMES)
def test_what_a_search_tries_is_plausible(name: str) -> None:
    """Three to eight values, in order; a strength of either sign may be as large to one side as to the other."""
    for p in effects.find(name).parameters:
        assert not p.screen or 3 <= len(p.screen) <= 8
        assert list(p.screen) == sorted(set(p.screen)) and all(map(p.is_plausible, p.screen))
        assert not (p.screen and p.per_run)
        low, high = p.plausible
        if p.null == 0.0:
            assert low == 0.0 or math.isclose(low, -high) or name == "preload_loss"
        if p.null == math.inf:
            assert p.screen and p.scale == "inverse"


@pytest.mark.parametrize("response", fields.RESPONSES)
@pytest.mark.parametrize("name", NAMES)
def test_its_numbers_can_be_written_and_read(name: str, response: str) -> None:
    known = fields.effect(name, response)
    for p in effects.find(name).parameters:
        written = known[p.name].write(1.5)
        assert known[p.name].read(written.strip('"')) == pytest.approx(1.5, rel=1e-6)


# --- in the chain -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def alone() -> dict[str, Array]:
    return {name: reading({name: start(name)}) for name in NAMES} | {"": reading({})}


@pytest.mark.parametrize("name", NAMES)
def test_at_null_an_effect_leaves_the_base_bit_for_bit(name: str, alone: dict[str, Array]) -> None:
    assert np.array_equal(reading({name: start(name) | strengths(name)}), alone[""])


@pytest.mark.parametrize("name", NAMES)
def test_towards_null_the_response_tends_to_the_base(name: str, alone: dict[str, Array]) -> None:
    """A thousandth of the strengths (or a thousand times the limit) leaves far less of the effect, but leaves some."""
    weaker = {key: start(name)[key] * (1e-3 if null == 0 else 1e3) for key, null in strengths(name).items()}
    full = np.abs(alone[name] - alone[""]).max()
    weak = np.abs(reading({name: start(name) | weaker}) - alone[""]).max()
    assert full > 1e-6 * np.ptp(alone[""])  # it acts
    assert weak < 0.02 * full, (weak, full)


@pytest.mark.parametrize("first", NAMES)
def test_pairs_compose_in_either_order(first: str, alone: dict[str, Array]) -> None:
    """Bit for bit the same in either order, and each of the two acts beside the other."""
    for second in NAMES[NAMES.index(first) + 1 :]:
        pair = {name: start(name) for name in (first, second)}
        found = reading(pair)
        assert np.array_equal(found, reading(dict(reversed(pair.items())))), second
        assert np.isfinite(found).all()
        assert not np.array_equal(found, alone[first]), second
        assert not np.array_equal(found, alone[second]), second


def test_all_effects_together_in_any_order() -> None:
    given = {name: start(name) for name in NAMES}
    found = reading(given)
    assert np.isfinite(found).all()
    for shift in (1, 7):
        order = [*NAMES[shift:], *NAMES[:shift]]
        assert np.array_equal(found, reading({name: given[name] for name in order}))


# --- faces ------------------------------------------------------------------------------------------------------


def test_every_face_is_one_that_the_chain_knows() -> None:
    faces = itertools.chain.from_iterable(effects.find(name).faces for name in NAMES)
    assert all(isinstance(face, (Adjust, Block, Disturbance, Resonance)) for face in faces)


def test_what_makes_loops_in_the_stack_is_declared_as_hysteresis() -> None:
    """A block in the socket of hysteresis that remembers where it came from; a spring of the stage stands for it."""

    def remembers(face: object) -> bool:
        return isinstance(face, Block) and face.socket is Socket.HYSTERESIS and bool(face.states or face.memory)

    declared = {name for name in NAMES if effects.find(name).is_hysteresis}
    assert declared == {name for name in NAMES if any(map(remembers, effects.find(name).faces))} | {"hysteretic_spring"}


def test_columns_are_those_that_runs_have() -> None:
    needed = {
        column
        for name in NAMES
        for face in effects.find(name).faces
        if isinstance(face, Disturbance)
        for column in face.columns
    }
    assert needed == {OTHER, "T"}


# --- effects of installed packages ------------------------------------------------------------------------------


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that adds effects, as an installer leaves it."""
    source = Path(effects.__file__).with_name("quantisation.py").read_text(encoding="utf-8")
    (tmp_path / "their_effects.py").write_text(source.replace('name="quantisation"', 'name="steps"'), encoding="utf-8")
    info = tmp_path / "their_effects-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-effects\nVersion: 1.0\n", encoding="utf-8")
    lines = ["[flexdesign.effects]", *(f"{name} = {place}" for name, place in PLACES.items())]
    (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


PLACES = {
    "steps": "their_effects:EFFECT",
    "creep": "their_effects:EFFECT",
    "other_name": "their_effects:EFFECT",
    "gone": "their_effects:NOTHING",
    "no_effect": "their_effects:constants",
}


@pytest.fixture(autouse=True)
def _forget() -> object:
    yield
    for cached in (effects.names, effects._own_names, effects._entry_points):
        cached.cache_clear()


def test_an_installed_package_adds_effects(installed: Path) -> None:
    effects.names.cache_clear()
    effects._entry_points.cache_clear()
    assert set(effects.names()) == {*NAMES, "steps", "other_name", "gone", "no_effect"}
    assert effects.find("steps").name == "steps"
    assert effects.find("creep").parameters[0].name == "per_decade"  # ours stays
    assert effects.resolve_name("steps", installed) == "steps"
    coarse = {"step": 1e-6}
    assert np.array_equal(reading({"steps": coarse}), reading({"quantisation": coarse}))
    with pytest.raises(ValueError, match="is called steps by itself"):
        effects.find("other_name")
    with pytest.raises(ValueError, match="cannot be loaded from their_effects:NOTHING: AttributeError"):
        effects.find("gone")
    with pytest.raises(ValueError, match=r"no flexdesign\.Effect"):
        effects.find("no_effect")
