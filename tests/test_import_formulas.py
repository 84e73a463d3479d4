"""Arithmetic between columns: values beside NumPy's, units checked, and nothing of Python run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.core import arithmetic, units
from flexdesign.core.errors import InputError
from flexdesign.measurements import importing

N = 50
RNG = np.random.default_rng(7)
QG, PULSE = RNG.normal(size=N), RNG.normal(size=N)
TOP = """rate = "1 kHz"
[constants]
kv = "243.45 V s/m"
kp = "160.18 1/s"
per = "1 V/mm"
[variables.qg]
unit = "mm"
[variables.pulse]
variable = "force pulse"
unit = "V"
[variables.counts]
unit = "1"
[[run]]
name = "drive"
[run.columns.x]
variable = "qg"
unit = "mm"
[run.columns.u]
unit = "V"
formula = "FORMULA"
"""


def mapped(folder: Path, formula: str, old: str = "", new: str = "") -> importing.Imported:
    arrays: dict[str, Any] = {"qg": QG, "force pulse": PULSE, "counts": 3 * QG}
    np.savez(folder / "log.npz", **arrays)
    assert old in TOP
    (folder / "map.toml").write_text(TOP.replace("FORMULA", formula).replace(old, new, 1))
    return importing.bring_in([folder / "log.npz"], folder / "map.toml", folder / "out")


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("per * (qg + pulse / (kv * kp))", QG + 1e3 * PULSE / (243.45 * 160.18)),
        ("-2 * pulse + 3 * pulse * sin(1)", -2 * PULSE + 3 * PULSE * np.sin(1)),
        ("sqrt(pulse ** 2 + abs(per * qg) ** 2)", np.hypot(PULSE, QG)),
        ("pulse * cos(counts) ** 2 - +pulse / 4", PULSE * np.cos(3 * QG) ** 2 - PULSE / 4),
        ("pulse * exp(-abs(counts))", PULSE * np.exp(-3 * np.abs(QG))),
        ("real((1 + 2j) * conj(1j * pulse))", 2 * PULSE),
        ("pulse * imag(exp(1j * pi / 2))", PULSE),
        ("pulse + angle(-1) / pi * pulse", 2 * PULSE),
    ],
)
def test_values(formula: str, expected: np.ndarray, tmp_path: Path) -> None:
    (run,) = mapped(tmp_path, formula).runs
    assert run.command() == pytest.approx(expected, rel=1e-10, abs=1e-11)
    assert run.measured() == pytest.approx(1e-3 * QG, rel=1e-10, abs=1e-14)


def test_channels_realisations_and_fields_of_structures(tmp_path: Path) -> None:
    from scipy.io import savemat

    y = RNG.normal(size=(N, 2, 3))
    savemat(tmp_path / "rig.mat", {"rig": {"y": y, "u": PULSE}, "gain": 2.5})
    (tmp_path / "map.toml").write_text(
        'rate = "1 kHz"\naxes = ["sample", "channel", "realisation"]\n[variables.a]\nvariable = "rig.y"\nunit = "um"\n'
        'channel = 1\n[variables.b]\nvariable = "rig.y"\nunit = "nm"\nchannel = 2\nscale = 10\n[variables.gain]\n'
        'unit = "1"\n[[run]]\nname = "turn"\n[run.columns.u]\nvariable = "rig.u"\nunit = "V"\n'
        '[run.columns.x]\nformula = "(a - gain * b) / 2"\nunit = "nm"\n'
    )
    found = importing.bring_in([tmp_path / "rig.mat"], tmp_path / "map.toml", tmp_path / "out")
    assert [run.name for run in found.runs] == ["turn_1", "turn_2", "turn_3"]
    for k, run in enumerate(found.runs):
        expected = (1e-6 * y[:, 0, k] - 2.5 * 1e-8 * y[:, 1, k]) / 2
        assert run.measured() == pytest.approx(expected, rel=1e-9, abs=1e-18)


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        ("qg + pulse", "cannot take qg + pulse of [mm] and [V]; units must go together"),
        ("pulse + 3", "cannot take pulse + 3 of [V] and a pure number; units must go together"),
        ("sin(pulse)", "cannot take sin(pulse) of [V]; units must go together"),
        ("2 ** pulse", "cannot take 2 ** pulse of a pure number and [V]; units must go together"),
        ("qg", "has the unit mm; a column u is written in V here"),
        ("counts", "is a pure number; a column u is written in V here"),
        ("plse * 2", "plse is no variable of the files, nor in [variables] or [constants]; did you mean pulse?"),
        ("kv * qg", "has the unit mm*s*V/m"),
        ("pulse / (counts - counts)", "is infinite at sample 1; does it divide by zero?"),
        ("kv / kv * 9 ** 9 ** 9 * pulse", "gives no finite number in 9 ** 9 ** 9"),
        ("3e-3 * kv * kp * (1 / kp)", "has the unit s*V/m"),
        ("open('/etc/passwd')", "has \"open('/etc/passwd')\" in it; a formula has numbers, names, + - * / **"),
        ("().__class__", "has '()' in it; a formula has"),
        ("qg.__class__.__mro__", "qg.__class__.__mro__ is no variable of the files"),
        ("[qg for qg in qg]", "has '[qg for qg in qg]' in it"),
        ("lambda: qg", "has 'lambda: qg' in it"),
        ("qg if pulse else qg", "has 'qg if pulse else qg' in it"),
        ("qg @ qg", "has 'qg @ qg' in it"),
        ("~pulse", "has '~pulse' in it"),
        ("abs(pulse, qg)", "has 'abs(pulse, qg)' in it"),
        ("True * pulse", "has True in it"),
        ("pulse +", "is no formula; write for example a + 2 * b"),
        ("(" * 200, "is no formula"),
        ("-" * 499 + "1", "is a pure number"),
        ("1 + " * 200 + "1", "is longer than 500 characters"),
    ],
)
def test_formulas_that_are_refused(formula: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        mapped(tmp_path, formula)
    assert str(caught.value).startswith(f"{tmp_path}/map.toml: run 1.columns.u.formula = ")
    assert message in str(caught.value)
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kp = "160.18 1/s"', 'kp = "160.18 ls/q"', "constants.kp = 160.18 ls/q: unknown unit 'ls/q'"),
        ('kp = "160.18 1/s"', 'kp = "nan V"', "constants.kp = nan V: is not a finite number"),
        ('kp = "160.18 1/s"', "kp = true", "constants.kp = true: is not a number with a unit"),
        ('kp = "160.18 1/s"', 'kp = "20 degC"', "constants.kp = 20 degC: 'degC' does not count from zero; use 'K'"),
        ("kp =", "sin =", "constants.sin: is no name for a formula"),
        ("kp =", "qg =", "variables.qg: is the name of a constant as well"),
        ("[variables.counts]", "[variables.z]", "variables.counts.unit: is missing"),
        ('variable = "force pulse"', 'variable = "force"', ""),
        ('[variables.counts]\nunit = "1"', "", "variables.counts.unit: is missing, and the file does not say it"),
        ('unit = "V"\nformula', "formula", "run 1.columns.u.unit: is missing; say in which unit the column is to be"),
        ('unit = "V"\nformula', 'unit = "V"\nscale = 2\nformula', "run 1.columns.u.scale = 2: conflicts with a formula"),  # noqa: E501
    ],
)  # fmt: skip
def test_maps_that_are_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    formula = "pulse" if "force" in old else "counts"
    with pytest.raises(InputError) as caught:
        mapped(tmp_path, formula, old, new)
    assert str(caught.value).startswith(f"{tmp_path}/map.toml: {message}")
    if "force" in old:
        assert "variables.pulse.variable = force: is no variable of log.npz; did you mean force pulse?" in str(
            caught.value
        )


def test_what_a_formula_asks_for_is_in_its_order() -> None:
    assert arithmetic.parse("b * a + rig.u / b").names == ("b", "a", "rig.u")


def test_units_are_converted_not_assumed() -> None:
    known = {"a": units.quantity(np.array([1.0, 2.0]), "um"), "b": units.quantity(3.0, "nm/V")}
    found = arithmetic.parse("a / b").evaluate(known).to("V").magnitude
    assert found == pytest.approx([1e3 / 3, 2e3 / 3], rel=1e-12)
