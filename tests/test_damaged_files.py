"""What damaged and unusual files did to the readers once: each ends in one message now, or stands as it is written."""

from __future__ import annotations

import errno
import itertools
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.analytic import static_model
from flexdesign.core import subprocess_call, toml_files, unit_tables, units
from flexdesign.core.errors import MESSAGE, InputError, suggest
from flexdesign.design import design
from flexdesign.design import study as studies
from flexdesign.dynamics import experiments
from flexdesign.measurements import importing, recordings
from flexdesign.measurements.importing import apart
from flexdesign.report import charts, terminal
from flexdesign.report.document import Document, Figure, Table
from studies.fuzz_readers import seeds

#: So many letters no key has.
LONG = 5000


def refusal(act: Callable[[], object]) -> InputError:
    with pytest.raises(InputError) as caught:
        act()
    return caught.value


def message_of(folder: Path, text: str | bytes, read: Callable[[Path], object], name: str = "file.toml") -> str:
    """Return how a file is refused."""
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return str(refusal(lambda: read(path)))


def changed(data: bytes, old: bytes, new: bytes) -> str:
    assert old in data
    return data.replace(old, new, 1).decode()


# --- messages


@pytest.mark.parametrize(
    ("field", "value", "remedy"),
    [("a" * LONG, "b", "write c"), ("a", "b" * LONG, "write c"), ("a", "b", "c" * LONG), ("a", "b", "write c " * LONG)],
)
def test_a_message_is_short(field: str, value: str, remedy: str) -> None:
    message = str(InputError("/" + "folder/" * 50 + "file.toml", field, value, remedy))
    assert len(message.replace("/" + "folder/" * 50, "")) <= MESSAGE
    assert message.endswith(remedy[-8:].strip())


def test_a_message_moves_no_cursor() -> None:
    message = str(InputError("file\x1b[31m.toml", "a\x00", "b\u202e", "c\x07\nd"))
    assert message == r"file\x1b[31m.toml: a\x00 = b\u202e: c\x07 d"


def test_a_message_is_the_same_from_another_process() -> None:
    with pytest.raises(InputError) as caught:
        subprocess_call.ask(60.0, unit_tables.read, Path("/nowhere/run.csv"), {})
    assert (caught.value.file, caught.value.field) == ("/nowhere/run.csv", "")


def test_a_time_limit_is_one_of_processor_time() -> None:
    """On a machine with much else to do a process waits, and is not at fault."""
    assert subprocess_call.ask(0.5, time.sleep, 2.0) is None
    with pytest.raises(subprocess_call.ProcessDied):
        subprocess_call.ask(0.5, sum, itertools.count())


def test_a_name_without_end_is_like_no_other() -> None:
    assert suggest("x" * LONG, ["x"]) == "; known: x"


# --- TOML

MODEL = (b"format = 1\n" + seeds.AXIS).decode()


@pytest.mark.parametrize("number", ["9" * LONG, "0x" + "f" * LONG, "99999999999999999999", "-9223372036854775809"])
def test_a_whole_number_without_end_is_refused(tmp_path: Path, number: str) -> None:
    said = message_of(tmp_path, f"[a]\nb = {number}\n", toml_files.read_toml)
    assert "64 bits" in said and "1e20" in said and len(said) < MESSAGE


def test_a_whole_number_without_end_is_no_override() -> None:
    assert "64 bits" in str(refusal(lambda: toml_files.overlay({"a": {}}, ["a.b=0x" + "f" * LONG])))


@pytest.mark.parametrize(
    "text", [".".join("a" * 2000) + " = 1", "a = " + "[" * 60 + "]" * 60, "[" + ".".join("b" * 50) + "]"]
)
def test_tables_without_end_in_each_other_are_refused(tmp_path: Path, text: str) -> None:
    said = message_of(tmp_path, text + "\n", toml_files.read_toml)
    assert "deep" in said and "flat" in said


def test_overrides_without_end_are_refused() -> None:
    assert "write --set" in str(refusal(lambda: toml_files.overlay({}, [".".join("a" * 2000) + "=1"])))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b'["dimensions.width=13 mm"]', b'["dimensions.width=13 mm", 3]', "variants.wider.2 = 3: expected text"),
        (b'["dimensions.width=13 mm"]', b"{ a = 1 }", "variants.wider: expected a list"),
        (b'["dimensions.width=13 mm"]', b"3", "variants.wider = 3: expected a list"),
        (b'method = "extruded"', b'method = "thin"', "mesh.method = thin: expected 'auto', 'wild' or 'extruded'"),
    ],
)
def test_values_of_a_wrong_type_within_lists_are_named(tmp_path: Path, old: bytes, new: bytes, words: str) -> None:
    (tmp_path / "design.toml").write_bytes(seeds.DESIGN)
    assert words in message_of(tmp_path, seeds.STUDY.replace(old, new), studies.read, "study.toml")


