"""Every effect against an independent formulation of its equation: `tests.reference.effects`, or a closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexdesign import effects
from flexdesign.core.errors import InputError
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.simulate import TOLERANCE, Loop, Stage, simulate
from flexdesign.dynamics.stage_model import Driver, Mode
from tests.effects.bench import BASE, COMMAND, PERIOD, RECORDED, TIME, Array, respond, start, strengths
from tests.reference import effects as reference

SHORT = COMMAND[:160]
GAIN, F, ZETA = BASE.gain, BASE.natural_frequency, BASE.damping_ratio
#: An amplifier with a lag, so that the voltage is curved and turns within steps.
LAG = 1 / (2 * math.pi * 200.0)
LAGGED = replace(BASE, driver=Driver(bandwidth=200.0))


def command(t: float) -> float:
    """The command as it is between samples."""
    return float(np.interp(t, TIME, COMMAND))


def drive(t: float) -> float:
    return GAIN * command(t)


# --- between voltage and drive ----------------------------------------------------------------------------------

PLAYS = {"weight": 0.2e-6, "reach": 30.0, "shape": 1.5}
RATE = {"weight": 0.1e-6, "slope": 2e-3, "threshold": 2.0}
ASYMMETRIC = {"strength": 1e-9, "b": 0.02}


def lagging(name: str, lag: float) -> Array:
    """What a hysteresis holds back, by the reference."""
    if name == "prandtl_ishlinskii":
        return reference.plays(SHORT, PERIOD, lag, **PLAYS)
    if name == "rate_dependent_hysteresis":
        return reference.rate_dependent_play(SHORT, PERIOD, lag, **RATE)
    return reference.asymmetric(SHORT, PERIOD, lag, **ASYMMETRIC)


LOOPS = {"prandtl_ishlinskii": PLAYS, "rate_dependent_hysteresis": RATE, "asymmetric_hysteresis": ASYMMETRIC}


@pytest.mark.parametrize("name", LOOPS)
def test_hysteresis_without_a_lag_is_exact_at_any_number_of_steps(name: str) -> None:
    found = respond({name: LOOPS[name] | {"rest": 0.0}}, SHORT, substeps=1).drive[0]
    assert found == pytest.approx(GAIN * SHORT - lagging(name, 0.0), abs=1e-10 * 1e-4)


BOUC_WEN = {"a": 0.2e-6, "b": 0.02, "c": 0.005, "n": 1.0}


@pytest.mark.parametrize("halves", [0.2, 1 / 3, 0.6, 0.66, 2 / 3, 0.67, 0.75, 1.0, 1.2, 4 / 3, 1.34, 1.8, 3.7])
@pytest.mark.parametrize("name", ["bouc_wen", "prandtl_ishlinskii", "asymmetric_hysteresis"])
def test_a_ramp_that_ends_within_a_step_turns_no_hysteresis(name: str, halves: float) -> None:
    """A slew limit makes a ramp of a jump: it leaves behind what the jump leaves, wherever in a step it ends."""
    values = (LOOPS | {"bouc_wen": BOUC_WEN})[name] | {"rest": 0.0}
    steps = np.repeat([0.0, 40.0, 80.0, 40.0, 80.0], 8)
    slew = 40.0 / (halves * 0.5 * PERIOD)
    jumps = respond({name: values}, steps, substeps=1, between_samples="hold").drive[0]
    ramps = respond({name: values, "driver_slew": {"slew": slew}}, steps, substeps=1, between_samples="hold").drive[0]
    assert np.ptp(jumps) > 10e-6
    assert ramps[7::8] == pytest.approx(jumps[7::8], abs=1e-13 * 40)


def test_a_ramp_within_the_shorter_part_of_a_sample_is_not_overlooked() -> None:
    """A delay divides samples. Where ramps lie in the shorter part, which has one step, more steps change nothing."""
    held = 20.0 * np.sin(2 * np.pi * 40.0 * TIME)
    given = {"driver_slew": {"slew": 1.2e5}, "transport_delay": {"delay": 0.835e-3}}
    found, fine = (respond(given, held, between_samples="hold", **n) for n in ({}, {"substeps": 512}))
    wrong = np.abs(found.motion - fine.motion).max() / np.ptp(fine.motion)
    assert max(wrong, found.error) <= TOLERANCE


@pytest.mark.parametrize("name", LOOPS)
def test_hysteresis_converges_where_the_voltage_turns_within_steps(name: str) -> None:
    """The parabola of a step is of third order, and its slope, on which the rate-dependent play hangs, of second."""
    ends = [float(b.voltage(b.end)) for b in reference.branches(SHORT, PERIOD, LAG) if b.ends_sample]
    right = GAIN * np.array([0.0, *ends]) - lagging(name, LAG)

    def error(substeps: int) -> float:
        found = respond({name: LOOPS[name] | {"rest": 0.0}}, SHORT, LAGGED, substeps=substeps).drive[0]
        return float(np.abs(found - right).max() / np.ptp(right))

    order = 2 if name == "rate_dependent_hysteresis" else 3
    assert error(64) < 4 ** (-order + 0.5) * error(16)
    assert error(64) < 1e-6


@pytest.mark.parametrize("name", ["prandtl_ishlinskii", "rate_dependent_hysteresis"])
def test_motion_under_plays_that_slip_within_steps(name: str) -> None:
    """Against the reference's drive on finer grids, straight between, through SciPy's oscillator, extrapolated."""
    follow = reference.plays if name == "prandtl_ishlinskii" else reference.rate_dependent_play
    w = 2 * math.pi * F

    def motion(finer: int) -> Array:
        fine = np.interp(np.arange(finer * 119 + 1) / finer, np.arange(120), SHORT[:120])
        ends = [float(b.voltage(b.end)) for b in reference.branches(fine, PERIOD / finer, LAG) if b.ends_sample]
        given = GAIN * np.array([0.0, *ends]) - follow(fine, PERIOD / finer, LAG, **LOOPS[name])
        times = PERIOD / finer * np.arange(len(fine))
        return np.asarray(signal.lsim(([w * w], [1, 2 * ZETA * w, w * w]), given, times)[1][::finer])

    coarse, fine = motion(50), motion(100)
    right = fine + (fine - coarse) / 3  # of second order, by what the voltage bends between points
    found = respond({name: LOOPS[name] | {"rest": 0.0}}, SHORT[:120], LAGGED)
    assert found.error <= TOLERANCE and found.substeps <= 32
    assert np.abs(found.motion[0] - right).max() / np.ptp(right) < found.error + 2e-8  # what the extrapolation leaves


@pytest.mark.parametrize("name", ["prandtl_ishlinskii", "rate_dependent_hysteresis", "coulomb_friction"])
def test_the_error_that_a_simulation_states_is_not_too_small(name: str) -> None:
    """Against the same chain at many more steps."""
    values = start(name)
    found = respond({name: values}, SHORT, LAGGED)
    right = respond({name: values}, SHORT, LAGGED, substeps=16 * found.substeps)
    assert found.error <= TOLERANCE and found.substeps <= 128
    assert np.abs(found.motion - right.motion).max() / np.ptp(right.motion) < found.error + 1e-10


@pytest.mark.parametrize("gain", [1e-6, -1e-6])
@pytest.mark.parametrize("name", LOOPS)
def test_hysteresis_holds_back_whatever_the_sign_of_the_gain(name: str, gain: float) -> None:
    """A sine about a bias: the drive comes back above where it went up, in the sense in which it moves."""
    cycle = 50 - 50 * np.cos(2 * np.pi * np.arange(201) / 100)
    values = LOOPS[name] | {"rest": 0.0}
    found = math.copysign(1.0, gain) * respond({name: values}, cycle, replace(BASE, gain=gain), substeps=1).drive[0]
    assert (found[151:199] > found[149:101:-1]).all()


@pytest.mark.parametrize("name", LOOPS)
def test_a_start_state_is_where_an_earlier_loop_ended(name: str) -> None:
    """After a cycle back to zero, what follows is a record that begins with this start state, but for its zero."""
    values = LOOPS[name] | {"rest": 0.0}
    cycle = 50 - 50 * np.cos(2 * np.pi * np.arange(101) / 100)
    whole = respond({name: values}, np.concatenate([cycle, cycle]), substeps=1).drive[0]
    rest = {
        "prandtl_ishlinskii": PLAYS["reach"],
        "rate_dependent_hysteresis": RATE["threshold"],
        "asymmetric_hysteresis": reference.asymmetric(cycle, PERIOD, 0.0, **ASYMMETRIC)[-1],
    }[name]
    second = respond({name: values | {"rest": rest}}, cycle, substeps=1).drive[0]
    assert second[0] == 0.0
    if name == "rate_dependent_hysteresis":  # at the end of the cycle its threshold is not that at rest
        assert second[20:90] == pytest.approx(whole[121:191] - whole[100], abs=0.5e-6)
    else:
        assert second == pytest.approx(whole[101:] - whole[101], abs=1e-15)


def test_a_wider_loop_at_high_voltage() -> None:
    """Two loops of one size: the upper one of the asymmetric hysteresis is wider, in proportion to the voltage."""

    def width(bias: float) -> float:
        sine = bias + 10 * np.sin(2 * np.pi * np.arange(401) / 100)
        path = np.concatenate([np.linspace(0, bias, 50), sine])
        found = respond({"asymmetric_hysteresis": ASYMMETRIC | {"rest": 0.0}}, path, substeps=1).drive[0][-101:]
        return float(found[50] - 0.5 * (found[0] + found[100]))  # falling and rising through the bias

    assert width(80.0) > 1.5 * width(40.0) > 0


def test_a_wider_loop_at_a_higher_rate() -> None:
    """A triangle: the play lags by its threshold, weight (threshold + slope |dv/dt|), in either direction."""
    for count in (100, 50):
        cycle = np.tile(np.interp(np.arange(count), [0, count // 2, count], [0, 100, 0]), 3)
        found = respond({"rate_dependent_hysteresis": RATE | {"rest": 0.0}}, cycle, substeps=1).drive[0]
        rate = 100 / (count // 2 * PERIOD)
        held = RATE["weight"] * (RATE["threshold"] + RATE["slope"] * rate)
        assert found[2 * count + count // 4] == pytest.approx(GAIN * cycle[count // 4] - held, rel=1e-12)


def test_electrostriction_and_amplification() -> None:
    """Both are squares: one of the voltage, one of the drive that is left after hysteresis."""
    bouc_wen = {"bouc_wen": start("bouc_wen")}
    plain = respond(bouc_wen, SHORT, substeps=1).drive[0]
    found = respond({**bouc_wen, "electrostriction": {"quadratic": -2e-9}}, SHORT, substeps=1).drive[0]
    assert found == pytest.approx(plain - 2e-9 * SHORT**2, abs=1e-18)
    found = respond({**bouc_wen, "stroke_dependent_amplification": {"slope": 800.0}}, SHORT, substeps=1).drive[0]
    assert found == pytest.approx(plain + 800.0 * plain**2, abs=1e-18)


def test_saturation_cuts_off_what_the_amplifier_cannot_give() -> None:
    command = 150 * np.sin(2 * np.pi * 7 * TIME)
    found = respond({"driver_saturation": {"level": 90.0}}, command, replace(BASE, driver=Driver(gain=2.0)), substeps=1)
    assert found.voltage[0] == pytest.approx(np.clip(2 * command, -90, 90), abs=1e-12)
    assert found.command[0] == pytest.approx(command, abs=1e-12)


def test_a_corner_of_saturation_within_a_step_costs_no_order() -> None:
    """With four times as many steps the error falls by more than four cubed, wherever the corners lie."""
    command, levels = 150 * np.sin(2 * np.pi * 7 * TIME), np.linspace(80.0, 120.0, 11)

    def motion(level: float, substeps: int) -> Array:
        limited = {"driver_saturation": {"level": level}}
        return respond(limited, command, between_samples="linear", substeps=substeps).motion[0]

    exact = [motion(level, 512) for level in levels]
    error = {
        n: math.sqrt(np.mean([(motion(level, n) - right) ** 2 for level, right in zip(levels, exact, strict=True)]))
        for n in (2, 8)
    }
    assert error[8] < error[2] / 4**3


# --- forces -----------------------------------------------------------------------------------------------------


def check(name: str, values: dict[str, float], right: Array, unsteady: float = 1.0) -> None:
    """The engine keeps its tolerance, and does not claim to be better than it is.

    Where a force bends at a position, it is chance which steps hold the bend: there an estimate is good to a factor.
    """
    found = respond({name: values}, COMMAND[: len(right)])
    error = np.abs(found.motion[0] - right).max() / np.ptp(right)
    assert error < TOLERANCE
    assert error < unsteady * found.error + 1e-9, (error, found.error)


def test_quadratic_stiffness() -> None:
    right = reference.moved(drive, 120, PERIOD, F, ZETA, lambda x, v, z: -800.0 * x * x)
    check("quadratic_stiffness", {"quadratic": 800.0}, right)


@pytest.mark.parametrize(("ratio", "onset"), [(0.3, 30e-6), (-0.4, 60e-6), (0.3, -5e-6)])
def test_preload_loss(ratio: float, onset: float) -> None:
    """By the stiffness on either side, integrated from the rest position: min(x, onset) in closed form."""

    def force(x: float, v: float, z: Array) -> float:
        below = min(x, onset) - min(0.0, onset)  # travel from the start that lies below the onset
        return -ratio * below

    right = reference.moved(drive, 120, PERIOD, F, ZETA, force)
    check("preload_loss", {"ratio": ratio, "onset": onset}, right, unsteady=2.0)


@pytest.mark.parametrize("rest", [0.0, -0.6])
@pytest.mark.parametrize("presliding", [1e-6, 1e-7])
def test_coulomb_friction(presliding: float, rest: float) -> None:
    """Dahl's law in time, whose rates ask a solver in time for ever shorter steps."""
    level = 2e-6

    def rates(x: float, v: float, z: Array) -> Array:
        return v / presliding - abs(v) / presliding * (z + rest)

    right = reference.moved(drive, 120, PERIOD, F, ZETA, lambda x, v, z: -level * z[0], rates, 1)
    check("coulomb_friction", {"level": level, "presliding": presliding, "rest": rest}, right)


