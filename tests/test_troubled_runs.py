"""What goes wrong on a bench: found, named by line, used where it can be, refused where it cannot; and nothing made up.

Recordings are made from closed forms; what is flagged is compared with where the trouble was put.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.measurements.recordings import (
    Run,
    read_run,
    read_runs,
    refuse_wrong_units,
    split,
    suspicions,
    write_run,
)

Array = NDArray[np.float64]
T = 1e-3 * np.arange(2000)
#: Line of the file in which the first row stands.
FIRST = 2


def file(folder: Path, rows: Sequence[Sequence[object]], header: str = "t [s],u [V],x [um]") -> Path:
    path = folder / "run.csv"
    path.write_text("\n".join([header, *(",".join(str(cell) for cell in row) for row in rows), ""]))
    return path


def rows(u: Array, x: Array, t: Array = T) -> list[list[object]]:
    """Return rows as a logger writes them: times to the microsecond, readings to 0.1 nm."""
    return [[f"{a:.6f}", f"{b:.6g}", f"{c:.4f}"] for a, b, c in zip(t, u, x, strict=True)]


def sine(frequency: float = 2.0, lag: float = 0.0) -> Array:
    return np.sin(2 * np.pi * frequency * T - lag)


def noise(sigma: float, seed: int = 1) -> Array:
    return np.random.default_rng(seed).normal(0, sigma, len(T))


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_run(path)
    return str(caught.value).removeprefix(f"{path}: ")


# --- Rows that are missing, doubled, or out of order


def test_lost_rows_are_gaps(tmp_path: Path) -> None:
    made = rows(sine(), 10 * sine() + noise(0.01))
    lost = [60, 61, 500]
    run = read_run(file(tmp_path, [row for k, row in enumerate(made) if k not in lost]))
    assert len(run.time) == len(T)
    assert np.flatnonzero(np.isnan(run.measured())).tolist() == lost
    assert run.time == pytest.approx(T, abs=1e-9)
    assert run.command() == pytest.approx(sine(), abs=2e-4)  # bridged straight: (w 3 h)^2 / 8
    # Row 62 stands in line 62 now, and 501 in line 500.
    assert run.remarks == (
        "3 rows are missing before lines 62 and 500",
        "u is missing in 3 samples, the first at 0.06 s; bridged",
    )


def test_lost_rows_are_counted_by_the_period_and_not_by_its_rounded_digits(tmp_path: Path) -> None:
    """A period of 1.6384 ms, written to the microsecond: with the median step, 1.638 ms, 5000 rows would be 1 off."""
    t = 1.6384e-3 * np.arange(5000)
    made = [[f"{a:.6f}", np.sin(a), np.cos(a)] for a in t]
    run = read_run(file(tmp_path, [row for k, row in enumerate(made) if k not in (100, 4000)]))
    assert np.flatnonzero(np.isnan(run.measured())).tolist() == [100, 4000]
    assert run.period == pytest.approx(1.6384e-3, rel=1e-7)


@pytest.mark.parametrize("period", [1.5e-3, 1.2345e-3])
def test_times_with_too_few_digits_are_uniform_all_the_same(period: float, tmp_path: Path) -> None:
    made = [[f"{period * k:.3f}", np.sin(0.1 * k), np.cos(0.1 * k)] for k in range(1000)]
    # Two times to the millisecond are never alike, as the period is longer.
    run = read_run(file(tmp_path, made))
    assert run.period == pytest.approx(period, rel=1e-5) and not np.isnan(run.measured()).any()
    assert run.remarks[0].startswith(f"times are rounded to 1e-03 s; taken as uniform, {period:.6g}"[:45])


def test_missing_cells_are_gaps(tmp_path: Path) -> None:
    made = rows(sine(), 10 * sine() + noise(0.01))
    for row, cell in {7: "", 8: "nan", 9: "inf", 20: "NA"}.items():
        made[row][2] = cell
    run = read_run(file(tmp_path, made))
    assert np.flatnonzero(np.isnan(run.measured())).tolist() == [7, 8, 9, 20]
    assert run.remarks == (f"x is missing in lines {7 + FIRST} to {9 + FIRST} and {20 + FIRST}",)


def test_copies_of_rows_are_left_out(tmp_path: Path) -> None:
    made = rows(sine(), 10 * sine() + noise(0.01))
    run = read_run(file(tmp_path, [*made[:100], made[99], made[99], *made[100:300], *made[200:300], *made[300:]]))
    assert len(run.time) == len(T) and not np.isnan(run.measured()).any()
    assert run.remarks == ("lines 102 to 103 and 304 to 403: copies of earlier rows; left out",)


def test_rows_out_of_order_are_sorted(tmp_path: Path) -> None:
    made = rows(sine(), 10 * sine() + noise(0.01))
    made[50], made[51] = made[51], made[50]
    run = read_run(file(tmp_path, made))
    assert run.command() == pytest.approx(sine(), abs=1e-6)
    assert run.remarks == ("line 53: out of order; sorted by time",)


@pytest.mark.parametrize("back", [1000.0, 5.5], ids=["a second recording", "a clock that was set back"])
def test_time_running_backwards_is_refused(back: float, tmp_path: Path) -> None:
    t = np.where(np.arange(len(T)) < 1000, T, T - 1e-3 * back)
    said = refusal(file(tmp_path, rows(sine(), 10 * sine(3.0), t)))
    assert said.startswith("line 1002, column t = ") and "is not later than the row before (0.999 s)" in said


def test_one_time_with_two_readings_is_refused(tmp_path: Path) -> None:
    made = rows(sine(), 10 * sine() + noise(0.01))
    made[51][0] = made[50][0]
    assert refusal(file(tmp_path, made)).startswith("line 53, column t = 0.05 s: is not later than the row before")


def test_a_pause_longer_than_the_record_makes_two(tmp_path: Path) -> None:
    t = np.where(np.arange(len(T)) < 1000, T, T + 3600)
    said = refusal(file(tmp_path, rows(sine(), 10 * sine(), t)))
    assert said.startswith("line 1002, column t = 3601 s: comes 3600 s after the row before, where 0.001 s is usual")


# --- Irregular times


@pytest.mark.parametrize(("between", "most"), [("linear", 1e-3), ("hold", 0.13)])
def test_irregular_times_are_resampled(between: str, most: float, tmp_path: Path) -> None:
    """A spline through steps of up to 1.6 h errs by 5/384 (1.6 w h)^4 = 4e-4 of a sine of w = 2 pi 40 Hz."""
    t = T + 0.3e-3 * np.random.default_rng(2).uniform(-1, 1, len(T))
    w = 2 * np.pi * 40
    path = file(
        tmp_path,
        [[f"{a:.9f}", f"{b:.9g}", f"{c:.9g}"] for a, b, c in zip(t, np.sin(5 * t), np.sin(w * t), strict=True)],
    )
    (tmp_path / "measurements.toml").write_text(f'between_samples = "{between}"\n')
    run = read_run(path)
    inner = slice(5, -5)
    assert run.period == pytest.approx(1e-3, rel=0.02)  # the median step of jittered times
    assert run.measured()[inner] == pytest.approx(1e-6 * np.sin(w * run.time[inner]), abs=6e-10)
    # A held command lags by up to a step, a straight one by (w h)^2 / 8.
    assert run.command()[inner] == pytest.approx(
        np.sin(5 * run.time[inner]), abs=5 * 1.6e-3 if between == "hold" else 1e-5
    )
    assert len(run.remarks) == 1 and "apart, farthest before line" in run.remarks[0]
    assert not np.isnan(run.measured()).any()


def test_a_gap_between_irregular_times_stays_one(tmp_path: Path) -> None:
    t = T + 0.3e-3 * np.random.default_rng(2).uniform(-1, 1, len(T))
    kept = (t < 0.5) | (t > 0.6)
    u = np.where(T < 1, 0.0, np.sin(5 * T))
    run = read_run(
        file(tmp_path, [[f"{a:.9f}", b, c] for a, b, c in zip(t[kept], u[kept], np.sin(30 * t)[kept], strict=True)])
    )
    unknown = run.time[np.isnan(run.measured())]
    assert 0.498 < unknown.min() < 0.502 and 0.598 < unknown.max() < 0.602 and len(unknown) > 95
    assert "samples, the first at 0.499" in run.remarks[-1]


def test_a_command_that_never_moves_is_known_between_rows_far_apart(tmp_path: Path) -> None:
    """As of a controller that logs every 6 ms, and for a while every 40 ms: between, the command still stands."""
    t = np.cumsum(np.repeat([6e-3, 40e-3, 6e-3], [60, 6, 30]) + 5e-4 * np.random.default_rng(4).uniform(-1, 1, 96))
    run = read_run(file(tmp_path, [[f"{a:.9f}", 40, b] for a, b in zip(t, np.sin(5 * t), strict=True)]))
    assert np.all(run.command() == 40)
    assert np.isnan(run.measured()).any()
    assert run.remarks[1].startswith("u is missing in ") and run.remarks[1].endswith("bridged")


def test_times_by_chance_are_refused(tmp_path: Path) -> None:
    t = np.cumsum(np.random.default_rng(3).pareto(1.0, 2000) + 1e-3)
    said = refusal(file(tmp_path, [[f"{a:.9f}", np.sin(a), np.cos(a)] for a in t]))
    assert "split the file there" in said or "too irregular" in said


# --- Commands with gaps


def broken_command(folder: Path, u: Array, first: int, last: int) -> Path:
    made = rows(u, 10 * sine() + noise(0.01))
    for row in range(first, last):
        made[row][1] = "nan"
    return file(folder, made)


def test_a_long_gap_of_a_moving_command_is_refused(tmp_path: Path) -> None:
    said = refusal(broken_command(tmp_path, sine(), 700, 740))
    assert said.startswith("line 702, column u: is missing from 0.7 s to 0.739 s, 40 samples, in which it may have don")


def test_a_gap_of_a_command_at_rest_is_bridged(tmp_path: Path) -> None:
    u = np.where(T < 1.0, 5.0, sine())
    run = read_run(broken_command(tmp_path, u, 300, 600))
    assert run.command() == pytest.approx(u, abs=1e-5)
    assert run.remarks == ("u is missing in 300 samples, the first at 0.3 s; bridged",)
    said = refusal(broken_command(tmp_path, u, 300, 700))  # it rests shorter after the gap than the gap lasts
    assert said.startswith("line 302, column u: is missing")


@pytest.mark.parametrize("between", ["linear", "hold"])
def test_a_gap_of_a_command_on_its_way_along_a_line_is_bridged(between: str, tmp_path: Path) -> None:
    """As of a triangle; but not where it turns in the gap, or where a saw tooth jumps."""
    u = 8 * np.abs(T - 1.0)
    path = broken_command(tmp_path, u, 300, 500)
    (tmp_path / "measurements.toml").write_text(f'[[run]]\nfile = "run.csv"\nbetween_samples = "{between}"\n')
    assert read_run(path).command() == pytest.approx(u, abs=1e-5)
    assert refusal(broken_command(tmp_path, u, 920, 1080)).startswith("line 922, column u: is missing")
    assert refusal(broken_command(tmp_path, T % 1.0, 900, 1050)).startswith("line 902, column u: is missing")


def test_samples_without_a_command_at_the_ends_are_left_out(tmp_path: Path) -> None:
    run = read_run(broken_command(tmp_path, sine(), 0, 50))
    assert run.time[0] == pytest.approx(0.05) and len(run.time) == len(T) - 50
    assert run.remarks == ("the command is missing at an end: 50 samples are left out",)


# --- Sensors


def flagged(folder: Path, u: Array, x: Array, word: str) -> NDArray[np.intp]:
    run = read_run(file(folder, rows(u, x)))
    found = np.flatnonzero(np.isnan(run.measured()))
    assert len(run.remarks) == (1 if len(found) else 0)
    assert all(word in remark and "lines " in remark for remark in run.remarks)
    return found


@pytest.mark.parametrize("frequency", [2.0, 50.0])
@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_saturated_stretches_are_found(frequency: float, sigma: float, tmp_path: Path) -> None:
    x = 10 * sine(frequency) + noise(sigma)
    found = flagged(tmp_path, sine(frequency), np.clip(x, None, 8.0), "x is saturated in")
    beyond = np.flatnonzero(x >= 8.0)
    # Single samples at the limit, as noise leaves at the ends of each plateau, are good to the noise.
    assert set(found) <= set(beyond) and len(found) > 0.9 * len(beyond)


def test_a_stuck_sensor_is_found(tmp_path: Path) -> None:
    x = 10 * sine() + noise(0.01)
    x[600:900] = x[600]
    assert flagged(tmp_path, sine(), x, "x is stuck in").tolist() == list(range(600, 900))
    x[1500:] = x[1500]  # for good
    assert flagged(tmp_path, sine(), x, "x is stuck in").tolist() == [*range(600, 900), *range(1500, 2000)]


def test_a_sensor_that_dies_while_the_command_rests_shows_no_noise(tmp_path: Path) -> None:
    u = np.floor(4 * T)
    x = 3 * u + noise(0.01)
    x[1100:1200] = x[1100]
    assert flagged(tmp_path, u, x, "x is stuck in").tolist() == list(range(1100, 1200))


def quantised(step: float, lag: float) -> tuple[Array, Array]:
    return sine(), step * np.rint(10 * sine(lag=lag) / step)


def stairs(noisy: float, step: float) -> tuple[Array, Array]:
    """Stairs that a first-order lag follows, noise and quantisation added."""
    u = np.abs(4 - np.floor(4 * T))
    x = np.zeros(len(T))
    for k in range(1, len(T)):
        x[k] = x[k - 1] + 0.2 * (3 * u[k - 1] - x[k - 1])
    x += noise(noisy)
    return u, step * np.rint(x / step)


def late() -> tuple[Array, Array]:
    """Rest, then a ramp that the response follows 8 samples late, without noise."""
    u = np.clip(T - 0.5, 0, 0.5)
    return u, 10 * np.clip(T - 0.508, 0, 0.5)


def ringing() -> tuple[Array, Array]:
    """Stairs after which a mode of 80 Hz rings, and has died away in the last digit before the next."""
    u, x = np.floor(3 * (T - 0.05)) + 1, np.zeros(len(T))
    for k in range(6):
        since = np.clip(T - 0.05 - k / 3, 0, None)
        x += 10 * (since > 0) * (1 - np.exp(-40 * since) * np.cos(2 * np.pi * 80 * since))
    return u, x


HEALTHY: dict[str, Callable[[], tuple[Array, Array]]] = {
    "a fine sensor": lambda: quantised(0.001, 0.0),
    "a coarse sensor": lambda: quantised(0.1, 0.0),
    "a fine sensor, late": lambda: quantised(0.001, 0.8),
    "a coarse sensor, late": lambda: quantised(0.1, 0.8),
    "stairs without noise": lambda: stairs(0.0, 1e-4),
    "stairs with noise below the step": lambda: stairs(0.004, 0.02),
    "stairs with noise of the step": lambda: stairs(0.02, 0.02),
    "rings, then rests": ringing,
    "late": late,
    "quiet": lambda: (0 * T, 0.02 * np.rint(noise(0.004) / 0.02)),
    "dead quiet": lambda: (0 * T, 0 * T + 1.5),
    "rests at the lowest reading": lambda: (np.clip(sine(), 0, None), 10 * np.clip(sine(), 0, None)),
    "a square": lambda: (np.sign(sine(5.0, 0.01)), 10 * np.sign(sine(5.0, 0.01))),
    "fast beyond resonance": lambda: (
        sine(2.0) + sine(200.0, 0.1),
        0.05 * np.rint(200 * sine(2.0, 0.2)) + 0.01 * sine(200.0),
    ),
}


@pytest.mark.parametrize("made", HEALTHY.values(), ids=HEALTHY)
def test_what_is_healthy_is_left_alone(made: Callable[[], tuple[Array, Array]], tmp_path: Path) -> None:
    run = read_run(file(tmp_path, rows(*made())))
    assert not np.isnan(run.measured()).any()
    assert run.remarks == ()


def test_a_stated_range_is_believed(tmp_path: Path) -> None:
    path = file(tmp_path, rows(sine(), np.clip(10 * sine() + noise(0.02), -9, 8)))
    (tmp_path / "measurements.toml").write_text('[sensors.x]\nrange = ["-9 um", "0.008 mm"]\n')
    run = read_run(path)
    lost = np.isnan(run.measured())
    assert lost.tolist() == [abs(x + 0.5) >= 8.5 for x in np.clip(10 * sine() + noise(0.02), -9, 8)]
    assert run.remarks[0].startswith("x is at the end of its range in lines ")


def test_a_response_that_never_moves(tmp_path: Path) -> None:
    said = refusal(file(tmp_path, rows(sine(), 0 * T + 3.2)))
    assert said.startswith("column x: reads 3.2e-06 m in every row while u moves; check the sensor")
    made = [[*row, 1] for row in rows(sine(), 10 * sine() + noise(0.01))]
    run = read_run(file(tmp_path, made, "t [s],u [V],x [um],y [um]"))
    assert run.responses == ("x",) and run.remarks == ("y reads 1e-06 m in every row while u moves; left out",)
    said = refusal(file(tmp_path, rows(sine(), np.full(len(T), np.nan))))
    assert said.startswith("column x: has no reading at all; remove the column")


def test_troubles_together(tmp_path: Path) -> None:
    x = 10 * sine() + noise(0.01)
    x[600:900] = x[600]
    made = rows(sine(), x)
    made[10][2] = ""
    made = [*made[:1500], made[1499], *made[1502:]]
    run = read_run(file(tmp_path, made))
    assert np.flatnonzero(np.isnan(run.measured())).tolist() == [10, *range(600, 900), 1500, 1501]
    assert run.remarks == (
        "line 1502: copies of earlier rows; left out",
        "x is missing in line 12",
        "x is stuck in lines 602 to 901; not used there",
        "2 rows are missing before line 1503",
        "u is missing in 2 samples, the first at 1.5 s; bridged",
    )


# --- Units wrong by a thousand


def made(u: Array, x: Array, name: str = "run", **more: object) -> Run:
    return Run(name, T[: len(u)], {"u": u, "x": x}, {"u": "V", "x": "m"}, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(("factor", "words"), [(1e3, "a thousandth"), (1e-3, "a thousand times"), (1e6, "a millionth")])
def test_units_wrong_by_a_thousand_are_suspected(factor: float, words: str) -> None:
    (said,) = suspicions(made(75 * sine(), factor * 75 * 2e-6 * sine()), gain=2e-6)
    assert words in said and "gain times command" in said and "or that of u?" in said


@pytest.mark.parametrize("factor", [0.05, 1.0, -1.0, 20.0])
def test_a_resonance_or_a_stiff_stage_is_not_suspected(factor: float) -> None:
    assert suspicions(made(75 * sine(), factor * 75 * 2e-6 * sine()), gain=2e-6) == ()
    assert suspicions(made(0 * T, 1e-9 * sine()), gain=2e-6) == ()


@pytest.mark.parametrize(
    ("factor", "words"), [(1e3, "a thousand times the 0.300 mm"), (1e-3, "a thousandth of the 0.300 mm")]
)
def test_units_wrong_by_a_thousand_are_refused_where_the_response_follows(factor: float, words: str) -> None:
    with pytest.raises(InputError) as refused:
        refuse_wrong_units(made(75 * sine(), factor * 75 * 2e-6 * sine()), 2e-6, "x")
    assert (refused.value.file, refused.value.field) == ("run", "column x")
    assert words in str(refused.value) and "correct the unit of x or of u" in refused.value.remedy


def test_a_small_response_that_does_not_follow_is_not_refused() -> None:
    """Far above a resonance it is small and against the command; of a dead sensor it is noise."""
    noise = 1e-7 * np.random.default_rng(0).standard_normal(len(T))
    for response in (-1e-3 * 75 * 2e-6 * sine(), noise):
        run = made(75 * sine(), response)
        refuse_wrong_units(run, 2e-6, "x")
        assert suspicions(run, 2e-6, "x")
    refuse_wrong_units(made(0 * T, noise), 2e-6, "x")


# --- measurements.toml

DESCRIPTION = """\
format = 1
title = "Bench 3"
axis = "x"
command_is = "monitor"
scale = 20
bias = "-0.5 V"
limits = ["-5 V", "150 V"]
between_samples = "hold"