def test_a_file_with_a_name_that_no_file_system_takes_is_refused(tmp_path: Path) -> None:
    from flexdesign.workflows import sweeps

    (tmp_path / "design.toml").write_bytes(seeds.DESIGN)
    text = changed(seeds.SWEEP, b'design = "bridge_amplifier"', b'design = "' + b"x" * 300 + b'"')
    assert "File name too long" in message_of(tmp_path, text, sweeps.read, "sweep.toml")
    text = changed(seeds.DESIGN, b"[effects.over_cut]", b'[effects."' + b"x" * 300 + b'.py"]')
    assert "is no Python file" in message_of(tmp_path, text, design.read)
    material = changed(
        seeds.DESIGN[: seeds.DESIGN.index(b"[material]")], b"[dim", b'material = "' + b"x" * 300 + b'.toml"\n[dim'
    )
    assert "cannot be read" in message_of(tmp_path, material, design.read)
    assert not toml_files.is_folder(Path("x" * 300))


@pytest.mark.parametrize("unit", ["m**9**9**9", "9**9**9", "(9**99)**99 m", "m²²²²²²²²", "m^x", "m" * LONG])
def test_a_unit_without_end_is_refused_at_once(unit: str) -> None:
    began = time.perf_counter()
    with pytest.raises(ValueError, match="cannot read the unit"):
        units.factor(unit, "m")
    assert time.perf_counter() - began < 5


@pytest.mark.parametrize("unit", ["m^2*kg^2/(s^4*A^2)", "Hz^(1/2)", "m**-2", "m⁻²", "V s/m"])
def test_a_unit_with_powers_is_read(unit: str) -> None:
    assert units.quantity(1.0, unit).magnitude == 1.0


def test_a_number_without_end_is_refused_at_once() -> None:
    with pytest.raises(ValueError, match="is no number of at most"):
        units.from_text("9" * 200_000 + "\n", "m")


@pytest.mark.parametrize("scale", ["0", "1e-320"])
def test_a_scale_of_nothing_is_refused(tmp_path: Path, scale: str) -> None:
    text = changed(seeds.MEASUREMENTS, b"scale = 20", f"scale = {scale}".encode())
    assert "makes every command zero" in message_of(tmp_path, text, recordings.read_measurements)


@pytest.mark.parametrize("encoding", ["nul\\u0000", "no such", "ascii"])
def test_an_encoding_that_does_not_fit_is_refused(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "data.txt").write_text("t;u;µ\n0;1;2\n1;2;3\n", encoding="utf-8")
    plan = f'rate = "2 kHz"\n[text]\nencoding = "{encoding}"\n[[run]]\n[run.columns.u]\nvariable = "u"\nunit = "V"\n'

    def read(path: Path) -> object:
        return importing.bring_in([tmp_path / "data.txt"], path, tmp_path / "out")

    assert "does not fit" in message_of(tmp_path, plan, read, "map.toml")


# --- tables


def test_cells_without_end_take_no_time(tmp_path: Path) -> None:
    began = time.perf_counter()
    said = message_of(
        tmp_path, f"t [s],{'u ' + ' ' * 50_000 + 'V'}\n1,2\n", lambda path: unit_tables.read(path, {}), "run.csv"
    )
    assert "write name and unit" in said and len(said) < MESSAGE + len(str(tmp_path))
    (tmp_path / "data.txt").write_text(f"t,{'u ' + ' ' * 50_000 + 'V'}\n" + "1,2\n" * 20)
    assert len(importing.read_contents([tmp_path / "data.txt"]).variables) == 2
    assert time.perf_counter() - began < 5


def test_times_that_are_far_away_ask_for_no_memory(tmp_path: Path) -> None:
    """Rows at 0, 1, 2 ... ms and one at 1e12 s, out of order: a uniform time from end to end has 1e15 samples."""
    moments = [*(1e-3 * np.arange(30)), 1e12, *(1e-3 * np.arange(30, 40))]
    text = "t [s],u [V],x [um]\n" + "".join(f"{t:.6g},{k % 7},{k % 5}\n" for k, t in enumerate(moments))
    assert "is not later than the row before" in message_of(tmp_path, text, recordings.read_run, "run.csv")


