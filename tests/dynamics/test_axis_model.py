"""One axis as a model: against the engine run by hand, closed forms, and the promises that a fit relies on."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flexdesign import effects
from flexdesign.core.errors import InputError
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.axis.axis_model import DELAY, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import with_values
from flexdesign.dynamics.axis.axis_run import command_column, doubts, of_axis
from flexdesign.dynamics.simulate import Lead, Loop, Response, Stage, simulate
from flexdesign.dynamics.stage_model import AxisModel, Driver, Mode, Sensor
from flexdesign.dynamics.stage_model.axis import lumped_frequency
from flexdesign.effects.bouc_wen import advance
from flexdesign.measurements.recordings import Run

PERIOD = 1e-3
LOOP = {"a": 0.46e-6, "b": 0.0165, "c": 0.004, "n": 1.0}
PLAIN = AxisModel(100.0, 0.1, 2e-6)
FULL = AxisModel(
    100.0, 0.03, 2e-6, modes=(Mode(300.0, 0.02, 0.1),), effects={"bouc_wen": LOOP}, sensor=Sensor(resolution=5e-8)
)


def run(command: Any, response: Any = None, between: Any = "linear", **more: Any) -> Run:
    command = np.asarray(command, dtype=float)
    columns = {"u": command, "x": np.zeros(len(command)) if response is None else np.asarray(response), **more}
    si = {name: "V" if name.startswith("u") else "m" for name in columns}
    return Run("run", PERIOD * np.arange(len(command)), columns, si, between)


def wave(n: int = 400) -> Any:
    return 60 * (1 - np.cos(2 * np.pi * 5 * PERIOD * np.arange(n)))


# --- prediction -------------------------------------------------------------------------------------------------------


def test_the_step_response_of_an_oscillator() -> None:
    """x / (k_v u) = 1 - e^(-zeta w t) (cos(wd t) + zeta / sqrt(1 - zeta^2) sin(wd t)): exact for a held command."""
    t, w, zeta = PERIOD * np.arange(200), 2 * math.pi * 100.0, 0.1
    wd = w * math.sqrt(1 - zeta**2)
    right = 2e-6 * 10 * (1 - np.exp(-zeta * w * t) * (np.cos(wd * t) + zeta * w / wd * np.sin(wd * t)))
    command = np.full(200, 10.0)
    command[0] = 0.0
    found = AxisDynamics("x", PLAIN).predict(run(command, between="hold"))
    assert found[1:] == pytest.approx(right[:-1], abs=1e-12 * 2e-5)


def test_a_record_that_begins_at_a_voltage_begins_settled_there() -> None:
    """At half its damping the mode has decayed to 1e-4, at its own to 1e-8."""
    found = AxisDynamics("x", PLAIN).predict(run(np.full(50, 30.0)))
    assert found == pytest.approx(np.full(50, 60e-6), rel=1e-7)


def test_whole_samples_of_delay_shift_the_prediction() -> None:
    """Three samples later the same, within the integration error; and less than a sample lies in between."""
    seen, model = run(wave(), between="hold"), AxisDynamics("x", FULL)
    late = model.replace({DELAY: 3 * PERIOD})
    whole, span = model.predict(seen), 1e-7 * np.ptp(model.predict(seen))
    assert late.delay == 3 * PERIOD and late.refined().steps.delay == late.delay
    assert late.predict(seen)[3:] == pytest.approx(whole[:-3], abs=span)
    half = model.replace({DELAY: 0.5 * PERIOD}).predict(seen)[1:60]  # the command rises
    assert np.all((whole[:59] <= half + span) & (half <= whole[1:60] + span))


@pytest.mark.parametrize("between", ["hold", "linear"])
def test_integration_error_stays_below_the_tolerance(between: Any) -> None:
    """Against 16 times as many steps, with hysteresis and two modes; 1e-7 of the span is promised."""
    seen = run(wave(), between=between)
    model = AxisDynamics("x", FULL)
    fine = model._reading(seen, 16 * model.steps_for(seen))
    assert np.abs(model.predict(seen) - fine).max() < 1e-7 * np.ptp(fine)
    assert model.integration_error(seen) < 1e-7 * np.ptp(fine)


def test_the_number_of_steps_is_that_of_the_first_model() -> None:
    seen = run(wave())
    first = AxisDynamics("x", FULL)
    steps = first.steps_for(seen)
    later = first.replace({"natural_frequency": 290.0, "bouc_wen.b": 0.5})
    assert later.steps_for(seen) == steps
    assert later.refined().steps_for(seen) != steps

    unasked = AxisDynamics("x", FULL)
    assert unasked.replace({"natural_frequency": 290.0}).steps_for(seen) == unasked.steps_for(seen) == steps


def test_fast_relaxations_of_a_force_need_no_short_steps() -> None:
    """The fastest of structural damping is at 1 kHz, and it is solved exactly with the mode."""
    seen = run(wave())
    model = AxisDynamics("x", PLAIN).with_effect(effects.find("structural_damping"))
    coarse, fine = model.with_steps(1, fixed=True), model.with_steps(64, fixed=True)
    assert coarse.predict(seen) == pytest.approx(fine.predict(seen), abs=1e-11 * np.ptp(fine.predict(seen)))


def test_what_was_before_a_record_takes_few_samples() -> None:
    """A mode of 1 Hz moves 18 periods before a record: 18,000 samples at 1 kHz, of which the last 6,000 are left."""
    slow = replace(PLAIN, natural_frequency=1.0)
    seen = Run("run", PERIOD * np.arange(1000), {"u": np.full(1000, 50.0), "x": np.zeros(1000)}, {"u": "V", "x": "m"})
    model = AxisDynamics("x", slow, apart=("run",)).with_effect(effects.find("prandtl_ishlinskii"))
    lead, way = model._lead(seen, {}, 50.0)
    assert lead is not None and len(lead.command) == 240 and len(way) == 6000
    # In samples of the record: the same hysteresis is left, and the mode as much at rest.
    fine = replace(lead, command=np.interp(np.arange(12000) / 50, np.arange(240), lead.command), period=PERIOD)
    chain, command = Stage((model._chain,)), np.concatenate([way, seen.columns["u"]])
    right, found = (
        simulate(chain, {"x": Loop(command)}, PERIOD, between_samples="linear", lead=each) for each in (fine, lead)
    )
    assert found.reading[:, 6000:] == pytest.approx(right.reading[:, 6000:], abs=1e-6 * model.stroke)
    assert AxisDynamics("x", PLAIN, apart=("run",))._lead(seen, {}, 50.0)[0] is None  # no samples to spare


def test_a_lead_in_samples_of_the_record_is_the_same_record_longer() -> None:
    way, command = np.linspace(0.0, 30.0, 40), np.concatenate([np.full(20, 30.0), np.linspace(30.0, 5.0, 60)])
    chain = Stage((AxisDynamics("x", FULL)._chain,))
    given: dict[str, Any] = {"between_samples": "linear", "substeps": 4}
    found = simulate(chain, {"x": Loop(command)}, PERIOD, lead=Lead(way, PERIOD), **given)
    right = simulate(chain, {"x": Loop(np.concatenate([way[:-1], command]))}, PERIOD, **given)
    assert found.reading[0] == pytest.approx(right.reading[0, 39:], abs=1e-9 * np.ptp(right.reading))
    # A command that is late is preceded by the last one of the lead.
    late = simulate(chain, {"x": Loop(command)}, PERIOD, lead=Lead(way, PERIOD), delay=20 * PERIOD, **given)
    assert late.reading[0, :40] == pytest.approx(found.reading[0, :20].tolist() + late.reading[0, 20:40].tolist())


def test_a_lead_that_runs_away_is_a_divergence() -> None:
    chain = Stage((AxisDynamics("x", replace(PLAIN, effects={"stress_stiffening": {"cubic": -4e8}}))._chain,))
    found = simulate(chain, {"x": Loop(np.zeros(50))}, PERIOD, lead=Lead(np.linspace(0.0, 1e5, 50), PERIOD))
    assert found.diverged == 0.0 and found.motion.shape == (1, 0)


def test_predictions_depend_smoothly_on_every_number() -> None:
    """Central differences of two sizes agree to their own error, the square of the size; resolution would break it."""
    seen, model = run(wave()), AxisDynamics("x", FULL)
    for name in ("gain", "natural_frequency", "damping_ratio", "bouc_wen.a", "bouc_wen.b", "bouc_wen.c"):
        value = FULL.numbers[name]
        slopes = []
        for size in (1e-3, 1e-4):
            up, down = (model.replace({name: value * (1 + s)}).predict(seen) for s in (size, -size))
            slopes.append((up - down) / (2 * size))
        assert np.abs(slopes[0] - slopes[1]).max() < 2e-3 * np.abs(slopes[1]).max(), name


def test_threads_give_the_same_as_one() -> None:
    seen, model, other = run(wave()), AxisDynamics("x", FULL), AxisDynamics("x", FULL)
    values = [{"bouc_wen.a": 1e-8 * k} for k in range(30, 50)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda v: model.replace(v).predict(seen), values))
    alone = [other.replace(v).predict(seen) for v in reversed(values)][::-1]
    assert np.array_equal(alone, together)


def test_a_loop_that_runs_away_is_no_number() -> None:
    wild = AxisDynamics("x", FULL).replace({"bouc_wen.b": 0.0, "bouc_wen.c": -2.0})
    assert np.isnan(wild.predict(run(wave()))).all()


def test_a_start_in_motion_is_not_compared() -> None:
    moving, still = run(60 * np.sin(0.3 * np.arange(400) + 1.0)), run(wave())
    model = AxisDynamics("x", PLAIN)
    left_out = np.isnan(model.comparable(moving).measured())
    # the mode has decayed to 1e-3: ln(1000) / (zeta w) = 0.110 s
    assert left_out.sum() == 110 and left_out[:110].all()
    assert model.comparable(still) is still


# --- numbers ----------------------------------------------------------------------------------------------------------


def test_parameters_are_the_numbers_of_the_axis_that_act() -> None:
    found = {p.name: p for p in AxisDynamics("x", FULL).parameters()}
    assert {"gain", "modes.1.share", "bouc_wen.n", "driver.gain", "sensor.bandwidth"} <= set(found)
    assert not {"mass", "sensor.noise", "sensor.resolution", "actuator.count"} & set(found)
    for name, parameter in found.items():
        assert parameter.start == FULL.numbers.get(name, parameter.start)
        assert parameter.is_plausible(parameter.start or 0.0) or parameter.null == parameter.start, name


def test_ranges_hang_on_the_first_model() -> None:
    first = AxisDynamics("x", FULL)
    later = first.replace({"gain": 3e-6, "bouc_wen.a": 1e-7})
    assert [p.plausible for p in later.parameters()] == [p.plausible for p in first.parameters()]
    assert {p.name: p.start for p in later.parameters()}["gain"] == 3e-6
    assert first.axis is FULL


def test_ranges_scale_with_gain_and_voltage() -> None:
    """A stage with ten times the gain, or driven by ten times the voltage, is the same stage in other units."""
    grown = replace(FULL, gain=10 * FULL.gain)
    a, b = ({p.name: p.plausible for p in AxisDynamics("x", m).parameters()} for m in (FULL, grown))
    assert b["bouc_wen.a"] == pytest.approx(10 * np.array(a["bouc_wen.a"]))
    assert b["bouc_wen.b"] == pytest.approx(a["bouc_wen.b"])
    c = {p.name: p.plausible for p in AxisDynamics("x", FULL, 1000.0).parameters()}
    assert c["bouc_wen.b"] == pytest.approx(0.1 * np.array(a["bouc_wen.b"]))


def test_a_new_frequency_keeps_the_stiffness() -> None:
    axis = AxisModel(lumped_frequency(0.0342, 18.3e3), 0.03, 2e-6, mass=0.0342, stiffness=18.3e3)
    found = with_values(axis, {"natural_frequency": 100.0})
    assert found.stiffness == 18.3e3 and found.mass is not None
    assert lumped_frequency(found.mass, found.stiffness) == pytest.approx(100.0)


def test_every_number_can_be_changed() -> None:
    model = AxisDynamics("x", FULL)
    for name in [p.name for p in model.parameters()]:
        assert {p.name: p.start for p in model.replace({name: 0.25}).parameters()}[name] == 0.25
    assert with_values(FULL, {"modes.1.share": 0.25}).modes[0].share == 0.25
    with pytest.raises(KeyError):
        with_values(FULL, {"gian": 1.0})


def test_an_effect_is_added_at_the_scale_of_the_stroke() -> None:
    """The catalogue's 1e5 / m^2 for strokes of 100 um: k3 / k x^2 = 0.1 % at full stroke, whatever the stroke is."""
    electronic = AxisModel(70.0, 0.05, 1.0001, response="V")
    found = AxisDynamics("x", electronic, 0.2).with_effect(effects.find("stress_stiffening"))
    cubic = {p.name: p for p in found.parameters()}["stress_stiffening.cubic"]
    assert cubic.unit == "1/V^2" and cubic.start == pytest.approx(1e-3 / 0.2**2, rel=1e-3)
    with pytest.raises(InputError, match="already"):
        found.with_effect(effects.find("stress_stiffening"))
    with pytest.raises(InputError, match="is no effect"):
        found.with_effect(effects.find("creep"), "no_such")