def test_friction_needs_no_shorter_steps_where_it_is_stiff() -> None:
    """A presliding of a thousandth of the stroke: rates in time of 1e6 1/s, and still few steps in a sample."""
    found = respond({"coulomb_friction": {"level": 1e-6, "presliding": 1e-7, "rest": 0.0}})
    assert found.diverged is None and found.substeps <= 256


def test_structural_damping_is_the_sum_of_its_relaxations() -> None:
    eta, corners = 0.05, 0.1 * 10 ** (np.arange(9) / 2)
    g = 2 * eta * math.log(math.sqrt(10)) / math.pi
    above = g * sum(1 / (2 * math.pi * 0.1 * 10 ** (i / 2)) for i in range(9, 60))

    def rates(x: float, v: float, z: Array) -> Array:
        return 2 * np.pi * corners * (x - z)

    right = reference.moved(
        drive, 120, PERIOD, F, ZETA, lambda x, v, z: -g * float(np.sum(x - z)) - above * v, rates, 9
    )
    check("structural_damping", {"loss_factor": eta}, right)


@pytest.mark.parametrize("frequency", [1.0, 10.0, 100.0, 300.0])
def test_structural_damping_has_the_loss_factor_it_is_given(frequency: float) -> None:
    """Force for a sine of displacement: its part in quadrature, within the ripple and the ends of the band."""
    (block,) = effects.find("structural_damping").faces
    force, w = block.maxwell({"loss_factor": 0.02}), 2 * math.pi * frequency
    stiffness = sum(g * 1j * w / (1j * w + rate) for rate, g in force.elements) + 1j * w * force.dashpot
    assert stiffness.imag == pytest.approx(0.02, rel=0.07)