def test_gaps_that_are_longer_together_than_a_record_are_refused(tmp_path: Path) -> None:
    """Each gap is shorter than all rows together, a hundred of them are not."""
    steps = np.where(np.arange(1000) % 10 == 5, 0.9, 1e-3)
    moments = np.cumsum(steps)
    text = "t [s],u [V],x [um]\n" + "".join(f"{t:.9g},{k % 7},{k % 5}\n" for k, t in enumerate(moments))
    assert "split the file there" in message_of(tmp_path, text, recordings.read_run, "run.csv")


def test_a_reading_that_nothing_measures_is_refused(tmp_path: Path) -> None:
    text = "t [s],u [V],x [um]\n" + "".join(f"{0.001 * k},{k % 7},{'1e300' if k == 5 else k % 5}\n" for k in range(40))
    said = message_of(tmp_path, text, recordings.read_run, "run.csv")
    assert "line 7, column x = 1e+294 m: is more than anything measures" in said


def test_two_rows_at_one_time_are_refused(tmp_path: Path) -> None:
    """The slope between them has no end, and rows at odd times are interpolated by splines."""
    moments = [0.0, 1e-320, *(1e-3 * np.arange(1, 40) + 1e-4 * np.sin(np.arange(39)))]
    text = "t [s],u [V],x [um]\n" + "".join(f"{t:.9g},{k % 7},{k % 5}\n" for k, t in enumerate(moments))
    assert "remove one of the two" in message_of(tmp_path, text, recordings.read_run, "run.csv")


def test_a_line_that_csv_does_not_take_is_refused(tmp_path: Path) -> None:
    text = seeds.STATIC.decode() + f'"{"x" * 200_000}",1\n'
    bridge = design.read(design.find("bridge_amplifier"))
    said = message_of(tmp_path, text, lambda path: static_model.read([path], bridge), "table.csv")
    assert "is no table in CSV" in said


def test_a_header_of_several_cells_above_one_column_is_read(tmp_path: Path) -> None:
    (tmp_path / "data.txt").write_text("x;y;z\n" + "1.5\n" * 30)
    assert [v.size for v in importing.read_contents([tmp_path / "data.txt"]).variables.values()] == [30]


# --- recordings of other programs

DAMAGED = "it is damaged, cut short or something else; save it again"


def damaged_at(data: bytes, place: int, new: bytes) -> bytes:
    return data[:place] + new + data[place + len(new) :]


def test_a_mat_file_that_ends_the_process_of_its_reader_is_refused(tmp_path: Path) -> None:
    """The flags of an array say that it is complex, and no imaginary part follows: SciPy ends the process."""
    data = seeds.matlab()
    flags = data.index(b"\x06\x00\x00\x00\x08\x00\x00\x00\x06\x00\x00\x00")
    text = damaged_at(data, flags + 9, b"\x08")
    assert DAMAGED in message_of(tmp_path, text, lambda path: importing.read_contents([path]), "rig.mat")
    (tmp_path / "rig.mat").write_bytes(data)  # and the next one is read
    assert "rig.u" in importing.read_contents([tmp_path / "rig.mat"]).variables


def never(path: Path) -> None:
    while True:
        time.sleep(1)