def test_an_effect_of_the_driver_sets_its_number() -> None:
    """The catalogue's start, and the effect then acts."""
    slew = effects.find("driver_slew")
    found = AxisDynamics("x", PLAIN).with_effect(slew)
    assert found.axis.driver.slew == slew.parameters[0].start and not found.axis.effects
    late = AxisDynamics("x", PLAIN).with_effect(effects.find("transport_delay"))
    assert late.delay == effects.find("transport_delay").parameters[0].start


# --- numbers of one run -----------------------------------------------------------------------------------------------


def test_a_run_may_have_numbers_of_its_own() -> None:
    """A late start is a delay of that run alone; an early one moves the prediction forward by whole samples."""
    seen = run(np.concatenate([np.zeros(20), wave()]), between="hold")
    model = AxisDynamics("x", FULL).set_apart(["run", "other"])
    names = {p.name for p in model.parameters() if p.run == "run"}
    assert names == {"run:trigger", "run:turn.1", "run:turn.2"}
    plain, span = model.predict(seen), 1e-6 * 120e-6
    late = model.replace({"run:trigger": 3 * PERIOD}).predict(seen)
    assert late == pytest.approx(model.replace({DELAY: 3 * PERIOD}).predict(seen), abs=span)
    early = model.replace({"run:trigger": -3 * PERIOD}).predict(seen)
    assert early[:-3] == pytest.approx(plain[3:], abs=span)
    assert np.array_equal(model.replace({"other:trigger": 3 * PERIOD}).predict(seen), plain)