[sensors.x]
noise = "2 nm"
range = ["-50 um", "50 um"]
point = ["0 mm", "12 mm", "3 mm"]
direction = [3, 0, 4]

[[run]]
file = "run.csv"
kind = "multisine"
role = "validate"
closed_loop = true
conditions = { payload = "50 g", temperature = "23 degC" }
"""


def test_all_that_is_said_reaches_the_run(tmp_path: Path) -> None:
    path = file(tmp_path, [[*row, 7] for row in rows(sine(), 10 * sine() + noise(0.01))], "t [s],u [V],x [um],v [V]")
    (tmp_path / "measurements.toml").write_text(DESCRIPTION)
    run = read_run(path)
    assert run.command() == pytest.approx(20 * sine() - 0.5, abs=1e-4)
    assert run.columns["v"] == pytest.approx(7.0)
    said = (run.command_is, run.limits, run.between_samples, run.kind, run.role, run.role_is_stated, run.closed_loop)
    assert said == ("monitor", (-5.0, 150.0), "hold", "multisine", "validate", True, True)
    assert (run.payload, run.axis) == (pytest.approx(0.05), "x")
    assert run.temperature == pytest.approx(296.15)
    sensor = run.sensors["x"]
    assert sensor.noise == pytest.approx(2e-9) and sensor.range == pytest.approx((-5e-5, 5e-5))
    assert sensor.point == pytest.approx((0, 0.012, 0.003)) and sensor.direction == pytest.approx((0.6, 0, 0.8))
    (remark,) = run.remarks
    assert remark == "u goes from -20.5 V to 19.5 V, beyond the limits -5 V to 150 V that are stated"


def test_a_reference_means_a_closed_loop_unless_it_is_denied(tmp_path: Path) -> None:
    path = file(tmp_path, [[*row, 1] for row in rows(sine(), 10 * sine())], "t [s],u [V],x [um],r [um]")
    assert read_run(path).closed_loop
    (tmp_path / "measurements.toml").write_text('[[run]]\nfile = "run.csv"\nclosed_loop = false\n')
    assert not read_run(path).closed_loop


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("axis =", "axes =", "axes = x: is not a known key; did you mean axis or bias?"),
        ('"monitor"', '"amplifier"', "command_is = amplifier: expected dac or stack or monitor"),
        ("scale = 20", 'scale = "20 V"', "scale = 20 V: 'V' is wrong here"),
        ("scale = 20", "scale = 0", "scale = 0: makes every command zero"),
        ('"-0.5 V"', '"-0.5 mm"', "bias = -0.5 mm: 'mm' is wrong here"),
        ('["-5 V", "150 V"]', '["150 V", "-5 V"]', "limits = ['150 V', '-5 V']: the first must be the lower one"),
        ('["-5 V", "150 V"]', '"150 V"', "limits = 150 V: expected the lowest and the highest"),
        ('"hold"', '"zoh"', "between_samples = zoh: expected linear or hold"),
        ("[sensors.x]", "[sensor.x]", "sensor: is not a known key; did you mean sensors?"),
        ("[sensors.x]", "[sensors.q]", "sensors.q: is not a known key; known: x, y"),
        ('noise = "2 nm"', 'nois = "2 nm"', "sensors.x.nois = 2 nm: is not a known key; did you mean noise?"),
        ('noise = "2 nm"', "noise = 2", "sensors.x.noise = 2: the unit is missing"),
        ('noise = "2 nm"', 'noise = "2 mV"', "sensors.x: is in V, but x of run.csv in um; correct one of the two"),
        ('"50 um"]', '"50 V"]', "sensors.x.range = ['-50 um', '50 V']: mixes units of different kinds"),
        ("[3, 0, 4]", "[0, 0, 0]", "sensors.x.direction = [0, 0, 0]: has no length"),
        ("[3, 0, 4]", "[1, 0]", "sensors.x.direction = [1, 0]: expected three along x, y and z"),
        ('"3 mm"]', '"3 V"]', "sensors.x.point = ['0 mm', '12 mm', '3 V']: 'V' is wrong here"),
        ('kind = "multisine"', 'kin = "multisine"', "run 1.kin = multisine: is not a known key; did you mean kind?"),
        ("closed_loop = true", 'closed_loop = "maybe"', "run 1.closed_loop = maybe: expected true or false"),
        ('"50 g"', '"50 N"', "run 1.conditions.payload = 50 N: 'N' is wrong here"),
        ('"50 g"', '"-50 g"', "run 1.conditions.payload = -50 g: allowed: 0 to 1e+06 g"),
        ('"23 degC"', '"warm"', 'run 1.conditions.temperature = warm: is no temperature; write for example "23 degC"'),
        ("payload", "pay_load", "run 1.conditions.pay_load = 50 g: is not a known key; did you mean payload?"),
        ("format = 1", "format = 2", "format = 2: this version reads format = 1"),
        ("[[run]]", "[[runs]]", "runs: is not a known key; did you mean run?"),
    ],
)
def test_what_cannot_be_meant_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = file(tmp_path, rows(sine(), 10 * sine() + noise(0.01)))
    assert old in DESCRIPTION
    (tmp_path / "measurements.toml").write_text(DESCRIPTION.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_run(path)
    assert str(caught.value).startswith(f"{tmp_path / 'measurements.toml'}: {message}")


# --- Parquet


def test_parquet_is_read_as_csv_is(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    x = np.where(np.arange(len(T)) == 7, np.nan, 1e-5 * sine())
    for name in ("a.csv", "b.parquet"):
        write_run(tmp_path / name, T, {"u [mV]": sine(), "x [um]": x}, "bench 3", gaps=True)
    text, binary = read_runs([tmp_path])
    assert (text.name, binary.name) == ("a", "b")
    assert binary.command() == pytest.approx(sine(), rel=1e-15, abs=1e-15)
    assert np.flatnonzero(np.isnan(binary.measured())).tolist() == [7]
    assert binary.measured() == pytest.approx(text.measured(), rel=1e-11, nan_ok=True)
    assert (text.remarks, binary.remarks) == (("x is missing in line 10",), ("x is missing in row 8",))


def test_parquet_that_cannot_be_used(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "run.parquet"
    whole = {"t [s]": T, "u [V]": T, "x [um]": T}
    for columns, message in (
        ({**whole, "x [um]": ["a"] * len(T)}, "column x [um]: has a cell that is no number"),
        ({**whole, "x": T}, "column 4 = x: write name and unit"),
        ({**whole, "t [s]": [None, *T[1:]]}, "row 1, column t = nan: is not a finite number"),
        ({}, "has no rows"),
    ):
        parquet.write_table(pyarrow.table(columns), path)
        assert refusal(path).startswith(message)
    path.write_bytes(path.read_bytes()[:-5])
    assert refusal(path).startswith("cannot be read")
    assert refusal(tmp_path / "none.parquet").startswith("cannot be read: No such file")


# --- Splitting


def roles(runs: Sequence[Run]) -> str:
    return "".join(run.role[0] for run in split(runs))


def suite(*kinds: str) -> list[Run]:
    return [made((kind != "quiet") * sine(), 1e-6 * sine(), f"{kind}{k}", kind=kind) for k, kind in enumerate(kinds)]


@pytest.mark.parametrize(
    ("kinds", "expected"),
    [
        (("quiet", "sine", "sine", "step"), "iivi"),
        (("multisine", "multisine", "multisine", "triangle", "triangle", "step", "quiet", "hold"), "iiviviii"),
        (("quiet", "quiet", "sine", "sine"), "iiiv"),
        (("", "", "", "", "", "", "", ""), "iiiviiiv"),
        ((" Sine", "sine "), "iv"),
    ],
)
def test_runs_are_kept_by_kind(kinds: tuple[str, ...], expected: str) -> None:
    assert roles(suite(*kinds)) == expected


def test_roles_that_were_chosen_stay() -> None:
    runs = suite("sine", "sine", "sine")
    runs[0] = made(sine(), sine(), kind="sine", role_is_stated=True)
    assert roles(runs) == "iii"
    assert roles([made(sine(), sine(), role="validate"), made(sine(), sine())]) == "vi"


@pytest.mark.parametrize(
    ("kinds", "expected"),
    [
        (("quiet", "", "", "", "", ""), "iiiiiv"),  # five that move are too few
        (("", "", "", "", "", ""), "iivtiv"),
        (("", "", "", "", "", "", "", ""), "iiivtiiv"),
        (("sine", "sine", "sine", "sine", "step", "hold"), "ivtvii"),
        (("sine", "sine", "step", "step", "hold", "hold"), "ivivit"),
        (("sine", "sine", "step", "hold", "triangle", "staircase"), "iviiii"),  # the others are alone of their kinds
    ],
)
def test_one_of_many_runs_is_for_testing(kinds: tuple[str, ...], expected: str) -> None:
    assert "".join(run.role[0] for run in split(suite(*kinds), test=True)) == expected
    assert roles(suite(*kinds)) == expected.replace("t", "i")


def test_a_run_for_testing_is_a_choice_of_roles() -> None:
    assert roles([made(sine(), sine(), role="test"), *suite("sine", "sine", "sine")]) == "tiii"


def test_where_no_kind_was_repeated_the_longest_run_is_split() -> None:
    short = Run("step", T[:1000], {"u": T[:1000], "x": T[:1000]}, {"u": "V", "x": "m"}, kind="step")
    found = split([short, *suite("quiet", "sine")])
    assert [run.name for run in found] == ["step", "quiet0", "sine1:identify", "sine1:validate"]


def test_halves_of_one_record_are_simulated_straight_through() -> None:
    (whole,) = suite("sine")
    seen, kept = split([whole])
    for half in (seen, kept):
        assert half.command() is whole.command() and half.time is whole.time
        there = np.isfinite(half.measured())
        assert (half.measured()[there] == whole.measured()[there]).all()
    judged, taught = np.isfinite(kept.measured()), np.isfinite(seen.measured())
    assert not (judged & taught).any()
    # A quarter, less half a percent at each of four borders; the rest, less as much.
    assert judged.sum() == 500 - 40 and taught.sum() == 1500 - 40
    distance = np.abs(np.flatnonzero(judged)[:, None] - np.flatnonzero(taught)).min()
    assert distance == 21
    tiny = Run("tiny", T[:100], {"u": T[:100], "x": T[:100]}, {"u": "V", "x": "m"})
    assert split([tiny]) == (tiny,)
