"""Tables as programs of many makers and countries write them, imported without a map; and what is asked."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexdesign as fd
from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.measurements import importing
from flexdesign.measurements.importing import header_cells, roles
from flexdesign.measurements.importing.delimited import Dialect
from flexdesign.measurements.importing.guessing import guess
from flexdesign.measurements.importing.readers import read_contents
from flexdesign.measurements.recordings import FrequencyResponse, Run, read_recordings, read_runs

RATE, N = 2000.0, 120
T = np.arange(N) / RATE
U = 40 + 30 * np.sin(2 * np.pi * 55 * T)
X = 3 * U + 0.01 * np.cos(731 * T)
F = np.linspace(10.0, 400.0, 60)
H = 2.0 / (1 - (F / 118.0) ** 2 + 2j * 0.03 * F / 118.0)


def rows(*columns: Any, separator: str = ",", decimal: str = ".", digits: int = 10) -> str:
    lines = [separator.join(f"{v:.{digits}g}".replace(".", decimal) for v in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


#: Header lines; factors of t [s], u [V] and x [um] as they are written; separator and decimal.
TABLES: dict[str, tuple[str, tuple[float, float, float], str, str]] = {
    "brackets": ("t [s],u [V],x [um]\n", (1, 1, 1), ",", "."),
    "suffixes": ("time_ms,command_V,position_nm\n", (1e3, 1, 1e3), ",", "."),
    "parentheses": ("Time (s),Drive Voltage (mV),Displacement (mm)\n", (1, 1e3, 1e-3), ",", "."),
    "German": ("Zeit in ms;Spannung in V;Weg in µm\n", (1e3, 1, 1), ";", ","),
    "German words": ("Messzeit;Stellgröße;Wegsensor\nSekunden;Volt;Mikrometer\n", (1, 1, 1), ";", ","),
    "German standard": ("Zeit/s\tPiezospannung/V\tAuslenkung/µm\n", (1, 1, 1), "\t", ","),
    "French": ("Temps (s);Consigne (V);Déplacement (µm)\n", (1, 1, 1), ";", ","),
    "Italian": ("tempo [s];ingresso [V];spostamento [mm]\n", (1, 1, 1e-3), ";", ","),
    "Spanish": ("Tiempo (ms)\tTensión (V)\tPosición (um)\n", (1e3, 1, 1), "\t", "."),
    "Japanese": ("時間 (s),電圧 (V),変位 (um)\n", (1, 1, 1), ",", "."),
    "three lines": ("Bench 3\nTime,Cmd,Sensor\n[ms],[V],[um]\n", (1e3, 1, 1), ",", "."),
    "five lines": ("Logger 4.2\nOperator;K\n\nKanal;1;2\nZeit;Eingang;Ausgang\n(s);(V);(µm)\n", (1, 1, 1), ";", ","),
    "capitals": ("TIME (S),VOLTAGE (V),POSITION (UM)\n", (1, 1, 1), ",", "."),
    "a comment": ("# run 7\n# t[s]  u[V]  x[um]\n", (1, 1, 1), "  ", "."),
    "names apart": ("Time (s), Command (V), Position (um)\n", (1, 1, 1), " ", "."),
    "camels": ("timeMs,piezoVoltage_V,sensorReading_um\n", (1e3, 1, 1), ",", "."),
    "quoted": ('"Time, s","Input, V","Output, um"\n', (1, 1, 1), ",", "."),
    "a data acquisition card": ("Time (s)\tDev1/ao0 (V)\tInterferometer (nm)\n", (1, 1, 1e3), "\t", "."),
    "garbled": ("t (s);u (V);x (Âµm)\n", (1, 1, 1), ";", "."),
    "pipes": ("time [s]|drive [V]|pos [um]\n", (1, 1, 1), "|", "."),
    "an Arduino": ("millis,dac_V,laser_mm\n", (1e3, 1, 1e-3), ",", "."),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables_are_imported_without_a_map(name: str, tmp_path: Path, command_line: Callable[..., Any]) -> None:
    header, factors, separator, decimal = TABLES[name]
    numbers = rows(factors[0] * T, factors[1] * U, factors[2] * X, separator=separator, decimal=decimal)
    (tmp_path / "log.csv").write_text(header + numbers, encoding="utf-8")
    ended = command_line("import", "log.csv", "-o", "out")
    assert (ended.code, ended.stderr) == (0, ""), ended.stderr
    (run,) = read_runs([tmp_path / "out"])
    assert run.command() == pytest.approx(U, rel=1e-8)
    assert run.measured() == pytest.approx(1e-6 * X, rel=1e-8)
    assert run.period == pytest.approx(1 / RATE, rel=1e-6)
    assert 'u = "' in ended.stdout and 'x = "' in ended.stdout


def imported(folder: Path, command_line: Callable[..., Any], text: str, name: str = "log.csv") -> Any:
    (folder / name).write_text(text, encoding="utf-8")
    ended = command_line("import", name, "-o", "out")
    assert (ended.code, ended.stderr) == (0, ""), ended.stderr
    return read_recordings([folder / "out"])[0]


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("t [s],ux [V],uy [V],x [um],y [um]", ["ux", "uy", "x", "y"]),
        ("Time [s],Drive 1 [V],Drive 2 [V],Sensor 1 [um],Sensor 2 [um]", ["ux", "uy", "x", "y"]),
        ("time_s,voltage_V,position_um,setpoint_um,current_mA", ["u", "x", "r", "i"]),
        ("Zeit [s],Sollwert [V],HV-Monitor [V],Istposition [µm],Temperatur [°C]", ["u", "v", "x", "T"]),
        ("t [s],command [V],x [um],velocity [mm/s],force [N]", ["u", "x", None, "f"]),
        ("t [s],Sensor X [um],Sensor Y [um],Command X [V],Command Y [V]", ["x", "y", "ux", "uy"]),
        ("Sample,Time [s],Command [V],Position [um],Status", [None, "t", "u", "x", None]),
        ("Time [s],DAC out [V],HV monitor [V],Capacitive sensor [nm]", ["t", "u", "v", "x"]),
        ("Time [s],AO 0 output [V],ADC in [V]", ["t", "u", "x"]),
        ("Time [s],Drive [V],Sensor monitor [V],Sensor output [V],Laser [um]", ["t", "u", "v", None, "x"]),
        ("t [s],drive [V],position z [um],sensor [V],x [1]", ["u", "z", None, None]),
        ("Tempo [s],Controle_u [V],Saida_y [um]", ["t", "u", "x"]),
        ("t [s],drive [V],Sensor Y [um]", ["u", "y"]),
    ],
)  # fmt: skip
def test_further_columns(
    header: str, columns: Sequence[str | None], tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    wanted = columns if "t" in columns else ["t", *columns]
    values = np.array([[k + j + (7 * k * (j + 2)) % 11 for j in range(len(wanted))] for k in range(N)], dtype=float)
    values[:, wanted.index("t")] = T
    run = imported(tmp_path, command_line, header + "\n" + rows(*values.T))
    assert isinstance(run, Run)
    assert {*run.columns} == {name for name in wanted if name not in (None, "t")}
    for k, (name, cell) in enumerate(zip(wanted, header.split(","), strict=True)):
        if name and name not in ("t", "T"):
            factor = units.factor(header_cells.split_unit(cell)[1], run.si[name])
            assert run.columns[name] == pytest.approx(factor * values[:, k], rel=1e-9)


def refused(folder: Path, command_line: Callable[..., Any], text: str) -> str:
    """Return what is said of a file that cannot be imported, of which nothing stays."""
    (folder / "log.csv").write_text(text, encoding="utf-8")
    ended = command_line("import", "log.csv", "-o", "all/out")
    assert ended.code == 2 and not (folder / "all").exists()
    return str(ended.stderr)


def test_a_refused_recording_is_named_by_its_own_file_and_line(
    tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    """Lines are counted as an editor shows them, with those above the header and empty ones."""
    time = T.copy()
    time[70:] -= time[70]
    text = "Bench 3\n\nTime [s],Command [V],Position [um]\n" + rows(time, U, X)
    said = refused(tmp_path, command_line, text)
    assert said.startswith('flexdesign: log.csv: line 74, column "Time" = 0 s: is not later than the row before')
    assert text.split("\n")[74 - 1].startswith("0,")
    still = "Time [s],Command [V],Position [um]\n" + rows(T, U, 0 * X)
    assert refused(tmp_path, command_line, still).startswith('flexdesign: log.csv: column "Position": reads 0 m in')


def test_lines_of_a_refused_recording_in_several_parts(tmp_path: Path) -> None:
    """The second part of a record with a gap; a text with lines that are skipped; an archive, which has no lines."""
    u = U.copy()
    u[90:100] = np.nan
    time = np.concatenate([T[:60], T[60:] + 0.5])
    (tmp_path / "log.csv").write_text("skipped\nt [s],u [V],x [um]\n" + rows(time, u, X))
    columns = "".join(f'[run.columns.{c}]\nvariable = "{c}"\n' for c in "tux")
    (tmp_path / "map.toml").write_text(f"[text]\nskip = 1\n[[run]]\n{columns}")
    with pytest.raises(InputError, match=r'log\.csv: line 93, column "u": is missing from .*, 10 samples'):
        importing.bring_in([tmp_path / "log.csv"], tmp_path / "map.toml", tmp_path / "out")
    units_of = {"t": "s", "u": "V", "x": "um"}
    columns = "".join(f'[run.columns.{c}]\nvariable = "{c}"\nunit = "{unit}"\n' for c, unit in units_of.items())
    (tmp_path / "map.toml").write_text(f"[[run]]\n{columns}")
    np.savez(tmp_path / "log.npz", t=np.concatenate([T[:50], T[:70]]), u=U, x=X)
    with pytest.raises(InputError, match=r'log\.npz: sample 51, column "t" = 0 s: is not later'):
        importing.bring_in([tmp_path / "log.npz"], tmp_path / "map.toml", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_single_row_is_no_recording(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    said = refused(tmp_path, command_line, "Time [s],Command [V],Position [um]\n0,0,0\n")
    assert "log.csv: has one number of each variable; a recording has at least 10 rows" in said


def test_rounded_times_ask_for_the_rate(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    text = "Time [s],Command [V],Position [um]\n" + rows(np.round(T, 2), U, X)
    said = refused(tmp_path, command_line, text)
    assert 'line 3, column "Time"' in said and "the time is rounded" in said and "in the map: rate = " in said
    assert float(said.partition('rate = "')[2].partition(" Hz")[0]) == pytest.approx(RATE, rel=0.1)


def test_times_of_day_and_words_beside_numbers(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """Midnight passes; a column of words is none."""
    said = []
    for k in range(N):
        moment = 86399.5 + k / 100
        clock = moment % 86400
        hour, minute, second = int(clock // 3600), int(clock % 3600 // 60), clock % 60
        day = 2 + int(moment // 86400)
        said.append(f"2024-05-{day:02d} {hour:02d}:{minute:02d}:{second:06.3f};OK;{U[k]:.9g};{X[k]:.9g}\n")
    run = imported(tmp_path, command_line, "Timestamp;State;Drive [V];Position [um]\n" + "".join(said))
    assert run.time == pytest.approx(np.arange(N) / 100, abs=1e-6)
    assert run.command() == pytest.approx(U, rel=1e-8)


def test_a_clock_that_began_in_1970_keeps_its_steps(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    lines = "".join(f"{1714644000 + t:.6f},{u:.9g},{x:.9g}\n" for t, u, x in zip(T, U, X, strict=True))
    run = imported(tmp_path, command_line, "time [s],command [V],position [um]\n" + lines)
    assert run.period == pytest.approx(1 / RATE, rel=1e-4)
    assert run.time[0] == 0


@pytest.mark.parametrize(
    "signals",
    [
        [("Sensor", "um", "Model Root/ADC_C5", X), ("Command", "V", "Model Root/DAC_C1", U)],
        [("DAC", "V", "Model Root/DS1104DAC_C1", U), ("ADC", "um", "Model Root/DS1104ADC_C5", X)],
    ],
)
def test_signals_of_control_desk(
    signals: Sequence[tuple[Any, ...]], tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    """dSPACE writes one structure named as the file: X.Data is the time, the array Y holds signals with names."""
    from scipy.io import savemat

    fields = [(name, object) for name in ("Name", "Unit", "Path", "Data", "XIndex")]
    y = np.array([[(name, unit, path, values, 1) for name, unit, path, values in signals]], dtype=fields)
    for stem in ("run_1", "run_2"):
        savemat(tmp_path / f"{stem}.mat", {stem: {"X": {"Data": T, "Type": 4}, "Y": y}})
    ended = command_line("import", "run_1.mat", "run_2.mat", "-o", "out")
    assert (ended.code, ended.stderr) == (0, ""), ended.stderr
    runs = read_runs([tmp_path / "out"])
    assert [run.name for run in runs] == ["run_1", "run_2"]
    for run in runs:
        assert run.command() == pytest.approx(U, rel=1e-8)
        assert run.measured() == pytest.approx(1e-6 * X, rel=1e-8)
        assert run.period == pytest.approx(1 / RATE, rel=1e-6)


def test_structure_arrays_and_cells_are_named_as_in_matlab(tmp_path: Path) -> None:
    from scipy.io import savemat

    signals = np.array([[(U,), (X,)]], dtype=[("values", object)])
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = T, "a note"
    savemat(tmp_path / "scope.mat", {"out": {"signals": signals}, "cells": cells})
    found = read_contents([tmp_path / "scope.mat"]).variables
    assert list(found) == ["out.signals(1).values", "out.signals(2).values", "cells{1}"]
    assert np.ravel(found["out.signals(2).values"].values()) == pytest.approx(X)


def test_structures_and_cells_of_matlab_73(tmp_path: Path) -> None:
    """As MATLAB writes them: fields of a structure array and cells are references, texts are numbers of letters."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "scope.mat"
    with h5py.File(path, "w", userblock_size=512) as file:

        def kept(name: str, values: Any, kind: str) -> Any:
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
            return file[name].ref

        def letters(name: str, text: str) -> Any:
            return kept(name, np.array([[ord(letter)] for letter in text], dtype=np.uint16), "char")

        numbers = [kept(f"#refs#/{k}", values[:, None], "double") for k, values in enumerate((U, X))]
        texts = [letters(f"#refs#/{name}", name) for name in ("Command", "Sensor", "V", "um")]
        signals = file.create_group("out/Y")
        signals.attrs["MATLAB_class"] = np.bytes_("struct")
        for field, references in (("Data", numbers), ("Name", texts[:2]), ("Unit", texts[2:])):
            signals.create_dataset(field, data=np.array([references], dtype=h5py.ref_dtype))
        letters("cells_note", "warm")
        cells = file.create_dataset("cells", data=np.array([[numbers[1]], [texts[0]]], dtype=h5py.ref_dtype))
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        kept("series", np.arange(6, dtype=np.uint32), "timeseries")
        file["series"].attrs["MATLAB_object_decode"] = np.int32(3)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    found = read_contents([path]).variables
    assert list(found) == ["cells{1}", "out.Y(1).Data", "out.Y(2).Data"]
    second = found["out.Y(2).Data"]
    assert (second.unit, second.label, second.shape) == ("um", "Sensor", (1, len(X)))
    assert np.ravel(second.values()) == pytest.approx(X)
    assert np.ravel(found["cells{1}"].values()) == pytest.approx(X)