@pytest.mark.parametrize(("bipolar", "turns"), [(False, [75.0, 10.0]), (True, [50.0, -80.0])])
def test_a_run_begins_in_a_cycle_over_the_range_of_the_commands(bipolar: bool, turns: list[float]) -> None:
    model = AxisDynamics("x", FULL, 100.0, bipolar=bipolar).set_apart(["run"])
    found = {p.name: p.start for p in model.parameters() if ":turn" in p.name}
    assert list(found.values()) == pytest.approx(turns)
    assert np.array_equal(model.predict(run(wave())), model.replace(found).predict(run(wave())))


def test_what_moves_by_itself_does_not_jump_where_the_trigger_changes_its_sign() -> None:
    """Of base motion a nanosecond shows nothing, while the phase would advance by 6 degrees in a sample."""
    shaken = replace(PLAIN, effects={"base_motion": {"amplitude": 1e-6, "frequency": 18.0, "phase": 0.3}})
    model, seen = AxisDynamics("x", shaken).set_apart(["run"]), run(np.full(300, 20.0))
    early, late = (model.replace({"run:trigger": side * 1e-9}).predict(seen) for side in (-1.0, 1.0))
    assert np.ptp(early) > 1e-6
    assert late == pytest.approx(early, abs=1e-11)


def test_a_run_may_come_from_beyond_the_limits_of_its_command() -> None:
    """Nobody knows how a stage came to rest: hysteresis of either sign at zero volts; the record is cut off as ever."""
    still = run(np.zeros(50))
    limited = replace(FULL, driver=Driver(limits=(0.0, 100.0)), sensor=Sensor())
    model = AxisDynamics("x", limited).set_apart(["run"])
    rests = [model.replace({"run:turn.1": 75.0, "run:turn.2": turn}).predict(still)[-1] for turn in (-60.0, 60.0)]
    assert min(rests) < -0.5e-6 and max(rests) > 0.5e-6
    over = run(wave() - 5.0)
    assert model.cut(over) == pytest.approx(15.0)  # 5 V below zero, and 15 V above 100
    assert model.predict(over) == pytest.approx(model.predict(run(np.clip(wave() - 5.0, 0.0, 100.0))))


