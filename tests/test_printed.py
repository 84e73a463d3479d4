"""The printed numbers of the paper: none changes unnoticed, here or in a study that repeats it."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path
from typing import Any

import pytest

from flexdesign.core import printed_numbers, units
from flexdesign.core.errors import InputError
from flexdesign.dynamics import experiments
from flexdesign.dynamics.experiments import MEASURES, Published

ROOT = Path(__file__).resolve().parent.parent
STUDIES = ROOT / "studies"
PAPER = printed_numbers.read(STUDIES / "lin2019.toml")
FIG_7, FIG_9, FIG_13 = "section 4.2, Fig 7", "section 4.2, Figs 9 to 11", "section 4.3.2, Fig 13"
FIG_14, FIG_16 = "section 4.3.2, Figs 14 and 15", "section 4.3.2, Figs 16 and 17"
FIG_18, FIG_19 = "section 4.3.2, Fig 18", "section 4.3.2, Fig 19"

#: Of all places, names and numbers, as they were compared with the paper.
SUM = "0653410e6d5b9af82066f5bb17307efd8225f31e87f6a7d35d95cd6ab031488e"

#: Rows of the experiments by experiment, measure and axis.
ROWS = {
    ("P8 X", "loop_span", "x"): (FIG_7, "span_xy"),
    ("P8 X", "secant_gain", "x"): (FIG_7, "slope_xy"),
    ("P8 Z", "loop_span", "z"): (FIG_7, "span_z"),
    ("P8 Z", "secant_gain", "z"): (FIG_7, "slope_z"),
    ("P11 X", "coupling", "y"): (FIG_9, "coupling_y_x"),
    ("P11 X", "coupling", "z"): (FIG_9, "coupling_z_x"),
    ("P11 Z", "coupling", "x"): (FIG_9, "coupling_x_z"),
    ("P16", "overshoot", "x"): (FIG_13, "overshoot"),
    ("P16", "settling_time", "x"): (FIG_13, "settling"),
    ("P17 X", "max_error_relative", "x"): (FIG_14, "error_xy"),
    ("P17 Z", "max_error_relative", "z"): (FIG_14, "error_z"),
    ("P18 X", "max_error", "x"): (FIG_16, "error_xy"),
    ("P18 X", "max_error_relative", "x"): (FIG_16, "relative_xy"),
    ("P18 Z", "max_error", "z"): (FIG_16, "error_z"),
    ("P18 Z", "max_error_relative", "z"): (FIG_16, "relative_z"),
    ("P19", "max_contour_error", "all axes"): (FIG_18, "error"),
    ("P20", "max_contour_error", "all axes"): (FIG_19, "error"),
}
#: Motions that a relative number is part of, and the motions whose uncertainty its own is.
MOVED = {
    ("P11 X", "coupling", "y"): ("moved_y_x", "travel_x"),
    ("P11 X", "coupling", "z"): ("moved_z_x", "travel_x"),
    ("P11 Z", "coupling", "x"): ("moved_x_z", "travel_z"),
}
#: Rows of Table 1 by column and key.
TABLE_1 = {
    f"{quantity}_{axis}_{boundary}": f"{quantity}_{'xy' if axis == 'x' else 'z'}"
    for quantity, boundary in (("K_out", "inputs_free"), ("K_in", "table_free"))
    for axis in "xz"
} | {f"coupling_{to}_x_input_of_20_um": f"coupling_{to}_x" for to in "yz"}
MEASURED = {
    f"{name}_{axis}_{boundary}": f"travel_{axis}"
    for name, boundary in (("stroke", "table_free"), ("travel", "input_of_40_um"))
    for axis in "xz"
} | {f"coupling_{to}_{axis}_input_of_40_um": f"coupling_{to}_{axis}" for to, axis in ("yx", "zx", "xz")}


def number(place: str, name: str, si: str) -> float:
    return PAPER(place, name).value(si)


def known(motion: float) -> float:
    """Return how well a motion [m] is known: the sensor's resolution, and a slope of its nonlinearity.

    A parabola through both ends of the range that is `linearity` high in the middle has the slope 4 linearity / range.
    """
    span = number("section 4.1", "sensor_range", "m")
    resolution = number("section 4.1", "sensor_resolution", "1") * span
    slope = 4 * number("section 4.1", "sensor_linearity", "1")
    assert (resolution, slope) == pytest.approx((0.75e-6, 0.012))
    return resolution + slope * motion


def published() -> list[tuple[str, Published]]:
    plan = experiments.read(STUDIES / "lin2019_experiments.toml", ["x", "y", "z"])
    return [(e.name, entry) for e in plan.experiments for entry in e.published]


def table_1() -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = tomllib.loads((STUDIES / "table1.toml").read_text(encoding="utf-8"))["published"]
    return found


def test_no_printed_number_changes_unnoticed() -> None:
    """Whoever has the paper open and corrects a number or a place changes this sum too."""
    lines = [f"{p.place}: {p.name} = {p.text}" for p in PAPER.printed.values()]
    assert len(lines) == 74
    assert hashlib.sha256("\n".join(lines).encode()).hexdigest() == SUM


@pytest.mark.parametrize(("name", "entry"), published(), ids=lambda each: getattr(each, "value", each))
def test_every_row_of_the_experiments_is_printed(name: str, entry: Published) -> None:
    si = MEASURES[entry.measure]
    if (name, entry.value) == ("P16", "200 ms"):  # what "more than 50 % shorter" leaves of 0.4 s
        shorter = number(FIG_13, "shorter", "1")
        assert entry.bound == "below" and entry.si == pytest.approx((1 - shorter) * number(FIG_13, "settling", "s"))
        return
    place, key = ROWS[name, entry.measure, entry.axis]
    assert entry.si == pytest.approx(number(place, key, si), rel=1e-12)
    assert place.split(", ")[0].startswith(entry.place.split(", ")[0]) or entry.place.startswith("Fig")


@pytest.mark.parametrize(("name", "entry"), published(), ids=lambda each: getattr(each, "value", each))
def test_an_uncertainty_is_the_sensors(name: str, entry: Published) -> None:
    """To two digits; zero lies outside of it wherever a motion was measured that the sensor resolves."""
    if not entry.uncertainty:
        return
    key = (name, entry.measure, entry.axis)
    if entry.measure == "secant_gain":
        expected = known(entry.si * 120) / 120
    elif key in MOVED:
        aside, along = (number(FIG_9, each, "m") for each in MOVED[key])
        expected = known(aside) / along
    else:
        expected = known(entry.si)
    assert entry.half_width == pytest.approx(expected, rel=0.03)
    assert entry.si > 2 * (entry.half_width or 0.0)


def test_table_1_is_printed() -> None:
    columns = table_1()
    for column, place in (("paper: model", "Table 1, model"), ("paper: FEA", "Table 1, FEA")):
        assert columns[column].keys() == TABLE_1.keys()
        for key, text in columns[column].items():
            assert text == PAPER(place, TABLE_1[key]).text, (column, key)


def test_the_measured_column_of_table_1_is_printed_and_no_coupling_contains_zero() -> None:
    column = table_1()["paper: measured"]
    assert column.keys() == MEASURED.keys()
    for key, text in column.items():
        value, _, spread = text.partition(" ± ")
        si = "1" if key.startswith("coupling") else "m"
        own = PAPER(FIG_9, MEASURED[key])
        assert value == own.text.split()[0], key
        if si == "m":
            expected = known(own.value(si))
        else:
            to, axis = MEASURED[key].split("_")[1:]
            expected = known(number(FIG_9, f"moved_{to}_{axis}", "m")) / number(FIG_9, f"travel_{axis}", "m")
        assert units.from_text(spread, si) == pytest.approx(expected, rel=0.03), key
        assert own.value(si) > 2 * expected


def test_the_columns_from_31_follow_from_it() -> None:
    """Mass K t1 t2 and frequency 1 / 2 pi sqrt(t1 t2), to the digits that are written."""
    column = table_1()["paper: (31)"]
    for axis, name in (("x", "xy"), ("z", "z")):
        t1, t2 = (number("eq (31)", f"{t}_{name}", "s") for t in ("t1", "t2"))
        mass = number("Table 1, model", f"K_out_{name}", "N/m") * t1 * t2
        assert units.from_text(column[f"output_mass_{axis}_inputs_free"], "kg") == pytest.approx(mass, abs=5e-5)
        frequency = 1 / (2 * 3.141592653589793 * (t1 * t2) ** 0.5)
        text = column[f"output_frequency_{axis}_inputs_free"]
        assert units.from_text(text, "Hz") == pytest.approx(frequency, abs=0.05)


@pytest.mark.parametrize("name", ["lin2019_targets", "lin2019_stage_targets"])
def test_targets_are_printed(name: str) -> None:
    targets: dict[str, Any] = tomllib.loads((STUDIES / f"{name}.toml").read_text(encoding="utf-8"))["targets"]
    model = "Table 1, model"
    if name == "lin2019_targets":
        found = {
            targets[axis][key]: PAPER(model, f"{q}_{axis}").text
            for axis in ("xy", "z")
            for key, q in (("output_stiffness", "K_out"), ("input_stiffness", "K_in"))
        }
        assert {axis: str(targets[axis]["gain"]) for axis in ("xy", "z")} == {
            axis: PAPER("eq (31)", f"gain_{axis}").text for axis in ("xy", "z")
        }
        arms = targets["coupling"]
    else:
        formulas, elements, arms = targets["formulas"], targets["elements"], targets["arms"]
        found = {formulas[key]: PAPER(model, TABLE_1[key]).text for key in formulas if key in TABLE_1}
        assert len(found) == 4
        assert formulas["lambda_x_table_free"] == PAPER("eq (31)", "gain_xy").text
        found |= {text: PAPER("Table 1, FEA", TABLE_1[key]).text for key, text in elements.items() if key in TABLE_1}
        for axis in "xz":
            asked = elements[f"stroke_{axis}_table_free"].split(" ± ")[0]
            assert asked == PAPER(FIG_9, f"travel_{axis}").text.split()[0]
    assert all(text == own for text, own in found.items())
    assert arms["input_stroke"] == PAPER("Figs 4 and 5", "input_xy").text
    assert [arms["y_from_x"], arms["z_from_x"]] == [PAPER(model, f"coupling_{to}_x").text for to in "yz"]


def test_inputs_and_signals_of_the_experiments_are_printed() -> None:
    content = tomllib.loads((STUDIES / "lin2019_experiments.toml").read_text(encoding="utf-8"))
    by_name = {each["name"]: each for each in content["experiment"]}
    for name in ("P8 X", "P8 Z"):
        command = by_name[name]["command"]
        assert (command["high"], command["frequency"]) == (PAPER(FIG_7, "voltage").text, PAPER(FIG_7, "frequency").text)
    for name, axis in (("P11 X", "x"), ("P11 Z", "z"), ("P18 X", "x"), ("P18 Z", "z")):
        assert by_name[name]["reference"]["high"] == PAPER(FIG_9, f"travel_{axis}").text
        assert by_name[name]["reference"]["frequency"] == PAPER(FIG_16, "frequency").text
    for name, end in (("P19", PAPER(FIG_18, "end").text), ("P20", PAPER(FIG_19, "end").text)):
        reference = by_name[name]["reference"]
        assert set(reference["points"][1]) == {end}
        assert reference["velocity"] == PAPER(FIG_18, "velocity").text
    for name, axis in (("P16", "xy"), ("P17 X", "xy"), ("P16 Z", "z"), ("P17 Z", "z")):
        reference = by_name[name]["reference"]
        size = number(FIG_14, "input", "m") * number("eq (31)", f"gain_{axis}", "1")
        assert units.from_text(reference["target" if "target" in reference else "high"], "m") == pytest.approx(size)
    for axis, name in (("x", "xy"), ("y", "xy"), ("z", "z")):
        gains = content["controllers"]["printed"]["axis"][axis]
        assert str(gains["kp"]) == PAPER("eq (34)", f"kp_{name}").text
        assert str(gains["plant_gain"]) == PAPER("eq (31)", f"gain_{name}").text
        for key in ("ti", "td"):
            assert units.from_text(gains[key], "s") == pytest.approx(number("eq (34)", f"{key}_{name}", "s"))


def test_the_sensor_and_the_stack_of_the_stage_model_are_printed() -> None:
    axes = tomllib.loads((STUDIES / "lin2019_stage.toml").read_text(encoding="utf-8"))["axis"]
    span = number("section 4.1", "sensor_range", "m")
    for axis in axes.values():
        sensor, actuator = axis["sensor"], axis["actuator"]
        assert units.from_text(sensor["range"][1], "m") == span
        for key in ("resolution", "linearity"):
            share = number("section 4.1", f"sensor_{key}", "1")
            assert units.from_text(sensor[key], "m") == pytest.approx(share * span)
        assert actuator["stiffness"] == PAPER("section 4.1", "actuator_stiffness").text
        assert actuator["free_stroke"] == PAPER(FIG_9, "input").text


def test_one_actuator_has_one_description() -> None:
    """All files of this paper state the same stroke over the same voltages."""
    found = set()
    for file in ("lin2019_xyz_stage", "lin2019_amplifier_xy", "lin2019_amplifier_z"):
        actuator = tomllib.loads((ROOT / "geometry" / f"{file}.toml").read_text(encoding="utf-8"))["actuator"]
        found.add((actuator["free_stroke"], tuple(actuator["voltage_range"]), actuator["stiffness"]))
    axes = tomllib.loads((STUDIES / "lin2019_stage.toml").read_text(encoding="utf-8"))["axis"]
    for axis in axes.values():
        actuator = axis["actuator"]
        found.add((actuator["free_stroke"], tuple(actuator["voltage_range"]), actuator["stiffness"]))
    assert len(found) == 1


def test_the_printed_numbers_that_repeat_each_other_do() -> None:
    """Errors of Table 1, slopes of Fig 7, ratios of Figs 9 to 11: recomputed to the digits that are printed."""
    for key in ("K_out_xy", "K_out_z", "K_in_xy", "K_in_z"):
        model, fea, error = (PAPER(f"Table 1, {row}", key) for row in ("model", "FEA", "error"))
        si = "N/m"
        off = abs(model.value(si) / fea.value(si) - 1)
        assert off == pytest.approx(error.value("1"), abs=1.01 * error.half_digit("1"))
    for axis in ("xy", "z"):
        slope = number(FIG_7, f"span_{axis}", "m") / number(FIG_7, "voltage", "V")
        assert slope == pytest.approx(number(FIG_7, f"slope_{axis}", "m/V"), abs=0.005e-6)
    for to, axis in ("yx", "zx", "xz"):
        ratio = number(FIG_9, f"moved_{to}_{axis}", "m") / number(FIG_9, f"travel_{axis}", "m")
        assert ratio == pytest.approx(number(FIG_9, f"coupling_{to}_{axis}", "1"), abs=0.51e-4)


def test_refusals_name_the_place(tmp_path: Path) -> None:
    text = (STUDIES / "lin2019.toml").read_text(encoding="utf-8")
    file = tmp_path / "other.toml"
    file.write_text(text.replace('order = "1"', "order = 1"), encoding="utf-8")
    with pytest.raises(InputError, match=r"printed\.eq \(28\)\.order"):
        printed_numbers.read(file)
    with pytest.raises(InputError, match="lin2019"):
        printed_numbers.read("lin2018")
