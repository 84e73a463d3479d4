"""Recordings of other programs: written by the libraries themselves, read back number by number."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.core import unit_tables
from flexdesign.core.errors import InputError
from flexdesign.measurements import importing
from flexdesign.measurements.importing import delimited
from flexdesign.measurements.recordings import read_measurements, read_runs

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
recordings = pytest.mark.skipif(not SHARED.is_dir(), reason=f"the recordings of others are not at {SHARED}")

RATE = 2000.0
N = 400
T = np.arange(N) / RATE
U = 10 * np.sin(2 * np.pi * 5 * T) + 0.1 * np.sin(977 * T)
#: Two channels [um].
X = np.stack([3 * U + 0.01 * np.cos(731 * T), -2 * U + 0.01 * np.cos(613 * T)], axis=1)


def mapped(folder: Path, text: str, *files: Path, name: str = "out") -> importing.Imported:
    path = folder / "map.toml"
    path.write_text(text)
    return importing.bring_in(files, path, folder / name)


def two_columns(u: str, x: str, top: str = f'rate = "{RATE} Hz"', more: str = "") -> str:
    return f"""{top}
[[run]]
name = "sine"
[run.columns.u]
{u}
[run.columns.x]
{x}
{more}
"""


def check(found: importing.Imported, u: Any = U, x: Any = X[:, 0], rel: float = 1e-11) -> None:
    (run,) = found.runs
    assert run.name == "sine" and run.period == pytest.approx(1 / RATE, rel=1e-9)
    assert run.command() == pytest.approx(u, rel=rel, abs=1e-10)
    assert run.measured() == pytest.approx(1e-6 * x, rel=rel, abs=1e-16)
    (again,) = read_runs([found.folder])
    assert (again.measured() == run.measured()).all()


def refusal(act: Callable[[], object]) -> str:
    with pytest.raises(InputError) as caught:
        act()
    return str(caught.value)


# --- Every format


def matlab(path: Path) -> Path:
    from scipy.io import savemat

    rig = {"u": U[None, :], "y": X, "info": {"name": "bench", "gain": 2.5}}
    savemat(path, {"rig": rig, "fs": RATE, "note": "warm", "cells": np.array([1, "a"], dtype=object)})
    return path


def test_matlab_5(tmp_path: Path) -> None:
    path = matlab(tmp_path / "rig.mat")
    seen = importing.read_contents([path])
    shapes = {name: variable.shape for name, variable in seen.variables.items()}
    arrays = {"rig.u": (1, N), "rig.y": (N, 2)}
    assert shapes == {**arrays, "rig.info.gain": (1, 1), "fs": (1, 1), "cells{1}": (1, 1)}
    x = 'variable = "rig.y"\nunit = "um"\nchannel = 1'
    top = f'rate = "{RATE} Hz"\naxes = ["sample", "channel"]'
    check(mapped(tmp_path, two_columns('variable = "rig.u"\nunit = "V"', x, top), path))


def test_matlab_73(tmp_path: Path) -> None:
    """As MATLAB writes it: a user block before the HDF5 file, arrays by columns, text as numbers."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "rig.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("rig/u", data=U[:, None]).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("rig/y", data=X.T).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("note", data=np.frombuffer(b"w\0a\0", np.uint16)).attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("#refs#/a", data=T)
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    with path.open("r+b") as raw:
        raw.write(header)
    seen = importing.read_contents([path])
    assert {name: v.shape for name, v in seen.variables.items()} == {"rig.u": (1, N), "rig.y": (N, 2)}
    x = 'variable = "rig.y"\nunit = "um"\nchannel = 2\nscale = -1'
    top = f'rate = "{RATE} Hz"\naxes = ["sample", "channel"]'
    check(mapped(tmp_path, two_columns('variable = "rig.u"\nunit = "V"', x, top), path), x=-X[:, 1])


