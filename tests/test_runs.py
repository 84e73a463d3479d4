"""Runs: read as they were written, refused with their place, and the recordings of others where they are at hand."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexdesign.core.errors import InputError
from flexdesign.core.model import Observation
from flexdesign.diagnosis.procedure import INTERPOLATION_TEXTS
from flexdesign.measurements.recordings import Run, read_measurements, read_run, read_runs, write_run

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
recordings = pytest.mark.skipif(not SHARED.is_dir(), reason=f"the recordings of others are not at {SHARED}")

HEADER = "t [s],u [V],x [um]"
ROWS = [f"{0.001 * k:.3f},{k},{2 * k}" for k in range(12)]


def written(folder: Path, header: str = HEADER, rows: list[str] | None = None, name: str = "sine.csv") -> Path:
    path = folder / name
    path.write_text("\n".join([header, *(ROWS if rows is None else rows), ""]), encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_run(path)
    return str(caught.value).removeprefix(f"{path}: ").removeprefix(f"{path}")


# --- Reading


def test_a_run_is_an_observation_in_si(tmp_path: Path) -> None:
    run = read_run(written(tmp_path))
    seen: Observation = run
    assert (seen.name, seen.role, run.between_samples) == ("sine", "identify", "linear")
    assert run.period == pytest.approx(1e-3)
    assert run.time == pytest.approx(1e-3 * np.arange(12))
    assert run.command() == pytest.approx(np.arange(12))
    assert seen.measured() == pytest.approx(2e-6 * np.arange(12))
    assert dict(run.si) == {"u": "V", "x": "m"}
    with pytest.raises(ValueError, match="read-only"):
        run.measured()[0] = 1.0


def test_units_are_read_and_not_assumed(tmp_path: Path) -> None:
    header = '"t [ms]", u [mV] ,x [nm],y [V],T [degC],i [mA],f [kN],phase [deg]'
    rows = [f"{k},1500,{k},{k},20,3,0.002,180" for k in range(10)]
    run = read_run(written(tmp_path, header, rows))
    assert run.period == pytest.approx(1e-3)
    for name, value in {"u": 1.5, "T": 293.15, "i": 3e-3, "f": 2.0, "phase": np.pi}.items():
        assert run.columns[name] == pytest.approx(value)
    assert dict(run.si) == {"u": "V", "x": "m", "y": "V", "T": "K", "i": "A", "f": "N", "phase": "rad"}
    assert run.responses == ("x", "y")
    assert run.measured() == pytest.approx(np.stack([1e-9 * np.arange(10), np.arange(10)]))


def test_several_axes_come_in_their_order(tmp_path: Path) -> None:
    rows = [f"{k},1,2,3,30,10" for k in range(10)]
    run = read_run(written(tmp_path, "t [s],uz [V],ux [V],uy [V],z [um],x [um]", rows))
    assert run.commands == ("ux", "uy", "uz") and run.responses == ("x", "z")
    assert run.command()[:, 0] == pytest.approx([2, 3, 1])
    assert run.measured()[:, 0] == pytest.approx([10e-6, 30e-6])


def test_comments_empty_lines_and_other_editors(tmp_path: Path) -> None:
    text = "\ufeff# bench 3\n\n" + HEADER + "\r\n# warm\r\n" + "\r\n".join(ROWS[:6]) + "\r\n\r\n  \r\n"
    text += "\r\n".join([*ROWS[6:11], ROWS[11] + "  # last", "# end"])
    path = tmp_path / "run.csv"
    path.write_bytes(text.encode())
    assert read_run(path).measured() == pytest.approx(2e-6 * np.arange(12))


def test_lines_are_counted_as_an_editor_counts_them(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("# bench\n\n" + "\n".join([HEADER, *ROWS[:3], "", "# pause", *ROWS[3:5], "0.005,5,abc", *ROWS[6:]]))
    assert refusal(path).startswith("line 11, column x = abc: is not a number")


# --- Refusals


@pytest.mark.parametrize(
    ("header", "row", "message"),
    [
        (HEADER, ",5,10", 'line 7, column t = "": is empty; correct the cell or remove the rows'),
        (HEADER, "nan,5,10", "line 7, column t = nan: is not a finite number; correct the cell or remove the rows"),
        (HEADER, "0.005,5V,10", "line 7, column u = 5V: is not a number"),
        (HEADER, "0.005,5,1_0", "line 7, column x = 1_0: is not a number"),
        (HEADER, "0.005,5", "line 7 = 0.005,5: has 2 cells where the header has 3"),
        (HEADER, "0.005,5,10,11", "line 7 = 0.005,5,10,11: has 4 cells where the header has 3"),
        (HEADER, "0.004,5,10", "line 7, column t = 0.004 s: is not later than the row before (0.004 s)"),
        (
            HEADER,
            "0.0039,5,10",
            "line 7, column t = 0.0039 s: is not later than the row before (0.004 s); sort the rows",
        ),
        (HEADER, "0,5,10", "line 7, column t = 0 s: is not later than the row before (0.004 s); split the file here"),
        ("u [V],x [um],y [um]", "0,0,0", "header: there is no column t [s]; found u, x, y"),
        (
            "Time [s],Command [V],x [um]",
            "0.005,5,10",
            "header: there is no command (u, ux, uy, uz); found Time, Command, x: add a column u [V]; bring a file of "
            "another program in with flexdesign import",
        ),
        (
            "Time (s),Command (V),x (um)",
            "0.005,5,10",
            "line 1, header cell 1 = Time (s): write name and unit, for example x [um]; [1] for a pure number; bring a "
            "file of another program in with flexdesign import",
        ),
        ("t [s],v [V],x [um]", "0.005,5,10", "header: there is no command (u, ux, uy, uz); found t, v, x"),
        ("t [s],u [V],w [um]", "0.005,5,10", "header: there is no response (x, y, z); found t, u, w"),
        ("t [s],u [V],u [V]", "0.005,5,10", "line 1, header cell 3 = u [V]: there are two columns u"),
        ("t [s],u [V],x", "0.005,5,10", "line 1, header cell 3 = x: write name and unit, for example x [um]"),
        ("t [s],u [V],", "0.005,5,10", 'line 1, header cell 3 = "": write name and unit'),
        (
            "t [s],u [V],x [umm]",
            "0.005,5,10",
            "line 1, header cell 3 = x [umm]: unknown unit 'umm'; expected a unit like m",
        ),
        ("t [s],u [V],x [N]", "0.005,5,10", "line 1, header cell 3 = x [N]: 'N' is wrong here"),
        (
            "t [s],u [V],x [m/s^2]",
            "0.005,5,10",
            "line 1, header cell 3 = x [m/s^2]: 'm/s^2' is wrong here: it is not a unit of length; expected a unit "
            "like m or V or rad; a response is a position: integrate a velocity once, an acceleration twice",
        ),
        ("t [V],u [V],x [um]", "0.005,5,10", "line 1, header cell 1 = t [V]: 'V' is wrong here"),
        (
            "t [s],u [A],x [um]",
            "0.005,5,10",
            "line 1, header cell 2 = u [A]: 'A' is wrong here: it is not a unit of voltage; expected a unit like V; a "
            "command that is no voltage, as a current or a force, is written in V, one for one",
        ),
        ("t [s];u [V];x [um]", "0,005;5;10", "line 1 = t [s];u [V];x [um]: separate cells by commas"),
    ],
)
def test_a_bad_file_is_refused_with_place_value_and_remedy(header: str, row: str, message: str, tmp_path: Path) -> None:
    said = refusal(written(tmp_path, header, [*ROWS[:5], row, *ROWS[6:]]))
    assert said.startswith(message)


def test_time_may_be_rounded_and_a_drift_is_resampled(tmp_path: Path) -> None:
    period = 1.6384e-3
    rows = [f"{k * period:.6f},0,0" for k in range(5000)]  # rounded to 0.0003 of a period, as in a real recording
    assert read_run(written(tmp_path, rows=rows)).period == pytest.approx(period, rel=1e-6)
    drifting = 1e-3 * np.cumsum(np.linspace(1.0, 1.0005, 5000))  # each step within 0.001 of the others
    rows = [f"{t:.12g},0,0" for t in drifting]
    (remark,) = read_run(written(tmp_path, rows=rows)).remarks
    assert remark.startswith("rows are 0.001 s to 0.001 s apart") and remark.endswith("resampled to 0.00100025 s")


def test_what_a_remark_says_about_the_command_can_be_written(tmp_path: Path) -> None:
    """The words of the remark, as they stand, in `measurements.toml`."""
    (line,) = re.findall(r'between_samples = "\w+"', INTERPOLATION_TEXTS["hold"])
    (tmp_path / "measurements.toml").write_text(line)
    run = read_run(written(tmp_path))
    assert (run.between_samples, run.between_is_stated) == ("hold", True)


def test_files_that_are_none(tmp_path: Path) -> None:
    assert refusal(written(tmp_path, rows=ROWS[:9])) == "has 9 rows that can be used; at least 10 are needed"
    assert refusal(written(tmp_path, rows=[])) == "has a header and no rows; add rows of numbers"
    assert refusal(written(tmp_path, "# nothing", [])).startswith("is empty; it needs a header")
    assert refusal(tmp_path / "none.csv").startswith("cannot be read: No such file")
    (tmp_path / "latin.csv").write_bytes(b"t [s],u [V],x [\xb5m]\n")
    said = refusal(tmp_path / "latin.csv")
    assert said.startswith("is not UTF-8 text (line 1)") and said.endswith("or bring it in with flexdesign import")
    header, rows = "t [s],u [V],ux [V],x [um]", [f"{k},0,0,0" for k in range(10)]
    assert refusal(written(tmp_path, header, rows)).startswith("header: has u and also ux, uy or uz")


# --- Folders and measurements.toml


def test_a_folder_with_its_description(tmp_path: Path) -> None:
    for name in ("b.csv", "a.csv"):
        written(tmp_path, name=name)
    (tmp_path / "measurements.toml").write_text(
        'title = "Bench 3"\naxis = "x"\n[sensors.x]\nnoise = "1 nm"\n'
        '[[run]]\nfile = "b.csv"\nkind = "sine"\nrole = "validate"\nbetween_samples = "hold"\n'
        'conditions = { payload = "1 g" }\n'
    )
    first, second = read_runs([tmp_path, tmp_path / "b.csv"])
    assert (first.name, first.role, first.between_samples) == ("a", "identify", "linear")
    assert (second.name, second.role, second.between_samples) == ("b", "validate", "hold")
    assert read_measurements(tmp_path / "measurements.toml").title == "Bench 3"
    assert [run.name for run in read_runs([tmp_path / "measurements.toml"])] == ["a", "b"]


def test_noise_is_stated_once_for_every_sensor_that_is_not_described(tmp_path: Path) -> None:
    written(tmp_path)
    for text, noise in (('noise = "3 nm"', 3e-9), ('noise = "3 nm"\n[sensors.x]\nnoise = "2 nm"', 2e-9)):
        (tmp_path / "measurements.toml").write_text(text)
        (run,) = read_runs([tmp_path])
        assert run.sensors["x"].noise == pytest.approx(noise)


def test_runs_of_one_stem_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    for folder in ("cold", "warm"):
        (tmp_path / folder).mkdir()
        written(tmp_path / folder)
    written(tmp_path, name="other.csv")
    runs = read_runs([tmp_path / "cold", tmp_path / "warm", tmp_path / "other.csv"])
    assert [run.name for run in runs] == ["cold/sine", "warm/sine", "other"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[run]]\nfile = "sinus.csv"\n', "run.file = sinus.csv: is not in the folder; did you mean sine.csv?"),
        (
            '[[run]]\nfile = "sine.csv"\nrole = "train"\n',
            "run 1.role = train: expected identify or validate or test",
        ),
        ('[[run]]\nrole = "identify"\n', "run 1.file: is missing"),
        ('[[run]]\nfile = "sine.csv"\n[[run]]\nfile = "sine.csv"\n', "run 2.file = sine.csv: is described twice"),
        ('[run]\nfile = "sine.csv"\n', "run: expected a list of tables: [[run]]"),
        ("title = 3\n", "title = 3: expected text"),
        ('noise = "-3 nm"\n', "noise = -3 nm: must be more than zero"),
        ('noise = "0 nm"\n', "noise = 0 nm: must be more than zero"),
        ("noise = 3\n", 'noise = 3: the unit is missing; write for example "3 nm"'),
        ('noise = "3"\n', 'noise = "3": the unit is missing; write for example "3 nm"'),
        ('[sensors.x]\nnoise = "3"\n', 'sensors.x.noise = "3": the unit is missing; write for example "3 nm"'),
        ('noise = "3 V"\n', "noise: is in V, but x of sine.csv in um; correct one of the two"),
        ('[sensors.x]\nnoise = "-3 nm"\n', "sensors.x.noise = -3 nm: must be more than zero"),
        ("title = \n", "is not valid TOML"),
    ],
)
def test_a_description_that_cannot_be_used(text: str, message: str, tmp_path: Path) -> None:
    written(tmp_path)
    path = tmp_path / "measurements.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_runs([tmp_path])
    assert str(caught.value).startswith(f"{path}: {message}")


def test_a_folder_without_runs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no CSV file; name a folder of recorded runs"):
        read_runs([tmp_path])


# --- Writing


@given(
    # Fewer samples than a stuck sensor is told by, and none alike, as a saturated one has them.
    st.lists(
        st.tuples(st.floats(-200, 200), st.floats(-1e-3, 1e-3)), min_size=10, max_size=19, unique_by=lambda s: s[1]
    ),
    st.floats(0, 1e4),
    st.sampled_from([1e-5, 1e-3, 0.25]),
)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, samples: list[tuple[float, float]], start: float, period: float
) -> None:
    path = tmp_path_factory.mktemp("runs") / "run.csv"
    moments = start + period * np.arange(len(samples))
    u, x = np.array(samples).T
    write_run(path, moments, {"u [V]": u, "x [um]": x, "T [degC]": 290 + 0 * u}, comment="bench 3\nwarm")
    run = read_run(path)
    # Twelve digits are written.
    assert run.command() == pytest.approx(u, rel=1e-11)
    assert run.measured() == pytest.approx(x, rel=1e-11, abs=1e-300)
    assert run.columns["T"] == pytest.approx(290)
    assert run.period == pytest.approx(period, rel=1e-3)
    assert path.read_text().startswith("# bench 3\n# warm\nt [s],u [V],x [um],T [degC]\n")


def test_writing_replaces_whole_files_and_leaves_nothing_behind(tmp_path: Path) -> None:
    path = written(tmp_path)
    before = path.read_text()
    moments = 0.1 * np.arange(10)
    for recorded, message in [
        ({"u [V]": moments, "x": moments}, "write name and unit"),
        ({"u [V]": moments, "x [um]": moments[1:]}, "columns of one length"),
        ({"u [V]": moments, "x [um]": np.where(moments > 0.5, np.nan, 0.0)}, "not finite"),
        ({"u [V]": moments, "x [umm]": moments}, "unknown unit 'umm'"),
    ]:
        with pytest.raises(ValueError, match=message):
            write_run(path, moments, recorded)
    assert path.read_text() == before
    write_run(path, moments, {"u [V]": moments, "x [um]": 1e-6 * moments})
    assert read_run(path).measured() == pytest.approx(1e-6 * moments)
    assert [file.name for file in tmp_path.iterdir()] == ["sine.csv"]
    with pytest.raises(InputError, match="cannot be written"):
        write_run(tmp_path / "none" / "run.csv", moments, {"u [V]": moments, "x [um]": moments})


def test_a_hundred_thousand_rows_are_read_in_a_second(tmp_path: Path) -> None:
    count = 100_000
    path = tmp_path / "long.csv"
    rng = np.random.default_rng(3)
    write_run(path, 1e-3 * np.arange(count), {"u [V]": rng.normal(size=count), "x [um]": rng.normal(size=count)})
    read_run(written(tmp_path))  # the units are loaded once
    start = time.process_time()  # of this process, since the clock says nothing where cores are shared
    run = read_run(path)
    assert time.process_time() - start < 1.0
    assert len(run.time) == count


# --- Recordings of others


@recordings
def test_electronic_oscillator() -> None:
    runs = {run.name: run for run in read_runs([SHARED / "duffing-circuit"])}
    assert {name: run.role for name, run in runs.items()} == {
        "arrow": "validate",
        "multisine-identify": "identify",
        "multisine-validate": "validate",
    }
    for run in runs.values():
        assert 1 / run.period == pytest.approx(610.35, abs=0.01)  # as its source says
        assert run.si["x"] == "V" and run.between_samples == "linear"
    # As the description of the data has it: the arrow's response has 53 mV.
    assert 1e3 * runs["arrow"].measured().std() == pytest.approx(53, abs=1)


@recordings
def test_piezo_actuator() -> None:
    (run,) = read_runs([SHARED / "piezo-actuator"])
    assert (run.name, run.between_samples, run.role) == ("cycles-1hz", "hold", "identify")
    assert 1 / run.period == pytest.approx(2500)
    assert run.si == {"u": "V", "x": "m"}
    # The description says +-150 V, +-19.7 um.
    assert np.abs(run.command()).max() == pytest.approx(150, rel=0.01)
    assert 1e6 * np.abs(run.measured()).max() == pytest.approx(19.7, rel=0.01)


def test_a_run_can_be_made_without_a_file() -> None:
    run = Run("made", np.arange(10.0), {"u": np.zeros(10), "x": np.ones(10)}, {"u": "V", "x": "m"}, role="validate")
    assert run.measured().sum() == 10 and run.period == 1.0
