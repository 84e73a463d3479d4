"""Frequency responses as files, and their noise: what is read, what is refused, and what coherence says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.dynamics.axis.axis_response import of_axis
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.measurements.noise_level import line_noise
from flexdesign.measurements.recordings import (
    FrequencyResponse,
    Run,
    read_frequency_response,
    read_recordings,
    read_runs,
    split_lines,
)

LINES = np.geomspace(1.0, 400.0, 60)
MODE = 2e-6 / (1 - (LINES / 118.0) ** 2 + 2j * 0.03 * LINES / 118.0)


def written(folder: Path, header: str, rows: list[list[float]], said: str = "") -> Path:
    path = folder / "sweep.csv"
    path.write_text("# from the analyser\n" + "\n".join([header, *(",".join(f"{v!r}" for v in row) for row in rows)]))
    if said:
        (folder / "measurements.toml").write_text(f'[[run]]\nfile = "sweep.csv"\n{said}')
    return path


def polar(coherence: float = 0.99) -> list[list[float]]:
    return [
        [float(f), float(1e6 * abs(h)), float(np.degrees(np.angle(h))), coherence]
        for f, h in zip(LINES, MODE, strict=True)
    ]


POLAR = "f [Hz], magnitude [um/V], phase [deg], coherence"


def test_magnitude_and_phase_or_both_parts_are_the_same_response(tmp_path: Path) -> None:
    said = 'output = "x"\namplitude = "2 V"\nbias = "40 V"\naverages = 16\nperiod = "0.1 ms"\ninput = "stack"\n'
    found = read_frequency_response(written(tmp_path, POLAR, polar(), said))
    assert found.response == pytest.approx(MODE, rel=1e-9)
    assert (found.si, found.axis, found.amplitude, found.bias) == ("m", "x", 2.0, 40.0)
    assert (found.averages, found.period, found.command_is) == (16, 1e-4, "stack")
    assert found.coherence == pytest.approx(np.full(60, 0.99))
    assert found.measured() == pytest.approx(np.concatenate([MODE.real, MODE.imag]), rel=1e-9)
    rows = [[float(f), float(1e9 * h.real), float(1e9 * h.imag), 2.0] for f, h in zip(LINES, MODE, strict=True)]
    again = read_frequency_response(written(tmp_path, "f [Hz], re [nm/V], im [nm/V], amplitude [V]", rows))
    assert again.response == pytest.approx(MODE, rel=1e-9)
    assert again.coherence is None
    radian = [[f, m, float(np.radians(p)), 100 * c] for f, m, p, c in polar()]
    turned = read_frequency_response(written(tmp_path, "f [Hz], magnitude [um/V], phase [rad], coherence [%]", radian))
    assert turned.response == pytest.approx(MODE, rel=1e-9)


def test_lines_outside_of_a_stated_band_are_left_out(tmp_path: Path) -> None:
    found = read_frequency_response(written(tmp_path, POLAR, polar(), 'band = ["10 Hz", "0.2 kHz"]\n'))
    inside = (LINES >= 10) & (LINES <= 200)
    assert found.frequencies == pytest.approx(LINES[inside])
    assert found.response == pytest.approx(MODE[inside], rel=1e-9)
    (remark,) = found.remarks
    assert remark == f"lines outside of 10 Hz to 200 Hz are left out: {60 - inside.sum()} of 60"


def test_a_line_that_two_bands_of_a_sweep_share_counts_once(tmp_path: Path) -> None:
    found = read_frequency_response(written(tmp_path, POLAR, [*polar()[:8], *polar()[7:]]))
    assert found.frequencies == pytest.approx(LINES) and found.response == pytest.approx(MODE, rel=1e-9)
    assert found.remarks == ("line 11: at the frequency of the line before; left out",)


def test_a_command_that_was_written_scaled_is_read_in_volts_of_the_command(tmp_path: Path) -> None:
    written(tmp_path, POLAR, polar())
    top = 'scale = 20\nbias = "1 V"\n[[run]]\nfile = "sweep.csv"\namplitude = "0.1 V"\nbias = "2 V"\n'
    (tmp_path / "measurements.toml").write_text(top)
    found = read_frequency_response(tmp_path / "sweep.csv")
    assert found.response == pytest.approx(MODE / 20, rel=1e-9)
    assert (found.amplitude, found.bias) == (2.0, 41.0)


def changed(row: int, cell: int, value: float) -> list[list[float]]:
    rows = polar()
    rows[row][cell] = value
    return rows


@pytest.mark.parametrize(
    ("header", "rows", "said", "place", "words"),
    [
        (POLAR, changed(0, 0, 0.0), "", "line 3, column f", "above zero"),
        (POLAR, changed(4, 0, 1.0), "", "line 7, column f", "sort the lines"),
        (POLAR, changed(4, 3, 1.2), "", "line 7, column coherence", "between 0 and 1"),
        (POLAR, changed(4, 1, -1.0), "", "line 7, column magnitude", "turn the phase"),
        (POLAR.replace("um/V", "um"), polar(), "", "header cell 2", "m/V"),
        (POLAR.replace("[deg]", "[Hz]"), polar(), "", "header cell 3", "rad"),
        (POLAR.replace("phase [deg]", "re [um/V]"), polar(), "", "header", "mixes two shapes"),
        (POLAR.replace("phase [deg]", "tilt [deg]"), polar(), "", "header", "there is no response"),
        (POLAR, polar()[:5], "", "", "at least 8"),
        (POLAR.replace("coherence", "amplitude [V]"), changed(4, 3, 1.0), "", "column amplitude", "split it"),
        (POLAR.replace("coherence", "averages"), polar(2.5), "", "averages", "whole number"),
        (POLAR, polar(), "averages = 1\n", "averages", "no coherence"),
        (POLAR, polar(), 'band = ["500 Hz", "1 kHz"]\n', "", "at least 8"),
        (POLAR, polar(), 'band = ["1 kHz", "1 Hz"]\n', "band", "the first must be the lower one"),
        (POLAR, polar(), "decimate = 4\n", "run.decimate = 4", "holds for runs, and sweep.csv is a frequency response"),
    ],
)
def test_what_is_wrong_is_named(
    tmp_path: Path, header: str, rows: list[list[float]], said: str, place: str, words: str
) -> None:
    with pytest.raises(InputError) as refused:
        read_frequency_response(written(tmp_path, header, rows, said))
    assert place in str(refused.value)
    assert words in str(refused.value)


def test_a_run_in_time_has_no_averages(tmp_path: Path) -> None:
    rows = "\n".join(f"{0.001 * k},{k % 7},{0.1 * (k % 7)}" for k in range(40))
    (tmp_path / "steps.csv").write_text(f"t [s],u [V],x [um]\n{rows}\n")
    (tmp_path / "measurements.toml").write_text('[[run]]\nfile = "steps.csv"\naverages = 16\n')
    with pytest.raises(InputError, match=r"run\.averages = 16: holds for a frequency response, and steps\.csv is a"):
        read_recordings([tmp_path])


def test_lines_without_numbers_are_left_out_and_said(tmp_path: Path) -> None:
    found = read_frequency_response(written(tmp_path, POLAR, changed(4, 1, float("nan"))))
    assert len(found.frequencies) == 59
    assert found.remarks == ("line 7: no number in a cell; left out",)


def test_a_folder_holds_both_kinds(tmp_path: Path) -> None:
    written(tmp_path, POLAR, polar())
    rows = "\n".join(f"{0.001 * k},{k % 7},{0.1 * (k % 7)}" for k in range(40))
    (tmp_path / "steps.csv").write_text(f"t [s],u [V],x [um]\n{rows}\n")
    steps, sweep = read_recordings([tmp_path])
    assert isinstance(steps, Run)
    assert isinstance(sweep, FrequencyResponse)
    with pytest.raises(InputError, match="runs in time are needed"):
        read_runs([tmp_path])


def test_an_axis_refuses_what_is_not_its_own() -> None:
    found, axis = FrequencyResponse("sweep", LINES, MODE), AxisModel(118.0, 0.03, 2e-6)
    assert of_axis(found, "x", axis).axis == "x"
    for wrong, words in (
        (replace(found, axis="y"), "is of axis y"),
        (replace(found, si="rad"), "responds in m"),
        (replace(found, response=1e-3 * MODE), "correct the unit"),
    ):
        with pytest.raises(InputError, match=words):
            of_axis(wrong, "x", axis)
    assert "carries 5.00 g" in of_axis(replace(found, payload=5e-3), "x", axis).remarks[0]


def test_one_response_is_judged_by_every_fourth_line_and_a_second_one_by_itself() -> None:
    found = FrequencyResponse("sweep", LINES, MODE)
    seen, kept = split_lines([found])
    assert (seen.name, kept.name, kept.role) == ("sweep:identify", "sweep:validate", "validate")
    assert (int(seen.present.sum()), int(kept.present.sum())) == (45, 15)
    assert not (seen.present & kept.present).any()
    assert np.isnan(kept.measured()).sum() == 90
    again = [found, replace(found, name="again"), replace(found, name="higher", bias=50.0)]
    assert [each.role for each in split_lines(again)] == ["identify", "validate", "identify"]
    narrow = FrequencyResponse("narrow", LINES[20:40], MODE[20:40])  # says nothing of most lines of the other
    assert len(split_lines([found, narrow])) == 4
    stated = [replace(found, role_is_stated=True), replace(found, name="other")]
    assert split_lines(stated) == tuple(stated)
    tested = [replace(found, role="test"), replace(found, name="other")]
    assert split_lines(tested) == tuple(tested)


@pytest.mark.parametrize("averages", [6, 16, 100])
def test_coherence_gives_the_noise_of_both_parts(averages: int) -> None:
    """Means of n noisy measurements of each line, their coherence estimated from the same n; flat noise of the output.

    Of both parts the standard deviation of the mean is that of one measurement over the root of n.
    """
    sigma, rng = 3e-8, np.random.default_rng(0)
    shape = (200, averages, len(LINES))
    noisy = MODE + sigma * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    mean, power = noisy.mean(axis=1), (np.abs(noisy) ** 2).mean(axis=1)
    squares = []
    for response, share in zip(mean, np.abs(mean) ** 2 / power, strict=True):
        noise = line_noise(FrequencyResponse("sweep", LINES, response, coherence=share, averages=averages))
        assert noise.known
        squares.append(np.mean(np.abs(response - MODE) ** 2 / (2 * noise.sigma**2)))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.05)


def test_without_coherence_the_noise_is_guessed_from_neighbours() -> None:
    """Within a third where the response is smooth; more beside a resonance, which bends."""
    rng, f = np.random.default_rng(1), np.geomspace(1.0, 40.0, 80)
    smooth = 2e-6 / (1 - (f / 118.0) ** 2 + 2j * 0.03 * f / 118.0)
    noisy = smooth + 1e-8 * (rng.standard_normal(80) + 1j * rng.standard_normal(80))
    noise = line_noise(FrequencyResponse("sweep", f, noisy))
    assert not noise.known
    assert np.median(noise.sigma) == pytest.approx(1e-8, rel=0.33)
    coloured = replace(FrequencyResponse("sweep", f, noisy), coherence=np.full(80, 0.9999))
    assert not line_noise(coloured).known
    assert np.median(line_noise(coloured).sigma) == pytest.approx(1e-8, rel=0.33)


def test_of_a_guess_quiet_lines_count_no_more_than_the_highest_peak() -> None:
    """A mode that scatters by 1 % from line to line, and is measured to 1e-4 far below it, as by a stepped sine."""
    f = np.geomspace(1.0, 400.0, 300)
    mode = 2e-6 / (1 - (f / 118.0) ** 2 + 2j * 0.03 * f / 118.0)
    scatter = np.where(f < 30, 1e-4, 1e-2) * np.random.default_rng(3).standard_normal((2, 300)) / np.sqrt(2)
    noise = line_noise(FrequencyResponse("sweep", f, mode * (1 + scatter[0] + 1j * scatter[1])))
    share = noise.sigma / np.abs(mode)
    about_peak = np.median(share[np.abs(f / 118 - 1) < 0.03])
    assert share.min() == pytest.approx(about_peak, rel=0.1)
    # A tenth of a bandwidth from line to line bends a little: the cubic through neighbours leaves as much as the noise.
    assert about_peak == pytest.approx(1e-2 / np.sqrt(2), rel=1.0)