def test_fast_relaxations_are_no_divergence() -> None:
    """At 50 samples a second the first steps are far too long for a relaxation of 1 kHz; shorter ones are not."""
    axis = replace(BASE, natural_frequency=5.0, effects={"structural_damping": {"loss_factor": 0.05}})
    stage = Stage((stages.chain("x", axis),))
    found = simulate(stage, {"x": Loop(np.full(60, 10.0))}, 0.02)
    assert found.diverged is None and found.error <= TOLERANCE
    assert np.abs(found.motion).max() < 2 * 10 * GAIN


def test_a_force_that_feeds_the_motion_is_a_divergence() -> None:
    """A negative cubic stiffness lets the mass go beyond a certain position, however short the steps."""
    found = respond({"stress_stiffening": {"cubic": -4e8}})
    assert found.diverged is not None


def test_forces_of_several_axes_do_not_meet() -> None:
    """Every axis moves as it does alone, whatever kinds of force act on the others."""
    names = ("coulomb_friction", "structural_damping", "preload_loss", "hysteretic_spring", "stress_stiffening")
    acting = {"x": names[:3], "y": (), "z": names[1:]}
    axes = {axis: replace(BASE, effects={name: start(name) for name in given}) for axis, given in acting.items()}
    chains = tuple(stages.chain(name, axis) for name, axis in axes.items())
    together = simulate(Stage(chains), {name: Loop(COMMAND) for name in axes}, PERIOD, substeps=8)
    for row, name in enumerate(axes):
        alone = simulate(Stage((chains[row],)), {name: Loop(COMMAND)}, PERIOD, substeps=8)
        assert np.array_equal(together.motion[row], alone.motion[0])


