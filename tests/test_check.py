"""`flexdesign check`: recordings with one fault each, put there on purpose, and clean ones, where nothing is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter, ss2tf

import flexdesign as fd
from flexdesign.diagnosis.check import coverage, timing
from flexdesign.diagnosis.check.suspicion import outliers
from flexdesign.measurements.recordings import FrequencyResponse, Run, command_segments, write_run
from flexdesign.report.diagnosis import check_report

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared" / "data"
RATE, N = 1000.0, 4000
T = np.arange(N) / RATE
NOISE = 20e-9


def multisine(seed: int, span: float = 50.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    made = sum(np.cos(2 * np.pi * k * 2 * T + rng.uniform(0, 6.28)) for k in range(1, 150))
    made[:1000] = 0.0
    return 60 + span * made / np.ptp(made)


def reading(u: np.ndarray, seed: int = 0, *, method: str = "foh", noise: float = NOISE, f0: float = 90.0) -> np.ndarray:
    """Return the response of a mass on a spring, by SciPy's discretisation of it."""
    w = 2 * np.pi * f0
    a, b = np.array([[0, 1], [-(w**2), -0.06 * w]]), np.array([[0], [2e-6 * w**2]])
    *system, _ = cont2discrete((a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 1 / RATE, method=method)
    numerator, denominator = ss2tf(*system)
    x = lfilter(numerator[0], denominator, u - u[0]) + 2e-6 * u[0]
    return np.asarray(x + noise * np.random.default_rng(seed).normal(size=len(u)))


def run(name: str, u: np.ndarray, x: np.ndarray, **more: Any) -> Run:
    return Run(name, T, {"u": u, "x": x}, {"u": "V", "x": "m"}, **more)


def clean() -> list[Run]:
    small = multisine(2, 10.0)
    return [run("a", multisine(1), reading(multisine(1), 1)), run("b", small, reading(small, 2), role="validate")]


def said(*runs: Run | FrequencyResponse) -> str:
    return "\n".join(f"{s.recording}: {s.what} -> {s.remedy}" for s in fd.check(runs).suspicions)


def test_nothing_is_said_of_clean_recordings() -> None:
    assert said(*clean()) == ""
    found = fd.check(clean())
    assert all({"quiet", "multisine"} <= set(each.kinds) for each in found.recordings)
    channel = next(c for c in found.recordings[0].channels if c.name == "x")
    assert channel.noise == pytest.approx(NOISE, rel=0.1)


def test_triangles_of_falling_heights_are_no_multisine() -> None:
    """Their spectrum is as wide as that of a multisine; and one of low frequencies is none of straight lines."""
    corners = np.array([0, 100, 0, 80, 0, 60, 0, 40, 0, 100, 0], dtype=float)
    loops = np.interp(T, np.linspace(0.25, 3.75, len(corners)), corners)
    assert coverage._is_broad(loops[::10])  # as fast as to have jumps in place of lines
    for u in (loops, np.round(loops, 2)):
        assert {"triangle", "quiet"} == set(coverage.kinds_of(run("a", u, reading(u))))
    ramps = np.interp(T, [0, 0.3, 1.5, 2.0, 3.4, 4.0], [0, 0, 100, 20, 90, 0])
    assert "multisine" not in coverage.kinds_of(run("a", ramps, reading(ramps)))
    rng = np.random.default_rng(3)
    slow = sum(np.cos(2 * np.pi * k * T / 4 + rng.uniform(0, 6.28)) for k in range(1, 12))
    assert "multisine" in coverage.kinds_of(run("a", slow, reading(slow)))


def test_codes_for_overrange_are_named() -> None:
    """Nine samples of a code in a row, and single lost bits in another run; the range of a sensor is a remedy."""
    one, other = clean()
    code = one.measured().copy()
    code[1101:1110] = 9999e-6
    text = said(run("a", one.command(), code), other)
    assert "a: x jumps to 9999 um and back in 9 samples, the first at 1.101 s, while no command jumps" in text
    assert "leave their cells empty" in text
    u = 50 - 50 * np.cos(2 * np.pi * 1.5 * T)
    lost = reading(u)
    lost[[700, 1500, 2200]] -= 40e-6
    lost[1000] = np.nan
    assert "and back in 3 samples, the first at 0.7 s" in said(run("a", u, lost), other)


def test_no_motion_is_taken_for_an_outlier() -> None:
    """Steps, short pulses and noise as commands, with resonances up to the Nyquist frequency, and coarse readings."""
    pulses = 20.0 + 50 * (np.arange(N) % 400 < 3)
    steps = np.repeat([0.0, 100.0, 30.0, 70.0], N // 4)
    still = np.full(N, 3.0)
    noise = np.random.default_rng(4).normal(size=N)
    for u in (multisine(1), pulses, steps, still, noise):
        for f0 in (20.0, 90.0, 250.0, 480.0):
            for sigma in (0.0, NOISE):
                x = reading(u, 3, f0=f0, noise=sigma)
                for made in (x, 1e-7 * np.round(x / 1e-7)):
                    assert not len(outliers(run("a", u, made), "x"))


def test_equal_commands_in_fitted_and_validation_runs() -> None:
    one, other = clean()
    again = run("again", one.command(), reading(one.command(), 9), role="validate")
    assert "again: has the same command as a, which is fitted" in said(one, other, again)


def test_half_a_sample() -> None:
    u = multisine(1)
    held = run("a", u, reading(u, 1, method="zoh"))
    assert "half a sample later than straight lines between its samples make it -> the command was held: write" in said(
        held, clean()[1]
    )
    assert "half a sample" not in said(replace(held, between_samples="hold", between_is_stated=True), clean()[1])


@pytest.mark.parametrize("noise", [2e-9, 20e-9, 100e-9])
def test_timing_is_never_told_wrongly(noise: float) -> None:
    """Held and linear commands of several kinds, resonances and noise: unclear is allowed, wrong is not."""
    told = 0
    for seed in range(2):
        rng = np.random.default_rng(seed)
        for f0 in (60.0, 118.0, 250.0):
            for u in (
                multisine(seed),
                rng.normal(size=N),
                np.repeat(rng.normal(size=N // 100), 100),
                50 * np.abs(T % 1 - 0.5),
            ):
                for method in ("foh", "zoh"):
                    found = timing.timing_of(run("a", u, reading(u, seed, method=method, noise=noise, f0=f0)), "x")
                    assert found in (None, "held" if method == "zoh" else "linear")
                    told += found is not None
    assert told > 20


def test_columns_that_are_shifted() -> None:
    one, other = clean()
    early = run("a", one.command(), np.roll(one.measured(), -2))
    text = said(early, other)
    assert "x answers u before it changes: the columns are shifted by a sample" in text
    assert "u is no command but follows from x, as in a closed loop" in text


def test_a_response_that_does_not_follow() -> None:
    one, other = clean()
    other_noise = reading(np.random.default_rng(5).normal(size=N), 3)
    assert "x hardly follows u: their coherence is 0." in said(run("a", one.command(), other_noise), other)


def test_a_response_follows_a_slow_ramp_that_a_converter_writes_in_steps() -> None:
    """Within a stretch of it there is little but the steps, and the noise of the reading."""
    ramp = np.round(np.linspace(0.0, 0.05, N) / 5e-4) * 5e-4
    noisy = -2e-6 * ramp + 4e-9 * np.random.default_rng(6).normal(size=N)
    assert "hardly follows" not in said(run("a", ramp, noisy), clean()[1])


def test_what_is_alike_in_several_recordings_is_said_once() -> None:
    others = [
        run(name, multisine(k), reading(np.random.default_rng(k).normal(size=N), k)) for k, name in enumerate("pqr")
    ]
    found = fd.check([*clean(), *others])
    assert sum("hardly follows" in each.what for each in found.suspicions) == 3
    text = str(found)
    assert text.count("hardly follows") == 1 and "p and 2 others alike: x hardly follows u" in text


def test_filtered_noise() -> None:
    runs = [
        replace(each, columns={"u": each.command(), "x": each.measured() - reading(each.command(), noise=0) + 0})
        for each in clean()
    ]
    filtered = []
    for each in runs:
        colour = lfilter([0.25, 0.25, 0.25, 0.25], [1.0], each.measured())
        filtered.append(replace(each, columns={"u": each.command(), "x": reading(each.command(), noise=0) + colour}))
    assert "the noise of x is filtered" in said(*filtered)


def test_settling_after_steps_is_no_noise() -> None:
    """A lag of 0.3 s that follows steps, each held for 5 s: the noise is known to 3 % or better."""
    u, pole = np.repeat([0.0, 40.0, 90.0, 20.0, 60.0], 5000), np.exp(-1 / (0.3 * RATE))
    x = 2e-6 * lfilter([1 - pole], [1, -pole], u) + NOISE * np.random.default_rng(1).normal(size=len(u))
    steps = Run("a", np.arange(len(u)) / RATE, {"u": u, "x": x}, {"u": "V", "x": "m"})
    channel = next(c for c in fd.check([steps]).recordings[0].channels if c.name == "x")
    assert channel.noise == pytest.approx(NOISE, rel=0.1)


def test_unknown_noise_one_size_and_no_validation() -> None:
    u = 60 + 50 * np.sin(2 * np.pi * 3.3 * T)
    lone = Run("a", T[:300], {"u": u[:300], "x": reading(u)[:300]}, {"u": "V", "x": "m"})
    text = said(lone)
    assert "the noise of x is unknown" in text and "no run can be kept for validation" in text
    v = 60 + 50 * np.sin(2 * np.pi * 4.7 * T + 1)
    assert "u has one size, 100 V peak to peak" in said(run("a", u, reading(u)), run("b", v, reading(v)))
    smaller = said(run("a", u, reading(u)), run("b", 0.8 * v, reading(0.8 * v)))
    assert "u has nearly one size, 80 to 100 V peak to peak" in smaller
    assert check_report.table(fd.check([run("a", u, reading(u))])).rows[0][1] == "slow loops"  # a sine is no triangle


def test_steps_of_several_sizes_are_no_command_of_one_size() -> None:
    """As pseudo-random steps of random heights, whose whole range is the same in both runs."""
    heights = [0.0, 100.0, 30.0, 70.0, 20.0, 0.0, 50.0, 90.0]
    u, v = np.repeat(heights, N // 8), np.repeat(heights[::-1], N // 8)
    assert "one size" not in said(run("a", u, reading(u)), run("b", v, reading(v)))
    square = np.repeat([0.0, 100.0] * 4, N // 8)
    assert "u has one size" in said(run("a", square, reading(square)), run("b", 100 - square, reading(100 - square)))
    shown = {each.effect for each in coverage.coverage(coverage.kinds_of(run("a", u, reading(u)))) if each.kinds}
    assert {"stress_stiffening", "preload_loss", "driver_bandwidth"} <= shown and "sensor_gain" not in shown


def test_too_few_samples_in_a_period() -> None:
    u = multisine(1)
    assert "x rings at about" in said(run("a", u, reading(u, f0=220.0)), clean()[1])


def test_faults_that_the_reader_finds_get_a_remedy(tmp_path: Path) -> None:
    u = multisine(1)
    x = np.clip(reading(u), None, 1.5e-4)
    write_run(
        tmp_path / "a.csv",
        np.delete(T, [50, 900]),
        {"u [V]": np.delete(u, [50, 900]), "x [um]": np.delete(x, [50, 900])},
    )
    text = "\n".join(f"{s.what} -> {s.remedy}" for s in fd.check(tmp_path).suspicions)
    assert "2 rows are missing before" in text and "samples were dropped" in text
    assert "x is saturated" in text and "record again with a smaller motion" in text


# --- coverage

KINDS: dict[str, tuple[np.ndarray, str]] = {
    "triangle": (50 * np.abs((1.7 * T) % 1 - 0.5), "triangle"),
    "slow sine": (50 * np.sin(2 * np.pi * T), "triangle"),
    "multisine": (multisine(1), "multisine"),
    "noise": (np.random.default_rng(1).normal(size=N), "multisine"),
    "step": (np.where(T > 1, 50.0, 0.0), "steps"),
    "levels": (np.repeat([0.0, 30, 10, 50, 20, 40, 5, 35], N // 8), "staircase"),
    "rest": (np.full(N, 20.0), "quiet"),
}


@pytest.mark.parametrize("name", KINDS)
def test_kinds_of_experiment(name: str) -> None:
    u, kind = KINDS[name]
    found = coverage.kinds_of(run("a", u, u))
    assert kind in found
    assert kind == "multisine" or "multisine" not in found
    assert kind == "triangle" or "triangle" not in found


def test_a_slow_ramp_does_not_rest() -> None:
    """Of many samples each is near the one before. One rise and one fall are a loop; what rests in between is quiet."""
    rise = np.linspace(0, 90, 30000)
    for u, rests in ((np.r_[rise, rise[::-1]], set()), (np.r_[rise, np.full(2000, 90.0), rise[::-1]], {"quiet"})):
        assert set(coverage.kinds_of(run("a", u, u))) == {"triangle", *rests}
        assert [end - first for first, end in command_segments.rests(u)] == (
            [pytest.approx(2000, abs=100)] if rests else []
        )


def test_what_is_shown_follows_from_the_experiments() -> None:
    quiet = run("a", np.full(N, 20.0), reading(np.full(N, 20.0)))
    step = Run(
        "b",
        np.arange(15000) / 100,
        {"u": np.where(np.arange(15000) > 100, 50.0, 0.0), "x": np.zeros(15000)},
        {"u": "V", "x": "m"},
    )
    assert "mains_hum" not in fd.check([quiet]).hidden and "creep" in fd.check([quiet]).hidden
    assert "creep" not in fd.check([step]).hidden
    assert fd.check([quiet])["creep"] == ()
    warm = replace(quiet, columns={**quiet.columns, "T": 293 + T}, si={**quiet.si, "T": "K"})
    assert "thermal_expansion" not in fd.check([warm]).hidden


# --- frequency responses and static tables


def test_frequency_responses(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    f = np.arange(10.0, 300.0, 10.0)
    h = 2.0 / (1 - (f / 118) ** 2 + 2j * 0.01 * f / 118)
    rows = "\n".join(f"{a},{abs(b):.6g},{np.angle(b, deg=True):.6g}" for a, b in zip(f, h, strict=True))
    (tmp_path / "r.csv").write_text("f [Hz],magnitude [um/V],phase [deg]\n" + rows + "\n")
    ended = command_line("check", "r.csv")
    assert ended.code == 0
    text = " ".join(ended.stdout.split())
    assert "29 lines" in text and "10.00 to 290.0 Hz" in text
    assert "has no coherence" in text and "its lines are 10 Hz apart" in text


def test_of_poor_lines_the_number_of_averages_is_asked_for_all_the_same() -> None:
    """Without it the coherence tells nothing of the noise."""
    f = np.arange(10.0, 300.0, 10.0)
    poor = np.where(f < 60, 0.4, 1.0)
    response = FrequencyResponse("sweep", f, 1e-6 / (1 - (f / 118) ** 2 + 0.2j * f / 118), coherence=poor)
    text = said(response)
    assert "17 % of its lines have a coherence below 0.5" in text and "write averages = ... for it" in text
    assert "write averages" not in said(replace(response, averages=16))


def test_a_static_table_that_goes_together_and_one_that_does_not(tmp_path: Path) -> None:
    table = (ROOT / "studies" / "hidden_over_cut" / "bench.csv").read_text()
    (tmp_path / "t.csv").write_text(table)
    found = fd.check(tmp_path / "t.csv")
    assert not found.suspicions and found.tables[0].parts == 3
    (tmp_path / "t.csv").write_text(table.replace("K_out,4.386", "K_out,4.786"))
    (only,) = fd.check(tmp_path / "t.csv").suspicions
    assert "lines 3, 4, 5, 6 do not go together" in only.what
    (tmp_path / "t.csv").write_text(table + "K_in,700,N/mm,0.5 %,free,0.35\n")
    assert any(
        "lines 3 and 15: K_in, free, differs by 6.48 %" in s.what for s in fd.check(tmp_path / "t.csv").suspicions
    )


def test_the_command(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    runs = str(ROOT / "studies" / "hidden_effect_demo" / "runs")
    ended = command_line("check", runs, "--json")
    content = json.loads(ended.stdout)
    assert ended.code == 0 and len(content["recordings"]) == 6 and content["suspicions"] == []
    ended = command_line("check", runs, "--out", "report")
    assert {path.name for path in (tmp_path / "report").iterdir()} >= {"report.html", "report.md", "result.json"}
    assert "6 recordings, nothing suspicious" in " ".join(ended.stdout.split())
    assert f"Next: flexdesign compare MODEL {runs}\n" in ended.stderr
    assert command_line("check", "none.csv").code == 2


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"the recordings of others are not at {SHARED}")
@pytest.mark.parametrize(
    ("folder", "words"),
    [
        ("positioning-drive", ["2-pulses: has the same command as 1-identify"]),
        ("duffing-circuit", ["x is in volts"]),
        ("piezo-loops", ["the noise of x is unknown"]),
        ("piezo-actuator", ["x rings at about 960 Hz and is sampled at 2500 Hz"]),  # 967 Hz by its README
        ("disc-player-arm", ["y is in volts"]),
    ],
)
def test_recordings_of_others(folder: str, words: list[str]) -> None:
    found = fd.check(SHARED / folder)
    text = "\n".join(f"{s.recording}: {s.what}" for s in found.suspicions)
    assert all(word in text for word in words)
    assert "before it changes" not in text  # nothing of these is shifted