def test_a_library_that_does_not_come_back_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(apart, "LONGEST", 0.5)
    (tmp_path / "a.h5").touch()
    assert DAMAGED in str(refusal(lambda: apart.apart(tmp_path / "a.h5", time.sleep, 60)))


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("rig.mat", seeds.matlab_compressed),
        ("rig.npz", seeds.numpy_archive),
        ("rig.uff", seeds.universal),
        ("rig.h5", seeds.hdf5),
    ],
)
def test_a_damaged_recording_says_no_words_of_a_library(tmp_path: Path, name: str, make: Callable[[], bytes]) -> None:
    data = make()
    for place in (len(data) // 4, len(data) // 2, len(data) - 30):
        path = tmp_path / name
        path.write_bytes(damaged_at(data, place, b"\xff" * 24))
        try:
            found = importing.read_contents([path]).variables
            [variable.values() for variable in found.values()]
        except InputError as error:
            assert DAMAGED in error.remedy or "no array of numbers" in error.remedy


def test_a_damaged_tdms_file_writes_nothing_on_the_terminal(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    data = seeds.tdms()
    (tmp_path / "rig.tdms").write_bytes(data[: len(data) - 100])
    try:
        importing.read_contents([tmp_path / "rig.tdms"])
    except InputError as error:
        assert DAMAGED in error.remedy or "no array of numbers" in error.remedy
    assert capfd.readouterr() == ("", "")


def test_damaged_parquet_says_no_words_of_a_library(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    data = seeds.parquet()
    said = message_of(tmp_path, damaged_at(data, len(data) - 60, b"\xff" * 40), recordings.read_run, "run.parquet")
    assert DAMAGED in said


def test_a_run_with_a_name_that_no_file_system_takes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "data.txt").write_bytes(seeds.TEXT)
    text = changed(seeds.MAP, b'name = "one"', b'name = "' + b"x" * 300 + b'"')
    read = lambda path: importing.bring_in([tmp_path / "data.txt"], path, tmp_path / "out")  # noqa: E731
    assert "more than 100 letters" in message_of(tmp_path, text, read)


# --- a folder where a file is expected, and a place that is full


@pytest.mark.parametrize(
    "read",
    [
        toml_files.read_toml,
        lambda path: unit_tables.read(path, {}),
        lambda path: importing.read_contents([path]),
        recordings.read_run,
        lambda path: static_model.read([path], design.read(design.find("bridge_amplifier"))),
    ],
)
@pytest.mark.parametrize("ending", [".toml", ".csv", ".mat", ".parquet"])
def test_a_folder_is_no_file(tmp_path: Path, read: Callable[[Path], object], ending: str) -> None:
    folder = tmp_path / f"folder{ending}"
    folder.mkdir()
    assert "cannot be read: Is a directory" in str(refusal(lambda: read(folder)))


def test_a_full_temporary_folder_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("tempfile.TemporaryDirectory", full)
    error = refusal(lambda: subprocess_call.call(abs, -1))
    assert error.field == "TMPDIR" and "No space left on device" in error.remedy


def test_a_disk_that_is_full_where_a_library_writes_is_told(
    monkeypatch: pytest.MonkeyPatch, command_line: Callable[..., Any]
) -> None:
    """Numba keeps what it compiles, Matplotlib its list of fonts."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("flexdesign.report.catalogue.material_pages.catalogue", full)
    ended = command_line("materials")
    assert (ended.code, ended.stdout) == (2, "")
    assert ended.stderr.startswith("flexdesign: a file of") and "No space left on device); free space" in ended.stderr


# --- names that mean something to others


def test_brackets_in_a_title_stand_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    title = "Travel [mm] of [bold and [/x] :smile:\x1b[31m"
    terminal.brief(Document(title, [title], []), Table(["[mm]", "b"], [["[/dim]", "1"]], "[mm]"), [Path("[mm].md")])
    said = capsys.readouterr().out
    assert said.count("Travel [mm] of [bold and [/x] :smile:") == 2
    assert "[/dim]" in said and "[mm].md" in said and said.count("[mm]") == 5
    with terminal.progress() as say:
        say("reading [/bold")
    assert "reading [/bold" in capsys.readouterr().err
    assert "[/dim]" in terminal.plain(Table(["a"], [["[/dim]"]]))


def test_dollars_in_names_stand_as_they_are() -> None:
    r"""Between dollars would stand a formula, and \frac alone is none: drawing it would fail."""
    figure, axes = charts.drawing(4.0, 3.0)
    axes.semilogy([1, 2], [1, 1e4], label=r"run $\frac$")
    axes.set_xlabel("$x$ [mm]")
    axes.set_xticks([1, 2], [r"a $\frac$", "b"])
    charts.below(figure, axes, 1)
    drawn = charts.svg(figure).decode()
    assert r"run $\frac$" in drawn and r"a $\frac$" in drawn and "$x$ [mm]" in drawn
    assert "mathdefault{10" in drawn  # powers of ten on the axis are formulas still


@pytest.mark.parametrize("name", ["a/b", "../a", "a:b", 'a"b', "a\\b", "a\x1bb"])
def test_a_figure_is_a_file_beside_the_report_whatever_it_is_called(name: str) -> None:
    file = Figure(f"run_{name}.svg", b"", "").file
    assert Path(file).name == file and file.endswith(".svg") and file.isprintable()
    assert len(Figure(f"{'x' * LONG}.svg", b"", "").file) < 255


def test_an_experiment_of_any_name_is_read_and_one_without_end_is_not(tmp_path: Path) -> None:
    (tmp_path / "command.csv").write_bytes(seeds.FOLLOWED)
    read = lambda path: experiments.read(path, ["x", "y", "z"])  # noqa: E731
    path = tmp_path / "a.toml"
    path.write_text(changed(seeds.EXPERIMENTS, b'name = "step"', b'name = "slow/fast $x [mm]"'))
    assert read(path).experiments[0].name == "slow/fast $x [mm]"
    text = changed(seeds.EXPERIMENTS, b'name = "step"', b'name = "' + b"s" * LONG + b'"')
    assert "more than 60 letters" in message_of(tmp_path, text, read)