def test_hdf5(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "rig.h5"
    table = np.zeros(N, dtype=[("time", "f8"), ("tag", "S3"), ("u", "f4")])
    table["time"], table["u"] = 1e3 * T, U
    with h5py.File(path, "w") as file:
        group = file.create_group("bench")
        group.create_dataset("pos", data=1e3 * X[:, 0]).attrs["units"] = "nm"
        file.create_dataset("log", data=table)
        file.create_dataset("text", data="warm")
        file.create_dataset("none", data=h5py.Empty("f8"))
    seen = importing.read_contents([path])
    assert set(seen.variables) == {"bench/pos", "log/time", "log/u"}
    assert seen.variables["bench/pos"].unit == "nm"
    time = '[run.columns.t]\nvariable = "log/time"\nunit = "ms"'
    text = two_columns('variable = "log/u"\nunit = "V"', 'variable = "bench/pos"', "", time)
    check(mapped(tmp_path, text, path), rel=1e-7)  # u was single precision


def test_tdms(tmp_path: Path) -> None:
    tdms = pytest.importorskip("nptdms")
    path = tmp_path / "rig.tdms"
    waveform = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0}
    with tdms.TdmsWriter(path) as writer:
        for half in (slice(0, 150), slice(150, N)):  # channels come in segments
            writer.write_segment(
                [
                    tdms.ChannelObject("bench", "DAC", U[half], properties={**waveform, "unit_string": "V"}),
                    tdms.ChannelObject("bench", "pos", X[half, 0], properties={**waveform, "unit_string": "um"}),
                    tdms.ChannelObject("notes", "who", ["a", "b"]),
                ]
            )
    seen = importing.read_contents([path])
    assert {name: (v.unit, v.step) for name, v in seen.variables.items()} == {
        "bench/DAC": ("V", 1 / RATE),
        "bench/pos": ("um", 1 / RATE),
    }
    check(mapped(tmp_path, two_columns('variable = "bench/DAC"', 'variable = "bench/pos"', ""), path))