def test_base_motion_goes_on_at_the_same_pace_where_steps_differ() -> None:
    """A delay divides a sample into steps of two lengths, and leaves what does not hang on the command."""
    chain = stages.chain("x", replace(BASE, effects={"base_motion": start("base_motion")}))
    found = [
        simulate(Stage((chain,)), {"x": Loop(np.zeros(200))}, PERIOD, delay=delay).drive[0] for delay in (0.0, 0.3e-3)
    ]
    assert found[1] == pytest.approx(found[0], abs=1e-18)


def test_base_motion_drives_the_mass_by_its_inertia() -> None:
    """m x'' + c x' + k x = -m a(t), with the frame's acceleration a in its own units."""
    m, w = 0.034, 2 * math.pi * F
    values = {"amplitude": 2e-6, "frequency": 37.0, "phase": 0.7}

    def inertia(t: float) -> float:
        acceleration = -(w**2) * values["amplitude"] * math.sin(2 * math.pi * 37.0 * t + 0.7)
        return -m * acceleration

    right = reference.mass_on_spring(inertia, 100, PERIOD, m, 2 * ZETA * w * m, w * w * m)
    found = respond({"base_motion": values}, np.zeros(100))
    assert np.abs(found.motion[0] - right).max() < 1e-6 * np.ptp(right)