def test_one_of_several_tables_in_a_file_is_chosen(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """As analysers of ferroelectrics write their measurements, one below the other."""
    numbers = rows(T, U, X, separator="\t")
    first = "Table 1\nArea [mm2]: 1\nTime [s]\tV+ [V]\tD1 [nm]\n" + numbers
    second = "Table 2\nArea [mm2]: 2\nTime [s]\tCommand [V]\tPosition [um]\n" + numbers
    path = tmp_path / "loops.dat"
    path.write_text(f"Hysteresis\n{first}\n{second}")
    ended = command_line("import", str(path), "-o", str(tmp_path / "out"))
    assert ended.code == 2
    for words in ("loops.dat", "2 tables", "1: Time [s], V+ [V], D1 [nm]", "2: Time [s], Command [V]", "table = 1"):
        assert words in ended.stderr
    chosen = read_contents([path], Dialect(table=2))
    assert list(chosen.variables) == ["Time", "Command", "Position"]
    assert np.ravel(chosen.variables["Position"].values()) == pytest.approx(X, rel=1e-6)
    with pytest.raises(InputError, match=r"text.table = 3: holds 2 tables"):
        read_contents([path], Dialect(table=3))


def test_a_rate_above_the_table_is_read(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    for said in ("Sample Rate: 2 kHz", "Abtastrate;2000;Hz", "Sampling interval = 0.5 ms", "fs=2000"):
        text = f"{said}\nCommand [V];Position [um]\n" + rows(U, X, separator=";")
        run = imported(tmp_path, command_line, text)
        assert run.period == pytest.approx(1 / RATE, rel=1e-9), said
        for file in (tmp_path / "out").iterdir():
            file.unlink()


# --- Frequency responses

LINES: dict[str, tuple[str, Sequence[Any]]] = {
    "magnitude and phase": ("Frequency (Hz),Magnitude (um/V),Phase (deg),Coherence", ["abs", "deg", "one"]),
    "German": ("Frequenz [Hz],Betrag [µm/V],Phase [°],Kohärenz", ["abs", "deg", "one"]),
    "parts": ("freq_Hz,Real [um/V],Imag [um/V]", ["re", "im"]),
    "degrees by their size": ("f [Hz],gain [nm/V],phase", ["nm", "wide"]),
}


@pytest.mark.parametrize("name", LINES)
def test_frequency_responses(name: str, tmp_path: Path, command_line: Callable[..., Any]) -> None:
    header, wanted = LINES[name]
    made = {
        "abs": np.abs(H), "nm": 1e3 * np.abs(H), "deg": np.angle(H, deg=True), "re": H.real, "im": H.imag,
        "one": np.full(len(F), 0.97), "wide": np.angle(H, deg=True) - 720,
    }  # fmt: skip
    found = imported(tmp_path, command_line, header + "\n" + rows(F, *(made[each] for each in wanted), digits=12))
    assert isinstance(found, FrequencyResponse)
    assert np.abs(1e6 * found.response / H - 1).max() < 1e-7


def test_responses_of_matlab_in_angular_frequency_and_in_decibels(
    tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "sweep.mat", {"G": H, "w": 2 * np.pi * F})
    ended = command_line("import", str(tmp_path / "sweep.mat"))
    assert f"then flexdesign import {tmp_path / 'sweep.mat'} --map map.toml" in ended.stderr
    ended = command_line("import", "sweep.mat")
    assert ended.code == 2 and 'does not say the unit of "G", the response per volt (um/V?)' in ended.stderr
    (tmp_path / "map.toml").write_text(ended.stdout.replace('unit = "?"', 'unit = "um/V"'))
    assert command_line("import", "sweep.mat", "--map", "map.toml", "-o", "G").code == 0
    (tmp_path / "bode.csv").write_text(
        "f_Hz,gain_dB,phase_deg\n" + rows(F, 20 * np.log10(np.abs(H)), np.angle(H, deg=True))
    )
    ended = command_line("import", "bode.csv")
    assert ended.code == 2 and "what 0 dB of" in ended.stderr
    (tmp_path / "map.toml").write_text(ended.stdout.replace("? um/V", "1 um/V"))
    assert command_line("import", "bode.csv", "--map", "map.toml", "-o", "B").code == 0
    for folder in ("G", "B"):
        (found,) = read_recordings([tmp_path / folder])
        assert isinstance(found, FrequencyResponse)
        assert found.frequencies == pytest.approx(F, rel=1e-9)
        assert np.abs(1e6 * found.response / H - 1).max() < 1e-7


def test_variables_of_matlab_whose_names_end_in_a_unit(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """A structure as an analyser's script leaves it: two responses, the frequency in hertz and in radians."""
    from scipy.io import savemat

    frf = {"G_amplifier": 1 / (1 + 1j * F / 900), "G_stage": H, "w_s": 2 * np.pi * F, "freqs_Hz": F}
    savemat(tmp_path / "sweep.mat", {"modelFit": {"frf": frf}})
    ended = command_line("import", "sweep.mat")
    assert ended.code == 2
    assert 'which of "modelFit.frf.G_amplifier" and "modelFit.frf.G_stage" is the response' in ended.stderr
    assert "freqs_Hz" not in ended.stderr  # its unit is in its name
    proposed = tomllib.loads(ended.stdout)["run"][0]["columns"]
    assert proposed["f"] == {"variable": "modelFit.frf.freqs_Hz"}
    chosen = ended.stdout.replace('unit = "?"', 'unit = "um/V"').replace('G_amplifier"  # a', 'G_stage"  # a')
    (tmp_path / "map.toml").write_text(chosen)
    assert command_line("import", "sweep.mat", "--map", "map.toml", "-o", "G").code == 0
    (found,) = read_recordings([tmp_path / "G"])
    assert isinstance(found, FrequencyResponse)
    assert found.frequencies == pytest.approx(F, rel=1e-9)
    assert np.abs(1e6 * found.response / H - 1).max() < 1e-7
    savemat(tmp_path / "run.mat", {"log": {"time_ms": 1e3 * T, "command_V": U, "position_nm": 1e3 * X}})
    assert command_line("import", "run.mat", "-o", "runs").code == 0
    (run,) = read_runs([tmp_path / "runs"])
    assert run.period == pytest.approx(1 / RATE)
    assert run.measured() == pytest.approx(1e-6 * X)


def test_a_log_that_was_stopped_in_its_last_line(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    (tmp_path / "log.csv").write_text("t [s],u [V],x [um]\n" + rows(T, U, X) + "0.06,4")
    ended = command_line("import", "log.csv", "-o", "runs")
    assert ended.code == 0
    assert "log.csv: the last line, '0.06,4', is cut off; left out" in ended.stdout
    (run,) = read_runs([tmp_path / "runs"])
    assert len(run.time) == N


def test_a_log_of_several_channels_one_below_another(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """As the archiver of a control system writes it: name of the channel, day, time of day, value."""
    moments = [f"2020-12-09 15:16:{k / 10:06.3f}" for k in range(100)]
    lines = [f"bench:{'motor' if k % 3 else 'resolver'} {moment} {k / 7:.6f}" for k, moment in enumerate(moments)]
    (tmp_path / "slits.log").write_text("\n".join(lines) + "\n")
    ended = command_line("import", "slits.log")
    assert ended.code == 2
    assert "a column holds the words bench:motor, bench:resolver: if they name channels" in ended.stdout


def test_a_clock_of_another_length_than_the_data(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "log.mat", {"time_s": T[:-1], "u_V": U, "x_um": X})
    ended = command_line("import", "log.mat", "-o", "runs")
    assert ended.code == 2
    assert 'if the clock is even, leave column t out and write its rate = "1 kHz" instead' in ended.stderr


# --- Many files


@pytest.mark.parametrize("unit", ["rad/A", "m/N", "um"])
def test_a_response_per_something_else_than_a_volt_asks_for_its_unit_and_scale(
    unit: str, tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    table = tmp_path / "sweep.csv"
    table_rows = "".join(f"{k},{1 / k},-90\n" for k in range(1, 20))
    table.write_text(f"Frequency (Hz),Magnitude ({unit}),Phase (deg)\n{table_rows}")
    ended = command_line("import", str(table))
    said = f'does not say unit and scale of "Magnitude", the magnitude per volt: the file says {unit}.'
    assert ended.code == 2 and said in ended.stderr
    chart = tmp_path / "map.toml"
    answer = 'unit = "um/V"\nscale = 10  #'
    chart.write_text(ended.stdout[ended.stdout.index("title") :].replace('unit = "?"  #', answer))
    assert command_line("import", str(table), "--map", str(chart), "-o", str(tmp_path / "out")).code == 0
    (response,) = read_recordings([tmp_path / "out"])
    assert isinstance(response, FrequencyResponse)
    assert response.response[0] == pytest.approx(-1e-5j)  # 10 um/V at -90 deg


@pytest.mark.parametrize(
    ("begin", "end"), [("[", "]"), ("data =[", "];"), ("data=[ ...\n", "\n];\n"), ("d = [", ";\n];")]
)
def test_a_matrix_as_in_matlab_is_read(begin: str, end: str, tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """As teaching rigs export their recordings."""
    table = ";\n".join(f"  {k:5d}  {t:.6f}  {u:.9g}  {x:.9g}" for k, (t, u, x) in enumerate(zip(T, U, X, strict=True)))
    head = " Sample   Time (s)   Command (V)   Encoder 1 Pos (um)\n\n"
    (tmp_path / "raw.txt").write_text(f"{head}{begin}{table}{end}\n")
    ended = command_line("import", "raw.txt", "-o", "out")
    assert ended.code == 0, ended.stderr
    (run,) = fd.read_recordings(tmp_path / "out")
    assert run.command() == pytest.approx(U, rel=1e-8) and run.measured() == pytest.approx(1e-6 * X, rel=1e-8)


def test_a_sampling_time_in_a_column_of_the_table_is_read(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """As in the CSV file of the cascaded tanks: a column with one number, and a comma after each row."""
    table = tmp_path / "tanks.csv"
    table_rows = "".join(f"{k % 7},{k % 5},{4 if k == 0 else ''},\n" for k in range(40))
    table.write_text(f'"u","y","Ts",\n{table_rows}')
    ended = command_line("import", str(table))
    assert ended.code == 2 and "the sampling rate" not in ended.stderr and 'rate = "0.25 Hz"' in ended.stdout


def test_the_rate_of_an_oscilloscope_is_read(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """As PicoScope writes MATLAB files: no time, but its start, the interval and the channels."""
    from scipy.io import savemat

    channels = {"A": np.arange(40.0) % 7, "B": np.arange(40.0) % 5}
    savemat(tmp_path / "scope.mat", {"Tstart": -1e-3, "Tinterval": 2e-7, "Length": 40, **channels})
    ended = command_line("import", str(tmp_path / "scope.mat"))
    assert ended.code == 2 and "the sampling rate" not in ended.stderr and 'rate = "5000000 Hz"' in ended.stdout


def test_many_files_of_different_kinds_go_into_one_folder(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    for k in range(3):
        (tmp_path / f"step_{k}.csv").write_text("t [s],u [V],x [um]\n" + rows(T, U, (1 + k) * X))
    (tmp_path / "loop.csv").write_text(
        "Zeit [ms];Spannung [V];Weg [µm]\n" + rows(1e3 * T, U, X, separator=";", decimal=",")
    )
    (tmp_path / "bode.csv").write_text("f [Hz],re [um/V],im [um/V]\n" + rows(F, H.real, H.imag))
    names = ["step_0.csv", "step_1.csv", "step_2.csv", "loop.csv", "bode.csv"]
    ended = command_line("import", *names, "-o", "out")
    assert (ended.code, ended.stderr) == (0, "")
    found = {each.name: each for each in read_recordings([tmp_path / "out"])}
    assert set(found) == {Path(name).stem for name in names}
    for k in range(3):
        run = found[f"step_{k}"]
        assert isinstance(run, Run) and run.measured() == pytest.approx(1e-6 * (1 + k) * X, rel=1e-8)
    assert found["loop"].measured() == pytest.approx(1e-6 * X, rel=1e-8)
    assert isinstance(found["bode"], FrequencyResponse)


def test_runs_of_a_map_for_some_files(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    for name in ("a_1.csv", "b_1.csv"):
        (tmp_path / name).write_text("t [s],u [V],x [um]\n" + rows(T, U, X))
    columns = "".join(f'[run.columns.{c}]\nvariable = "{c}"\n' for c in "tux")
    (tmp_path / "map.toml").write_text(f'per_file = true\n[[run]]\nfiles = ["a_*.csv"]\nkind = "sine"\n{columns}')
    assert command_line("import", "a_1.csv", "--map", "map.toml", "-o", "out").code == 0
    ended = command_line("import", "b_1.csv", "--map", "map.toml", "-o", "b")
    assert ended.code == 2 and "run.files = b_1.csv: no run is for this file" in ended.stderr
    text = (tmp_path / "map.toml").read_text()
    (tmp_path / "map.toml").write_text(text.replace("per_file = true\n", ""))
    ended = command_line("import", "a_1.csv", "--map", "map.toml", "-o", "c")
    assert "run.files: chooses files of those that each make runs of their own: write per_file = true" in ended.stderr


# --- What is asked

QUESTIONS: list[tuple[str, Sequence[str], Sequence[tuple[str, str]]]] = [
    ("time,u,x", ['unit of "time"', 'unit of "u"', 'unit of "x"'], [("t", "s"), ("u", "V"), ("x", "um")]),
    ("t [s],command [V],position", ['unit of "position", the response x (um?)'], [("x", "um")]),
    ("t [s],CH1 [V],CH2 [V]", ['which of "CH1" and "CH2" is the command u', "how many um a volt of it is"], []),
    ("t [s],command [counts],x [um]", ['unit and scale of "command"', "the file says counts"], [("u", "V")]),
    ("t [s],left [um],right [um],u [V]", ['which of "left" and "right" is the response x'], []),
    ("t [s],setpoint [um],position [um]", ["how many volts a commanded um"], []),
    ("t [s],x [um],noise [Pa]", ["which variable is the command u"], []),
    ("u [V],x [um]", ["the sampling rate, as there is no time"], []),
]


@pytest.mark.parametrize(("header", "questions", "answers"), QUESTIONS, ids=[q[0] for q in QUESTIONS])
def test_what_cannot_be_known_is_asked_in_one_message(
    header: str,
    questions: Sequence[str],
    answers: Sequence[tuple[str, str]],
    tmp_path: Path,
    command_line: Callable[..., Any],
) -> None:
    columns = [T, U, X, X + 1][: header.count(",") + 1] if header.startswith("t") else [U, X]
    (tmp_path / "log.csv").write_text(header + "\n" + rows(*columns))
    ended = command_line("import", "log.csv", "-o", "out")
    assert ended.code == 2 and not (tmp_path / "out").exists()
    assert len(ended.stderr.splitlines()) == 1
    assert "Save the map above" in ended.stderr and len(ended.stderr) < 450
    for question in questions:
        assert question in ended.stderr, ended.stderr
    tables = tomllib.loads(ended.stdout)
    assert tables["run"][0]["columns"]
    assert "# Nobody but you knows" in ended.stdout
    if answers and "counts" not in header:
        text = ended.stdout
        for column, unit in answers:
            before, head, after = text.partition(f"[run.columns.{column}]")
            text = before + head + after.replace('unit = "?"', f'unit = "{unit}"', 1)
        (tmp_path / "map.toml").write_text(text)
        ended = command_line("import", "log.csv", "--map", "map.toml", "-o", "out")
        assert (ended.code, ended.stderr) == (0, "")
        (run,) = read_runs([tmp_path / "out"])
        assert run.measured() == pytest.approx(1e-6 * X, rel=1e-8)


def test_a_commanded_position_becomes_volts_once_their_ratio_is_told(
    tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    (tmp_path / "log.csv").write_text("t [s],setpoint [um],position [um]\n" + rows(T, X, 0.9 * X))
    ended = command_line("import", "log.csv")
    assert "? V/um" in ended.stdout
    (tmp_path / "map.toml").write_text(ended.stdout.replace("? V/um", "0.5 V/um"))
    assert command_line("import", "log.csv", "--map", "map.toml", "-o", "out").code == 0
    (run,) = read_runs([tmp_path / "out"])
    assert run.command() == pytest.approx(0.5 * X, rel=1e-8)
    assert run.columns["r"] == pytest.approx(1e-6 * X, rel=1e-8)
    assert run.closed_loop


def test_a_map_with_open_questions_is_refused(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    (tmp_path / "log.csv").write_text("t [s],setpoint [um],position [um]\n" + rows(T, X, 0.9 * X))
    (tmp_path / "map.toml").write_text(command_line("import", "log.csv").stdout)
    ended = command_line("import", "log.csv", "--map", "map.toml", "-o", "out")
    assert ended.code == 2 and "constants.volts_per_length = ? V/um: does not begin with a number" in ended.stderr


def test_a_folder_stands_for_its_files(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    for name in ("b", "a"):
        (tmp_path / "scope").mkdir(exist_ok=True)
        (tmp_path / "scope" / f"{name}.csv").write_text("t [s],command [V],position [um]\n" + rows(T, U, X))
    (tmp_path / "scope" / "notes.toml").write_text("bench = 3\n")
    assert command_line("import", "scope", "-o", "out").code == 0
    assert [run.name for run in fd.read_recordings(tmp_path / "out")] == ["a", "b"]
    again = command_line("import", "out", "-o", "other")
    assert again.code == 2 and "out: has a measurements.toml: it is imported already" in again.stderr
    (tmp_path / "empty").mkdir()
    ended = command_line("import", "empty")
    assert ended.code == 2 and "empty: is a folder without files" in ended.stderr


def test_from_python_the_map_to_complete_is_a_note_of_the_error(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t [s],command [V],position\n" + rows(T, U, X))
    with pytest.raises(fd.InputError, match="Complete this map, save it, and pass it as map_file") as caught:
        fd.import_recordings(tmp_path / "log.csv", tmp_path / "out")
    (text,) = caught.value.__notes__
    (tmp_path / "map.toml").write_text(text.replace('unit = "?"', 'unit = "um"'))
    (run,) = fd.import_recordings([tmp_path / "log.csv"], tmp_path / "out", tmp_path / "map.toml")
    assert run.measured() == pytest.approx(1e-6 * X, rel=1e-8)
    assert (run.measured() == fd.read_recordings(tmp_path / "out")[0].measured()).all()


# --- Words and units


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [
        ("Channel A", "Channel A", ""), ("out_A", "out_A", ""), ("pos_m", "pos", "m"), ("in", "in", ""),
        ("Position (X) [um]", "Position (X)", "um"), ("x (counts)", "x", "counts"), ("Weg [µm] roh", "Weg  roh", "µm"),
        ("gain um/V", "gain", "um/V"), ("Volts", "Volts", "V"), ("t", "t", ""), ("noise [arb]", "noise", "arb"),
        ("Time, s", "Time", "s"), ("temperature_C", "temperature", "degC"), ("U_Piezo_V", "U_Piezo", "V"),
    ],
)  # fmt: skip
def test_header_cells(cell: str, name: str, unit: str) -> None:
    assert header_cells.split_unit(cell) == (name, unit)


def test_numbers_of_channels_are_no_units(tmp_path: Path) -> None:
    """Servos one beside another, as a dashboard exports them: the first is not without a unit of its own."""
    names = [f"{name} ({k})" for k in (1, 2) for name in ("target pos", "pos", "load")]
    (tmp_path / "servos.csv").write_text(f"time [s],{','.join(names)},Coherence (1)\n" + "0,1,2,3,4,5,6,7\n" * 9)
    contents = read_contents([tmp_path / "servos.csv"])
    assert [*contents.variables] == ["time", *names, "Coherence"]
    assert [each.unit for each in contents.variables.values()] == ["s", *[""] * 6, "1"]
    assert roles.role_of("target pos (1)", "").column == "u" and roles.role_of("pos (1)", "").column == "x"


def test_words_are_no_units() -> None:
    """A name of one word is not taken for a unit: no word of the vocabulary but those that are units."""
    known = {word for kind in roles.VOCABULARY.values() for word in kind}
    taken = {word for word in known if header_cells.split_unit(word)[1]}
    assert taken <= {"seconds", "secs", "sec", "millis", "micros", "volt", "volts", "hz", "sekunden", "amps"}


def test_angular_frequencies_are_no_frequencies() -> None:
    """To the register of units a radian is one."""
    assert units.factor("rad/s", "Hz") == pytest.approx(1 / (2 * np.pi), rel=1e-12)
    assert units.factor("rpm", "Hz") == pytest.approx(1 / 60, rel=1e-12)
    assert units.from_text("1 krad/s", "Hz") == pytest.approx(159.15494309, rel=1e-9)
    assert units.factor("kHz", "Hz") == 1000.0


def test_the_output_of_a_controller_is_the_command_next_to_a_target_position(tmp_path: Path) -> None:
    """As the racks of ECP export it; "effort" is French for force."""
    header = "Sample   Time     Commanded Pos   Encoder 1 Pos   Control Effort"
    lines = [f"{k} {0.009 * k:.3f} {k} {2 * k % 7} {0.5 * (k % 3)}" for k in range(40)]
    (tmp_path / "open.txt").write_text(f" {header}\n\n[ " + ";\n".join(lines) + "];\n")
    chosen = {column.name: column.variable for column in guess(read_contents([tmp_path / "open.txt"])).columns}
    assert chosen == {"t": "Time", "u": "Control Effort", "x": "Encoder 1 Pos"}
    assert roles.role_of("Commanded Pos", "").column == "u"  # where there is no other
    assert [roles.role_of(name, "").column for name in ("inp_1", "Controlled position")] == ["u", "x"]
