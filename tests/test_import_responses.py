"""Frequency responses of other programs: complex arrays in every format, read back line by line."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.measurements import importing
from flexdesign.measurements.recordings import FrequencyResponse, read_recordings

F = np.linspace(0.0, 400.0, 201)
#: Outputs by inputs by lines [um/V]: two modes.
H = np.stack(
    [
        [2.0 / (1 - (F / 118.0) ** 2 + 2j * 0.03 * F / 118.0), 0.1 / (1 - (F / 300.0) ** 2 + 2j * 0.01 * F / 300.0)],
        [-0.2 * np.exp(-2j * np.pi * F * 1e-3), np.full(len(F), 1.5 + 0.5j)],
    ]
)
#: Files have twelve digits, of magnitude and of phase [deg].
ROUNDED = 2e-11
MAP = """[[run]]
name = "sweep"
output = "x"
amplitude = "2 V"
[run.columns.f]
variable = "f"
unit = "Hz"
[run.columns.response]
variable = "H"
unit = "um/V"
"""


def mapped(folder: Path, text: str, *files: Path) -> importing.Imported:
    (folder / "map.toml").write_text(text)
    return importing.bring_in(files, folder / "map.toml", folder / "out")


def one(found: importing.Imported, expected: Any) -> FrequencyResponse:
    (response,) = found.responses
    assert not found.runs
    assert response.frequencies == pytest.approx(F[1:], rel=1e-11)
    assert (np.abs(1e6 * response.response / expected[1:] - 1) < ROUNDED).all()
    assert response.remarks == ("the line at 0 Hz is left out",)
    (again,) = read_recordings([found.folder])
    assert isinstance(again, FrequencyResponse) and (again.response == response.response).all()
    return response


def matlab(path: Path) -> Path:
    from scipy.io import savemat

    savemat(path, {"frd": {"H": H, "f": F}, "H": H[0, 0], "f": F, "coh": np.full(len(F), 0.98), "fs": 1000.0})
    return path


def test_matlab_5(tmp_path: Path) -> None:
    text = MAP + '[run.columns.coherence]\nvariable = "coh"\nunit = "1"\n'
    found = one(mapped(tmp_path, text, matlab(tmp_path / "sweep.mat")), H[0, 0])
    assert (found.axis, found.amplitude) == ("x", 2.0)
    assert found.coherence == pytest.approx(np.full(len(F) - 1, 0.98))
    header = (tmp_path / "out" / "sweep.csv").read_text().splitlines()[1]
    assert header == "f [Hz],magnitude [um/V],phase [deg],coherence [1]"


def test_one_of_many_responses_is_chosen_by_channel_and_input(tmp_path: Path) -> None:
    """Outputs by inputs by lines, as MATLAB keeps frequency responses."""
    text = 'axes = ["channel", "input", "frequency"]\n' + MAP.replace('"H"', '"frd.H"\nchannel = 2\ninput = 1')
    one(mapped(tmp_path, text, matlab(tmp_path / "sweep.mat")), H[1, 0])


def test_matlab_73_and_hdf5(tmp_path: Path) -> None:
    """MATLAB 7.3 keeps both parts in a compound called real and imag, other programs call them r and i."""
    h5py = pytest.importorskip("h5py")
    parts = np.zeros(H.shape[::-1], dtype=[("real", "f8"), ("imag", "f8")])
    parts["real"], parts["imag"] = H.T.real, H.T.imag
    path = tmp_path / "sweep.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("H", data=parts).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("f", data=F[:, None]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    assert importing.read_contents([path]).variables["H"].shape == (2, 2, len(F))
    text = 'axes = ["channel", "input", "frequency"]\n' + MAP.replace('"H"', '"H"\nchannel = 1\ninput = 2')
    one(mapped(tmp_path, text, path), H[0, 1])
    other = tmp_path / "sweep.h5"
    with h5py.File(other, "w") as file:
        file.create_dataset("H", data=H[1, 1])
        file.create_dataset("f", data=F)
    (tmp_path / "out" / "measurements.toml").unlink()
    one(mapped(tmp_path, MAP, other), H[1, 1])


def test_numpy_with_realisations(tmp_path: Path) -> None:
    np.savez(tmp_path / "sweep.npz", f=F[1:], H=H[0, :, 1:])
    text = 'axes = ["realisation", "frequency"]\n' + MAP
    found = mapped(tmp_path, text, tmp_path / "sweep.npz")
    assert [each.name for each in found.responses] == ["sweep_1", "sweep_2"]
    for each, expected in zip(found.responses, H[0], strict=True):
        assert np.abs(1e6 * each.response / expected[1:] - 1).max() < ROUNDED


@pytest.mark.parametrize(
    "columns",
    [
        '[run.columns.magnitude]\nvariable = "m"\nunit = "nm/V"\n[run.columns.phase]\nvariable = "p"\nunit = "deg"\n',
        '[run.columns.re]\nvariable = "r"\nunit = "um/V"\n[run.columns.im]\nvariable = "i"\nunit = "um/V"\n',
        '[run.columns.response]\nformula = "10 ** (dB / 20) * exp(1j * p) * per"\nunit = "um/V"\n',
        '[run.columns.response]\nformula = "velocity / (2j * pi * f)"\nunit = "um/V"\n',
        '[run.columns.re]\nformula = "real(H)"\nunit = "um/V"\n[run.columns.im]\nformula = "imag(H)"\nunit = "nm/V"\n',
        '[run.columns.magnitude]\nformula = "abs(H)"\nunit = "um/V"\n'
        '[run.columns.phase]\nformula = "angle(H)"\nunit = "deg"\n',
    ],
    ids=["polar", "parts", "decibels", "of a velocity", "parts of a complex one", "polar of a complex one"],
)
def test_every_shape(columns: str, tmp_path: Path) -> None:
    f, h = F[1:], H[0, 0, 1:]
    arrays = {"m": 1e3 * np.abs(h), "p": np.degrees(np.angle(h)), "r": h.real, "i": h.imag, "H": h}
    arrays |= {"dB": 20 * np.log10(np.abs(h)), "velocity": 2j * np.pi * f * h, "f": f}
    np.savez(tmp_path / "sweep.npz", **arrays)
    units = {"p": "deg", "dB": "1", "velocity": "um/s/V", "f": "Hz", "H": "um/V"}
    text = '[constants]\nper = "1 um/V"\n' + "".join(f'[variables.{n}]\nunit = "{u}"\n' for n, u in units.items())
    text += '[[run]]\nname = "sweep"\n[run.columns.f]\nvariable = "f"\nunit = "Hz"\n' + columns
    (found,) = mapped(tmp_path, text, tmp_path / "sweep.npz").responses
    assert np.abs(1e6 * found.response / h - 1).max() < ROUNDED


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('unit = "um/V"', 'unit = "um"', "run 1.columns.response.unit = um: 'um' is wrong here"),
        ('\nunit = "um/V"', "", "run 1.columns.response.unit: is missing, and the file does not say it; write unit = "),
        ("columns.f]", "columns.g]", "run 1.columns.f: is missing; a frequency response (response) has a column f"),
        ("columns.response", "columns.magnitude", "run 1.columns.magnitude = H: holds complex numbers; map it as"),
        ('variable = "f"', 'variable = "fs"', "run 1.columns: differ in realisations x samples (f 1 x 1, response 1 x"),
        ('"H"', '"H"\ninput = 2', "run 1.columns.response.input = 2: the variable has one input, its size is 1 x 201"),
        ('"H"', '"frd.H"', "axes: the variable is 2 x 2 x 201; say what its axes are: axes = [\"frequency\", "),
        ("[[run]]", 'axes = ["frequency", "period"]\n[[run]]', "axes = ['frequency', 'period']: has both frequency"),
    ],
)  # fmt: skip
def test_a_map_that_does_not_fit(old: str, new: str, message: str, tmp_path: Path) -> None:
    matlab(tmp_path / "sweep.mat")
    assert old in MAP
    with pytest.raises(InputError) as caught:
        mapped(tmp_path, MAP.replace(old, new, 1), tmp_path / "sweep.mat")
    assert str(caught.value).startswith(f"{tmp_path}/map.toml: {message}")
    assert not list((tmp_path / "out").glob("*"))


def test_complex_numbers_are_no_column_of_a_run_in_time(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", u=F, x=H[0, 0], y=F.astype(complex))
    run = '[run.columns.u]\nvariable = "u"\nunit = "V"\n[run.columns.x]\nvariable = "x"\nunit = "um"\n'
    text = f'rate = "1 kHz"\n[[run]]\n{run}'
    with pytest.raises(InputError, match=r"run 1\.columns\.x = x: holds complex numbers; map it as response, or write"):
        mapped(tmp_path, text, tmp_path / "log.npz")
    (found,) = mapped(tmp_path, text.replace('"x"', '"y"'), tmp_path / "log.npz").runs  # nothing imaginary in it
    assert 1e6 * found.measured() == pytest.approx(F, rel=1e-11)


def test_the_template_proposes_a_response(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    np.savez(tmp_path / "sweep.npz", H=H[0, 0], freq=F, coh=np.full(len(F), 0.98))
    ended = command_line("import", "sweep.npz", "--print-map")
    assert (ended.code, ended.stderr) == (0, "")
    assert '#   "H"     201, complex  no unit' in ended.stdout
    seen = tomllib.loads(ended.stdout)["run"][0]["columns"]
    assert {name: table["variable"] for name, table in seen.items()} == {
        "f": "freq",
        "response": "H",
        "coherence": "coh",
    }
    text = ended.stdout
    for unit in ("Hz", "um/V", "1"):
        text = text.replace('"?"', f'"{unit}"', 1)
    (tmp_path / "map.toml").write_text(text)
    ended = command_line("import", "sweep.npz", "--map", "map.toml", "-o", "sweep")
    assert (ended.code, ended.stderr) == (0, "")
    assert "sweep/sweep.csv: frequency response, 200 lines, 2 to 400 Hz\n  the line at 0 Hz" in ended.stdout


def test_a_response_is_proposed_before_the_spectra_beside_it(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    """Analysers store spectra as complex numbers, too; and a frequency has the name of a force, but not its unit."""
    np.savez(tmp_path / "sweep.npz", S1=H[0, 0] ** 2, H1_2=H[0, 0], axis=F)
    ended = command_line("import", "sweep.npz", "--print-map")
    columns = tomllib.loads(ended.stdout)["run"][0]["columns"]
    assert columns["response"]["variable"] == "H1_2"
    assert '[run.columns.f]\nvariable = "?"\nunit = "?"  # Hz?' in ended.stdout