# --- mechanics --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "ratio"), [("payload_mass", 0.3), ("stiffness_loss", 0.2)])
def test_mass_and_stiffness_change_what_they_change(name: str, ratio: float) -> None:
    """Mass, dashpot and spring in their own units, under the force that the drive is on the spring."""
    m, w = 0.034, 2 * math.pi * F
    k, c = w * w * m, 2 * ZETA * w * m
    heavier, softer = (m * (1 + ratio), k) if name == "payload_mass" else (m, k * (1 - ratio))
    right = reference.mass_on_spring(lambda t: k * drive(t), 100, PERIOD, heavier, c, softer)
    found = respond({name: {"ratio": ratio}}, COMMAND[:100])
    assert np.abs(found.motion[0] - right).max() < 2e-6 * np.ptp(right)


def test_adjusted_numbers_do_not_depend_on_the_order() -> None:
    both = {"payload_mass": {"ratio": 0.3}, "stiffness_loss": {"ratio": 0.2}}
    found = [stages.main_mode(replace(BASE, effects=each)) for each in (both, dict(reversed(both.items())))]
    assert found[0] == found[1]
    assert found[0]["natural_frequency"] == pytest.approx(F * math.sqrt(0.8 / 1.3), rel=1e-14)


@pytest.mark.parametrize("share", [0.1, -0.05])
def test_a_second_mode_is_one_that_the_stage_model_could_state(share: float) -> None:
    stated = replace(BASE, modes=(Mode(50.0, 0.02, 0.1), Mode(300.0, 0.02, share)))
    given = {"second_mode": {"share": share, "frequency": 300.0, "damping_ratio": 0.02}}
    found = respond(given, base=replace(BASE, modes=stated.modes[:1]), substeps=4).motion
    assert np.array_equal(found, respond({}, base=stated, substeps=4).motion)
    parts = [reference.moved(drive, 60, PERIOD, *mode) for mode in ((F, ZETA), (300.0, 0.02))]
    alone = respond(given, COMMAND[:60], substeps=2).motion[0]
    assert alone == pytest.approx((1 - share) * parts[0] + share * parts[1], abs=1e-9 * 1e-4)


# --- readings ---------------------------------------------------------------------------------------------------

Y, T = RECORDED["y"], RECORDED["T"]
ADDED = {
    "abbe_error": ({"linear": -0.03}, -0.03 * Y),
    "cross_coupling": ({"linear": 0.02, "quadratic": 150.0}, 0.02 * Y + 150.0 * Y**2),
    "mains_hum": (
        {"amplitude": 80e-9, "frequency": 50.0, "phase": 0.4},
        80e-9 * (math.cos(0.4) * np.sin(100 * np.pi * TIME) + math.sin(0.4) * np.cos(100 * np.pi * TIME)),
    ),
    "pair_mismatch": ({"ratio": 0.015}, 0.015 * Y),
    "sensor_drift": ({"rate": -3e-7}, -3e-10 * np.arange(len(TIME))),
    "thermal_expansion": ({"coefficient": 2e-6}, 6e-6 * TIME),
}


@pytest.mark.parametrize("name", ADDED)
def test_what_is_added_to_the_reading(name: str) -> None:
    values, right = ADDED[name]
    plain, found = respond({}, substeps=2), respond({name: values}, substeps=2)
    assert np.array_equal(found.motion, plain.motion)
    assert found.reading[0] - plain.reading[0] == pytest.approx(right, abs=1e-18)