def test_universal_file(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    path = tmp_path / "rig.uff"
    common = {"type": 58, "binary": 0, "rsp_node": 4, "rsp_dir": 3, "ref_node": 0, "ref_dir": 0, "id2": "", "id3": ""}
    common |= {
        "id4": "",
        "id5": "",
        "abscissa_spacing": 1,
        "abscissa_min": 0,
        "abscissa_inc": 1 / RATE,
        "z_axis_value": 0,
    }
    common |= {
        "abscissa_spec_data_type": 17,
        "ver_num": 1,
        "load_case_id": 0,
        "rsp_ent_name": "NONE",
        "ref_ent_name": "NONE",
    }
    common |= {"orddenom_spec_data_type": 0, "ordinate_spec_data_type": 8}
    sets = [
        {
            **common,
            "func_type": 1,
            "id1": "drive",
            "x": T,
            "data": U,
            "ord_data_type": 4,
            "ordinate_axis_units_lab": "V",
        },
        {
            **common,
            "func_type": 4,
            "id1": "FRF",
            "x": T,
            "data": U + 1j,
            "ord_data_type": 6,
            "ordinate_axis_units_lab": "um",
            "orddenom_axis_units_lab": "V",
        },
        {**common, "func_type": 2, "id1": "spectrum", "x": T, "data": U, "ord_data_type": 4},
        {**common, "func_type": 1, "id1": "table", "x": T, "data": X[:, 0], "ord_data_type": 4},
    ]
    file = pyuff.UFF(str(path))
    for each in sets:
        file.write_sets(each, mode="add")
    seen = importing.read_contents([path])
    assert list(seen.variables) == ["set1", "set2", "set2.frequency", "set4"]
    assert seen.variables["set2"].is_complex and seen.variables["set2"].unit == "um/(V)"
    assert seen.variables["set2"].values() == pytest.approx(U + 1j, abs=1e-4)
    assert seen.variables["set2.frequency"].values() == pytest.approx(T, rel=1e-6)
    assert seen.variables["set1"].unit == "V" and seen.variables["set1"].step == pytest.approx(1 / RATE)
    assert seen.variables["set4"].note.startswith("table; node 4, direction 3")
    # Written with six digits of the largest value of a set.
    text = two_columns('variable = "set1"', 'variable = "set4"\nunit = "um"', "")
    (run,) = mapped(tmp_path, text, path).runs
    assert run.command() == pytest.approx(U, abs=1e-5 * 10) and run.measured() == pytest.approx(
        1e-6 * X[:, 0], abs=3e-10
    )


def test_numpy_arrays_with_realisations_and_periods(tmp_path: Path) -> None:
    """Samples, channels, realisations, periods, as benchmarks have them; each realisation a run, periods in a row."""
    draw = np.random.default_rng(4)
    u, y = draw.normal(size=(100, 1, 3, 2)), draw.normal(size=(100, 2, 3, 2))
    np.save(tmp_path / "u.npy", u)
    np.savez(tmp_path / "rest.npz", y=y, label=np.array(["a"]))
    axes = 'rate = "1 kHz"\naxes = ["sample", "channel", "realisation", "period"]'
    text = two_columns(
        'variable = "u"\nunit = "V"', 'variable = "y"\nunit = "um"\nchannel = 2\nscale = 2\noffset = 1', axes
    )
    found = mapped(tmp_path, text, tmp_path / "u.npy", tmp_path / "rest.npz")
    assert [run.name for run in found.runs] == ["sine_1", "sine_2", "sine_3"]
    for k, run in enumerate(found.runs):
        assert run.command() == pytest.approx(np.concatenate([u[:, 0, k, 0], u[:, 0, k, 1]]), rel=1e-11)
        assert 1e6 * run.measured() == pytest.approx(1 + 2 * np.concatenate([y[:, 1, k, 0], y[:, 1, k, 1]]), rel=1e-10)
        assert run.time[100] == pytest.approx(0.1)


def test_variables_of_one_name_are_told_apart_by_their_files(tmp_path: Path) -> None:
    for name in ("warm", "cold"):
        np.savez(tmp_path / f"{name}.npz", u=U, x=X[:, 0])
    seen = importing.read_contents([tmp_path / "warm.npz", tmp_path / "cold.npz"])
    assert set(seen.variables) == {"warm:u", "warm:x", "cold:u", "cold:x"}


# --- Tables in text


def table(separator: str, decimal: str, digits: int = 9) -> str:
    rows = zip(U, X[:, 0], strict=True)
    return "\n".join(separator.join(f"{a:.{digits}f}".replace(".", decimal) for a in row) for row in rows) + "\n"


TEXTS: dict[str, bytes] = {
    "decimal commas": ("Voltage [V];Position [um]\n" + table(";", ",")).encode(),
    "tabs": ("Voltage (V)\tPosition (um)\n" + table("\t", ".")).encode(),
    "tabs and decimal commas, UTF-16": ("Voltage\tPosition\nV\tum\n" + table("\t", ",")).encode("utf-16"),
    "lines above": ("Bench 3; warm\nOperator: K\n\nVoltage [V],Position [um]\n" + table(",", ".")).encode(),
    "a line of units": ("Voltage,Position\n[V],[um]\n" + table(",", ".")).encode(),
    "micro sign in Windows' code": ("Voltage [V];Position [µm]\n" + table(";", ",")).encode("cp1252"),
    "spaces": ("# Voltage[V]  Position[um]\n" + table("   ", ".")).encode(),
    "separators at the ends": ("Voltage [V];Position [um];\n" + table(";", ",").replace("\n", ";\n")).encode(),
    "quotes and carriage returns": ('"Voltage [V]","Position [um]"\n' + table(",", ".")).replace("\n", "\r\n").encode(),
}


@pytest.mark.parametrize("data", TEXTS.values(), ids=TEXTS)
def test_tables_in_text(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_bytes(data)
    check(mapped(tmp_path, two_columns('variable = "Voltage"', 'variable = "Position"'), path), rel=1e-7)


def test_what_cannot_be_told_is_said_in_the_map(tmp_path: Path) -> None:
    """Numbers in the lines above, pipes, and no header."""
    path = tmp_path / "log.dat"
    path.write_text("1|2\n3|4\n" + table("|", ","))
    top = f'rate = "{RATE} Hz"\n[text]\nseparator = "|"\ndecimal = ","\nskip = 2'
    check(
        mapped(
            tmp_path, two_columns('variable = "column 1"\nunit = "V"', 'variable = "column 2"\nunit = "um"', top), path
        ),
        rel=1e-7,
    )


def test_gaps_stay_gaps(tmp_path: Path) -> None:
    lines = ["u [V];x [um]", *table(";", ",").splitlines()]
    lines[8] = lines[8].split(";")[0] + ";"
    lines[9] = lines[9].split(";")[0] + ";OVER"
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    (run,) = mapped(tmp_path, two_columns('variable = "u"', 'variable = "x"'), path).runs
    assert np.flatnonzero(np.isnan(run.measured())).tolist() == [7, 8]
    assert run.remarks == ("x is missing in lines 10 to 11",)


# --- What is passed on


def test_what_is_known_is_passed_on(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", u=U, x=X[:, 0])
    text = 'title = "Bench \\"3\\", µ"\ncommand_is = "monitor"\nscale = 20\nlimits = ["0 V", "150 V"]\n'
    text += f'rate = "{RATE} Hz"\n[sensors.x]\nnoise = "2 nm"\ndirection = [0, 0, 1]\n'
    text += '[[run]]\nname = "sine"\nkind = "sine"\nrole = "validate"\nclosed_loop = true\n'
    text += 'conditions = { payload = "5 g" }\n[run.columns.u]\nvariable = "u"\nunit = "V"\n'
    text += '[run.columns.x]\nvariable = "x"\nunit = "um"\n'
    found = mapped(tmp_path, text, tmp_path / "log.npz")
    (run,) = found.runs
    assert (run.kind, run.role, run.closed_loop, run.command_is) == ("sine", "validate", True, "monitor")
    assert run.payload == pytest.approx(5e-3) and run.limits == (0.0, 150.0)
    assert run.sensors["x"].noise == pytest.approx(2e-9) and run.sensors["x"].direction == (0.0, 0.0, 1.0)
    assert run.command() == pytest.approx(20 * U, rel=1e-11, abs=1e-10)
    assert read_measurements(found.folder / "measurements.toml").title == 'Bench "3", µ'
    assert sorted(file.name for file in found.folder.iterdir()) == ["measurements.toml", "sine.csv"]


# --- Files of a scope

SCOPES: dict[str, str] = {
    "three header lines": "Source;CH1;CH2\nTime;Channel A;Channel B\nsecond;Volt;mV\n\n",
    "units and then settings": "Time;Channel A;Channel B\n(s);(V);(mV)\nSample;DC;DC\n",
    "four header lines": "Probe;x10;x1\nSource;CH1;CH2\nTime;Channel A;Channel B\ns;V;mV\n",
}


def scope(header: str, gain: float = 1.0) -> str:
    rows = zip(T, U, gain * X[:, 0], strict=True)
    return header + "".join(";".join(f"{a:.9f}".replace(".", ",") for a in row) + "\n" for row in rows)


@pytest.mark.parametrize("header", SCOPES.values(), ids=SCOPES)
def test_header_lines_of_any_number_are_read(header: str, tmp_path: Path) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(scope(header))
    seen = importing.read_contents([path]).variables
    assert list(seen) == ["Time", "Channel A", "Channel B"]
    assert [unit_tables.si_of(variable.unit) for variable in seen.values()] == ["s", "V", "V"]
    assert seen["Channel B"].unit == "mV"
    text = importing.propose([path])
    for guess in ('[run.columns.t]\nvariable = "Time"', '[run.columns.u]\nvariable = "Channel A"'):
        assert f"{guess}  # a guess" in text
    assert '[run.columns.x]\nvariable = "Channel B"  # a guess\n# if that is the voltage of a sensor' in text


def test_commas_between_quotation_marks_are_decimal(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f'"{a:.9f}","{b:.9f}"\n'.replace(".", ",") for a, b in zip(U, X[:, 0], strict=True))
    path.write_text('"Voltage","Position"\n"V","um"\n' + rows)
    check(mapped(tmp_path, two_columns('variable = "Voltage"', 'variable = "Position"'), path), rel=1e-7)


def test_decimal_commas_between_spaces_are_no_separators(tmp_path: Path) -> None:
    """A logger that writes clock, way and force without a header, its first line with points; blank lines between."""
    lines = [f"15:03:{k // 10:02d} {0.07 * k:.2f} {-4.0 + 23.5 * k:.1f}".replace(".", ",") for k in range(40)]
    lines[0] = "15:03:00 0.00 -4.0"
    (tmp_path / "bend.txt").write_text("\n\n".join(lines))
    found, _, _ = delimited.read(tmp_path / "bend.txt")
    assert found["column 1"].unit == "s" and found["column 1"].values()[[0, -1]].tolist() == [0.0, 3.0]
    assert found["column 2"].values() == pytest.approx(np.round(0.07 * np.arange(40), 2), abs=1e-12)
    assert found["column 3"].values() == pytest.approx(-4.0 + 23.5 * np.arange(40), abs=1e-9)


def test_points_of_thousands_are_dropped_next_to_decimal_commas(tmp_path: Path) -> None:
    (tmp_path / "big.csv").write_text("t [s];x [um]\n0;1.234,5\n1;-12.345\n2;1.500.000\n3;0.5\n")
    assert delimited.read(tmp_path / "big.csv")[0]["x"].values().tolist() == [1234.5, -12345.0, 1.5e6, 0.5]


def test_one_map_serves_many_files(tmp_path: Path) -> None:
    paths = [tmp_path / f"scope_{k}.csv" for k in range(6)]
    for k, path in enumerate(paths):
        path.write_text(scope(SCOPES["three header lines"], 1.0 + k))
    text = importing.propose(paths)
    assert "and likewise in 5 more" in text and text.count("[[run]]") == 1
    where = '[run.columns.x]\nvariable = "Channel B"  # a guess'
    assert where in text
    found = mapped(tmp_path, text.replace(where, f'{where}\nunit = "um"\nscale = 0.5'), *paths)
    assert [run.name for run in found.runs] == [path.stem for path in paths]
    for k, run in enumerate(found.runs):
        assert run.measured() == pytest.approx(0.5e-6 * (1.0 + k) * X[:, 0], rel=1e-7, abs=1e-15)
    with pytest.raises(InputError, match="two runs would be written to one file"):
        mapped(tmp_path, text, paths[0], paths[0], name="twice")


def test_files_that_hold_different_variables_are_read_together(tmp_path: Path) -> None:
    np.save(tmp_path / "u.npy", U)
    np.save(tmp_path / "x.npy", X[:, 0])
    assert "per_file" not in importing.propose([tmp_path / "u.npy", tmp_path / "x.npy"])


def test_a_variable_that_each_file_has_is_asked_for_in_each(tmp_path: Path) -> None:
    """Files without headers, one with more columns."""
    files = [tmp_path / "model.dat", tmp_path / "test.dat"]
    for width, file in zip((3, 12), files, strict=True):
        np.savetxt(file, np.outer(np.arange(20.0), np.ones(width)), delimiter="\t")
    text = two_columns('variable = "column 1"\nunit = "V"', 'variable = "column 3"\nunit = "um"')
    message = refusal(lambda: mapped(tmp_path, text, *files))
    assert "column 1: is in each file: write per_file = true above [[run]]" in message
    assert len(mapped(tmp_path, f"per_file = true\n{text}", *files).runs) == 2


# --- Refusals

GOOD = two_columns(
    'variable = "u"\nunit = "V"',
    'variable = "y"\nunit = "um"\nchannel = 1',
    'rate = "1 kHz"\naxes = ["sample", "channel"]',
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"u"', '"U"', "run 1.columns.u.variable = U: is no variable of log.npz; known: u, y"),
        ('unit = "V"', 'unit = "um"', "run 1.columns.u.unit = um: 'um' is wrong here"),
        ('unit = "V"', "", 'run 1.columns.u.unit: is missing, and the file does not say it; write unit = "V"'),
        ('rate = "1 kHz"', "", 'run 1.rate: is missing, and the file does not say it; write rate = "1 kHz", or map'),
        ('rate = "1 kHz"', "rate = 1000", "rate = 1000: the unit is missing"),
        ('axes = ["sample", "channel"]', "", 'axes: the variable is 400 x 2; say what its axes are: axes = ["sample"'),
        ('["sample", "channel"]', '["channel"]', "axes = ['channel']: names each axis once, and sample among them"),
        ('["sample", "channel"]', '["samples"]', "axes = ['samples']: expected a list of sample, frequency, channel"),
        ('["sample", "channel"]', '["channel", "sample"]', "run 1.columns: differ in realisations x samples (u 1 x"),
        ("channel = 1", "channel = 3", "run 1.columns.x.channel = 3: the variable has 2 channels, counted from 1"),
        ("channel = 1", "channel = 0", "run 1.columns.x.channel = 0: allowed: 1 to 100000, a whole number"),
        ("channel = 1", "", "run 1.columns.x.channel: is missing; the variable has 2 channels: write channel = 1"),
        ("channel = 1", "chanel = 1", "run 1.columns.x.chanel = 1: is not a known key; did you mean channel?"),
        ('"u"', '"short"', "run 1.columns: differ in realisations x samples (u 1 x 399, x 1 x 400)"),
        ('"u"', '"infinite"', "run 1: has a bad time or value: a value that is not finite cannot be written"),
        ("[run.columns.u]", "[run.columns.v]", "run 1.columns: there is no command (u, ux, uy, uz)"),
        ("[run.columns.u]", '[run.columns."u [V]"]', "run 1.columns.u [V]: is no name for a column"),
        ('name = "sine"', 'name = "a/b"', "run 1.name = a/b: is no name for a file"),
        ("[[run]]", "[run]", "run: is missing; write a table for each run: [[run]]"),
        ("rate", "rat", "rat = 1 kHz: is not a known key; did you mean rate?"),
        ('name = "sine"', 'name = "sine"\nrole = "train"', "run 1.role = train: expected identify or validate or test"),
        ("rate", "text = { decimal = 3 }\nrate", "text.decimal = 3: expected"),
    ],
)  # fmt: skip
def test_a_map_that_does_not_fit(old: str, new: str, message: str, tmp_path: Path) -> None:
    infinite = np.where(np.arange(N) == 3, np.inf, U)
    np.savez(tmp_path / "log.npz", u=U, y=X, short=U[1:], infinite=infinite)
    assert old in GOOD
    said = refusal(lambda: mapped(tmp_path, GOOD.replace(old, new, 1), tmp_path / "log.npz"))
    assert said.startswith(f"{tmp_path}/map.toml: {message}")
    assert not (tmp_path / "out").exists()
    assert not list((tmp_path / "out").glob("*"))


def test_a_folder_that_is_described_already_is_left_alone(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", u=U, y=X)
    mapped(tmp_path, GOOD, tmp_path / "log.npz")
    assert "measurements.toml: is there already, and may have been edited" in refusal(
        lambda: mapped(tmp_path, GOOD, tmp_path / "log.npz")
    )
    (tmp_path / "file").write_text("")
    assert "cannot be written" in refusal(lambda: mapped(tmp_path, GOOD, tmp_path / "log.npz", name="file"))


@pytest.mark.parametrize("ending", [".mat", ".h5", ".tdms", ".uff", ".npy", ".npz"])
@pytest.mark.parametrize("data", [b"", b"junk" * 50, bytes(range(256)) * 8], ids=["empty", "junk", "binary"])
def test_files_that_are_something_else(ending: str, data: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"log{ending}"
    path.write_bytes(data)
    said = refusal(lambda: importing.read_contents([path]))
    assert said.startswith(f"{path}: ") and ("cannot be read as a" in said or "holds no array of numbers" in said)


def test_files_that_are_cut_short(tmp_path: Path) -> None:
    np.save(tmp_path / "log.npy", X)
    paths = [matlab(tmp_path / "rig.mat"), tmp_path / "log.npy"]
    for path in paths:
        path.write_bytes(path.read_bytes()[:-1000])
        assert "cannot be read as a" in refusal(lambda p=path: importing.read_contents([p]))  # type: ignore[misc]


def test_texts_that_are_no_tables(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    for data, message in (
        (b"", "has no row of numbers"),
        (b"all is well\nno numbers\n", "has no row of numbers"),
        (b"a,b\n1,2\n3,4,5\n", "row 2 of numbers = 3,4,5: has 3 cells where the first row of numbers has 2"),
        (b"\x81\x8d" * 9, "is no text in UTF-8, UTF-16 or CP1252"),
    ):
        path.write_bytes(data)
        assert refusal(lambda: importing.read_contents([path])).startswith(f"{path}: {message}")
    assert refusal(lambda: importing.read_contents([tmp_path / "none.mat"])).endswith(
        "cannot be read: No such file or directory"
    )


@pytest.mark.parametrize("name", ["log.xlsx", "log.XLS", "log.ods"])
def test_a_spreadsheet_is_to_be_exported(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"PK\x03\x04\x81\x8d")
    said = refusal(lambda: importing.read_contents([tmp_path / name]))
    assert said == f"{tmp_path / name}: is a spreadsheet; export the sheet as CSV, and import that"


def test_json_is_to_be_written_as_columns(tmp_path: Path) -> None:
    """Its one long line is longer than a cell of a table may be, also under another name."""
    text = f'{{"data": [{", ".join(["[0.0, 0.1]"] * 20_000)}], "unit": "in"}}'
    for name in ("log.json", "log.txt"):
        (tmp_path / name).write_text(text)
    said = refusal(lambda: importing.read_contents([tmp_path / "log.json"]))
    assert said == f"{tmp_path / 'log.json'}: is JSON; write its lists as columns of a CSV file, and import that"
    assert "has no row of numbers" in refusal(lambda: importing.read_contents([tmp_path / "log.txt"]))


def test_lines_between_quotation_marks_are_rows(tmp_path: Path) -> None:
    """So a table looks that was written as one column of text."""
    path = tmp_path / "log.csv"
    path.write_text("".join(f'"{k}, {0.1 * k:g}, {-k}"\r\n' for k in range(12)))
    found = importing.read_contents([path]).variables
    assert list(found) == ["column 1", "column 2", "column 3"]
    assert [float(found[name].values()[3]) for name in found] == pytest.approx([3.0, 0.3, -3.0])
    path.write_text('"a b"\n' + "".join(f'"{k}"\n' for k in range(12)))
    assert list(importing.read_contents([path]).variables) == ["a b"]


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "h5py", None)
    (tmp_path / "log.h5").write_bytes(b"")
    assert "needs h5py: pip install 'flexdesign[import]'" in refusal(
        lambda: importing.read_contents([tmp_path / "log.h5"])
    )


# --- The command


def test_the_template_is_a_map_that_wants_completing(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    matlab(tmp_path / "rig.mat")
    ended = command_line("import", "rig.mat", "--print-map")
    assert (ended.code, ended.stderr) == (0, "")
    assert '#   "rig.y"' in ended.stdout and "400 x 2" in ended.stdout and "= 2000" in ended.stdout
    seen = tomllib.loads(ended.stdout)
    assert seen["rate"] == "2000 Hz"
    assert seen["run"][0]["columns"]["u"]["variable"] == "rig.u" and seen["run"][0]["columns"]["x"]["channel"] == 1
    (tmp_path / "map.toml").write_text(ended.stdout)
    assert "?" in command_line("import", "rig.mat", "--map", "map.toml").stderr
    complete = (
        ended.stdout.replace('["?", "?"]', '["sample", "channel"]').replace('"?"', '"V"', 1).replace('"?"', '"um"')
    )
    (tmp_path / "map.toml").write_text(complete)
    ended = command_line("import", "rig.mat", "--map", "map.toml", "-o", "sine")
    assert (ended.code, ended.stderr) == (0, "")
    assert "sine/rig.csv: 400 samples at 2000 Hz: u, x" in ended.stdout
    assert ended.stdout.endswith("Next: flexdesign check sine\n")
    (run,) = read_runs([tmp_path / "sine"])
    assert 1e6 * run.measured() == pytest.approx(X[:, 0], rel=1e-11)


def test_the_template_of_a_table_is_complete_where_it_names_its_units(
    tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    (tmp_path / "log.csv").write_text(
        "made by a logger\ntime (s);cmd (V);pos (um)\n0;1;2\n" + "".join(f"{k};{k};{-k * k}\n" for k in range(1, 20))
    )
    ended = command_line("import", "log.csv", "--print-map")
    assert "# made by a logger" in ended.stdout and "?" not in ended.stdout
    (tmp_path / "map.toml").write_text(ended.stdout)
    ended = command_line("import", "log.csv", "--map", "map.toml")
    assert ended.code == 0 and (tmp_path / "recordings" / "log" / "log.csv").is_file()


def test_what_is_wrong_is_said(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    np.savez(tmp_path / "log.npz", u=U, x=np.where(np.arange(N) == 7, np.nan, X[:, 0]))
    (tmp_path / "map.toml").write_text(two_columns('variable = "u"\nunit = "V"', 'variable = "x"\nunit = "um"'))
    ended = command_line("import", "log.npz", "--map", "map.toml", "-o", "out")
    assert "  x is missing in line 10\n" in ended.stdout
    ended = command_line("import", "none.npz", "--map", "map.toml", "-o", "out")
    assert (ended.code, ended.stdout) == (2, "") and len(ended.stderr.splitlines()) == 1


# --- Recordings of others


@recordings
def test_steering_mirror(tmp_path: Path) -> None:
    """Three inputs and outputs, three realisations, two periods, at three levels; as their description has it."""
    folder = SHARED / "steering-mirror"
    columns = "".join(
        f'[run.columns.{c}{a}]\nvariable = "{v}_100mV_test"\nunit = "{unit}"\nchannel = {k}\n'
        for c, v, unit in (("u", "u", "V"), ("", "y", "m"))
        for k, a in enumerate("xyz", start=1)
    )
    text = (
        'rate = "6400 Hz"\naxes = ["sample", "channel", "realisation", "period"]\n[[run]]\nname = "level"\n' + columns
    )
    found = mapped(tmp_path, text, *sorted(folder.glob("*_100mV_test.npy")))
    y = np.load(folder / "y_100mV_test.npy")
    for k, run in enumerate(found.runs):
        assert run.commands == ("ux", "uy", "uz") and 1 / run.period == pytest.approx(6400)
        assert run.remarks == ()
        periods = np.concatenate([y[:, :, k, 0], y[:, :, k, 1]]).T
        assert run.measured() == pytest.approx(periods, rel=1e-11, abs=1e-18)


def test_a_file_with_gaps_in_its_command_is_several_recordings(tmp_path: Path) -> None:
    """A logger that waits for a trigger: nobody knows the command meanwhile, but each part is a good recording."""
    taken = np.concatenate([np.arange(100), np.arange(150, 250), np.arange(300, 305)])
    t, u = taken / RATE, np.sin(0.3 * taken)
    lines = [f"{a:.6f},{b:.9f},{2 * b:.9f}" for a, b in zip(t, u, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["t [s],u [V],x [um]", *lines]) + "\n")
    text = "[[run]]\n" + "".join(f'[run.columns.{c}]\nvariable = "{c}"\n' for c in "tux")
    (tmp_path / "map.toml").write_text(text)
    found = importing.bring_in([tmp_path / "log.csv"], tmp_path / "map.toml", tmp_path / "out").runs
    assert [(run.name, len(run.time)) for run in found] == [("log_1", 100), ("log_2", 100)]
    assert found[1].command() == pytest.approx(u[100:200], abs=1e-8)
    assert "2 recordings; 1 of fewer than 10 samples left out" in " ".join(found[0].remarks)


def test_parts_of_a_recording_sort_as_they_were_recorded(tmp_path: Path) -> None:
    taken = np.concatenate([np.arange(100 * k, 100 * k + 50) for k in range(12)])
    t, u = taken / RATE, np.sin(0.3 * taken)
    lines = [f"{a:.6f},{b:.9f},{2 * b:.9f}" for a, b in zip(t, u, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["t [s],u [V],x [um]", *lines]) + "\n")
    text = "[[run]]\n" + "".join(f'[run.columns.{c}]\nvariable = "{c}"\n' for c in "tux")
    (tmp_path / "map.toml").write_text(text)
    importing.bring_in([tmp_path / "log.csv"], tmp_path / "map.toml", tmp_path / "out")
    found = read_runs([tmp_path / "out"])
    assert len(found) == 12
    assert np.concatenate([run.command() for run in found]) == pytest.approx(u, abs=1e-8)


def test_counts_are_no_unit_but_have_a_size(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t [s],u [V],theta\n" + "".join(f"{0.01 * k},1,{k}\n" for k in range(20)))
    columns = '[run.columns.t]\nvariable = "t"\n[run.columns.u]\nvariable = "u"\n'
    text = f'[[run]]\n{columns}[run.columns.x]\nvariable = "theta"\nunit = "count"\n'
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(InputError, match=r'counts state the size of one: unit = "um", scale'):
        importing.bring_in([tmp_path / "log.csv"], tmp_path / "map.toml", tmp_path / "out")