#: Laws of hysteresis, as the stage has it.
LAWS: dict[str, dict[str, float]] = {
    "bouc_wen": {"a": 0.3e-6, "b": 0.02, "c": 0.0, "n": 1.0},
    "prandtl_ishlinskii": {"weight": 0.3e-6, "reach": 30.0, "shape": 0.0},
    "asymmetric_hysteresis": {"strength": 2e-9, "b": 0.02},
    "rate_dependent_hysteresis": {"weight": 0.2e-6, "slope": 2e-3, "threshold": 2.0},
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("driver", [Driver(slew=6e4), Driver(bandwidth=300.0)])
def test_hysteresis_behind_a_driver_follows_the_voltage_and_not_its_means(driver: Driver, law: str) -> None:
    """Sixteen steps in a sample are enough for ramps that end within one: 1e-5 of the span against 512 steps.

    Where the threshold hangs on the rate, it falls at the ramp's end, which only smaller steps place more closely.
    """
    levels = np.repeat(np.random.default_rng(1).uniform(0, 100, 40), 10)
    seen = run(np.concatenate([[0.0], levels]), between="hold")
    model = AxisDynamics("x", replace(FULL, driver=driver, sensor=Sensor(), effects={law: LAWS[law]}))
    few, many = (model.with_steps(count, fixed=True).predict(seen) for count in (16, 512))
    placed = law != "rate_dependent_hysteresis" or math.isinf(driver.slew)
    assert np.abs(few - many).max() < (1e-5 if placed else 5e-4) * np.ptp(many)


def test_a_run_comes_from_where_the_voltage_had_turned() -> None:
    """A record after a way over 80 V begins on the hysteresis that this way leaves, and at rest."""
    model = AxisDynamics("x", FULL).set_apart(["run"]).replace({"run:turn.1": 80.0, "run:turn.2": 0.0})
    found = model.predict(run(np.zeros(60)))
    h = 0.0
    for start, end in ((0.0, 80.0), (80.0, 0.0)):
        h = advance(h, start, end, *LOOP.values())
    assert found == pytest.approx(np.full(60, -h), abs=2e-4 * 160e-6) and abs(h) > 1e-6


# --- the voltage at the stack -----------------------------------------------------------------------------------------

#: An amplifier that lags by 4 ms, limps behind steps and cuts at 90 V.
SLOW = Driver(gain=15.0, bandwidth=40.0, slew=4000.0, limits=(0.0, 90.0))


def through_the_amplifier() -> Response:
    """The engine by hand: commands up to 8 V, 120 V without limits, 2 ms late."""
    axis = replace(FULL, driver=SLOW)
    limits = {"x": stages.command_limits(axis)}
    chain = Stage((stages.chain("x", axis),), limits=limits)
    return simulate(chain, {"x": Loop(wave() / 15)}, PERIOD, delay=2e-3, between_samples="linear", tolerance=1e-8)


@pytest.mark.parametrize("known", ["v", "stack", "monitor"])
def test_the_voltage_at_the_stack_drives_the_model_whatever_the_amplifier_did(known: Any) -> None:
    """Straight lines between samples of the voltage leave (w h)^2 / 12 of it at 5 Hz, and kinks at the limit: 1e-3."""
    real = through_the_amplifier()
    columns = {"u": wave() / 15, "v": real.voltage[0]} if known == "v" else {"u": real.voltage[0]}
    seen = run(columns.pop("u"), real.reading[0], "hold" if known == "v" else "linear", **columns)
    seen = seen if known == "v" else replace(seen, command_is=known)
    axis = replace(FULL, sensor=Sensor())
    errors = []
    for driver, delay in ((SLOW, 2e-3), (Driver(gain=15.0), 0.0)):
        mine = replace(axis, driver=driver)
        its = of_axis(seen, "x", mine)
        model = AxisDynamics("x", mine, 8.0, delay=delay)
        errors.append(float(np.abs(model.predict(its) - real.reading[0]).max() / np.ptp(real.reading[0])))
        assert its.command() == pytest.approx(real.voltage[0] / 15) and model.cut(its) == 0.0
    assert max(errors) < 1e-3 and errors[0] == errors[1]
    ideal = replace(axis, driver=Driver(gain=15.0))
    from_commands = AxisDynamics("x", ideal, 8.0).predict(run(wave() / 15))
    assert np.abs(from_commands - real.reading[0]).max() > 0.1 * np.ptp(real.reading[0])


def test_the_number_sent_to_the_amplifier_goes_through_it() -> None:
    real = through_the_amplifier()
    model = AxisDynamics("x", replace(FULL, driver=SLOW, sensor=Sensor()), 8.0, delay=2e-3)
    found = model.predict(of_axis(run(wave() / 15, real.reading[0]), "x", model.axis))
    assert found == pytest.approx(real.reading[0], abs=6e-8)  # half a step of the sensor, and a little


@pytest.mark.parametrize(
    ("voltage", "words"),
    [(np.where(wave() > 100, np.nan, wave()), "has gaps"), (wave() / 20, "0.05 times the command, and 1 times")],
)
def test_a_voltage_that_cannot_be_used_leaves_the_command_in_its_place(voltage: Any, words: str) -> None:
    seen = of_axis(run(wave(), 2e-6 * wave(), v=voltage), "x", PLAIN)
    assert np.array_equal(seen.command(), wave()) and seen.command_is == "dac"
    assert any(words in remark and "u drives" in remark for remark in seen.remarks)


def test_a_measured_voltage_is_not_held() -> None:
    seen = of_axis(run(wave(), 2e-6 * wave(), "hold", v=wave()), "x", PLAIN)
    assert (seen.between_samples, seen.command_is, seen.driven_by) == ("linear", "stack", "v")


def test_units_wrong_by_a_thousand_are_refused_unless_the_gain_is_a_guess() -> None:
    wrong = run(wave(), 2e-3 * wave())
    with pytest.raises(InputError, match=r"column x = 240 mm peak to peak: is a thousand times the 0\.240 mm"):
        of_axis(wrong, "x", PLAIN)
    (doubt,) = doubts([of_axis(wrong, "x", replace(PLAIN, assumed=("gain",)))])
    assert doubt.startswith("Take care: run: x spans 240 mm")


# --- runs of several axes ---------------------------------------------------------------------------------------------


def test_an_axis_takes_its_own_columns() -> None:
    columns = {name: np.arange(10.0) for name in ("ux", "uy", "x", "y")}
    seen = Run("r", np.arange(10.0), columns, {"ux": "V", "uy": "V", "x": "m", "y": "m"})
    seen.columns["uy"][:] = 7.0
    of_y = of_axis(seen, "y", PLAIN)
    assert np.array_equal(of_y.command(), seen.columns["uy"]) and np.array_equal(of_y.measured(), seen.columns["y"])
    assert command_column(seen, "x") == "ux"
    with pytest.raises(InputError, match=r"r: z: the run has no response of axis z; there is x, y"):
        of_axis(seen, "z", PLAIN)
    with pytest.raises(InputError, match="runs hold the axes x, y, z"):
        of_axis(seen, "theta", PLAIN)
    del columns["ux"]
    with pytest.raises(InputError, match="no command of axis x; there is uy"):
        of_axis(seen, "x", PLAIN)


def test_the_plausible_range_of_a_damping_ratio_holds_that_of_the_model() -> None:
    """Of an overdamped axis a fit that began at the end of the range would be worse than the design."""
    for damping_ratio in (0.02, 2.5, 40.0):
        dynamics = AxisDynamics("x", AxisModel(1.0, damping_ratio, 1e-6), 100.0)
        (low, high) = next(p.plausible for p in dynamics.parameters() if p.name == "damping_ratio")
        assert low < damping_ratio < high