def test_a_misaligned_sensor_sees_cosine_and_sine() -> None:
    plain, found = respond({}, substeps=2), respond({"sensor_misalignment": {"angle": 0.3}}, substeps=2)
    assert found.reading[0] == pytest.approx(math.cos(0.3) * plain.motion[0] + math.sin(0.3) * Y, abs=1e-18)
    found = respond({"sensor_gain": {"error": -0.04}}, substeps=2)
    assert found.reading[0] == pytest.approx(0.96 * plain.motion[0], abs=1e-18)


def test_a_reading_is_rounded_after_everything_else() -> None:
    found = respond({"quantisation": {"step": 1e-7}, "sensor_drift": {"rate": 1e-6}, "sensor_gain": {"error": 0.1}})
    steps = found.reading[0] / 1e-7
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    exact = 1.1 * found.motion[0] + 1e-6 * TIME
    assert np.abs(found.reading[0] - exact).max() <= 0.5e-7 * (1 + 1e-9)


def test_a_disturbance_names_the_column_it_misses() -> None:
    axis = replace(BASE, effects={"abbe_error": start("abbe_error"), "thermal_expansion": start("thermal_expansion")})
    with pytest.raises(InputError, match=r"abbe_error: needs the response of another axis \(y, z\)"):
        stages.disturbance("x", axis, {"T": T}, TIME)
    with pytest.raises(InputError, match="thermal_expansion: needs a column T"):
        stages.disturbance("x", axis, {"y": Y}, TIME)
    assert stages.missing("x", effects.find("thermal_expansion"), {"x": Y}) == ("T",)
    assert stages.missing("x", effects.find("thermal_expansion"), {"T": T}) == ()
    assert stages.disturbance("x", BASE, {}, TIME) is None
    assert stages.disturbance("x", replace(BASE, effects={"abbe_error": strengths("abbe_error")}), {}, TIME) is None
    found = stages.disturbance("y", axis, {"x": Y, "z": 0 * Y, "T": T}, TIME)
    assert found == pytest.approx(0.01 * Y + 1e-6 * (T - T[0]), abs=1e-18)
    gap = np.where(TIME < 0.01, np.nan, T)
    found = stages.disturbance("x", axis, {"y": Y, "T": gap}, TIME)
    assert found is not None and np.isnan(found[:10]).all() and np.isfinite(found[10:]).all()


def test_hum_is_there_unless_other_disturbances_are_given() -> None:
    axis = replace(BASE, effects={"mains_hum": start("mains_hum"), "thermal_expansion": start("thermal_expansion")})
    hum = start("mains_hum")["amplitude"] * np.sin(100 * np.pi * TIME)
    stage, loops = Stage((stages.chain("x", axis),)), {"x": Loop(COMMAND)}
    for oversampling in (1, 3):
        time = PERIOD / oversampling * np.arange(oversampling * (len(COMMAND) - 1) + 1)
        found = simulate(stage, loops, PERIOD, substeps=2, oversampling=oversampling)
        right = start("mains_hum")["amplitude"] * np.sin(100 * np.pi * time)
        assert found.reading[0] - found.motion[0] == pytest.approx(right, abs=1e-18)
    found = simulate(stage, loops, PERIOD, substeps=2, disturbances={"x": 2 * hum})
    assert found.reading[0] - found.motion[0] == pytest.approx(2 * hum, abs=1e-18)
    assert np.array_equal(*(simulate(stage, loops, PERIOD, substeps=2, disturbances=each).reading for each in ({}, {})))
    with pytest.raises(ValueError, match="as many values as the command"):
        simulate(stage, loops, PERIOD, disturbances={"x": hum[1:]})


# --- superposition ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", effects.names())
def test_linear_effects_are_those_that_keep_superposition(name: str) -> None:
    """Twice the command gives twice the response; what adds to a reading in any case is taken out."""
    idle, once, twice = (respond({name: start(name)}, k * COMMAND, substeps=4).reading[0] for k in (0, 1, 2))
    deviation = np.abs((twice - idle) - 2 * (once - idle)).max() / np.abs(once).max()
    if name == "cross_coupling":  # bends with the square of another axis, whose motion is the same here
        assert deviation < 1e-9 and not effects.find(name).is_linear
    else:
        assert (deviation < 1e-9) == effects.find(name).is_linear, deviation
