"""A study of experiments that cannot be used is refused in one line: file, field, value and remedy; nothing is written.

Every case runs `flexdesign simulate` on a small stage and a small study, of which one thing was changed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flexdesign.core.errors import InputError
from flexdesign.dynamics import experiments
from flexdesign.dynamics.experiments import Gains

Run = Callable[..., Any]

MODEL = """\
format = 1

[axis.x]
natural_frequency = "100 Hz"
damping_ratio = 0.1
gain = "2 um/V"
hysteresis = { model = "bouc-wen", a = "0.4 um/V", b = "0.02 1/V", c = "0.005 1/V", n = 1 }

[axis.x.actuator]
free_stroke = "40 um"
voltage_range = ["0 V", "100 V"]

[axis.y]
natural_frequency = "80 Hz"
damping_ratio = 0.2
gain = "1 um/V"
"""

REFERENCE = 'reference = { shape = "step", start = "0 um", target = "10 um", wait = "5 ms", hold = "50 ms" }'
COMMAND = 'command = { shape = "sine", low = "0 V", high = "50 V", frequency = "20 Hz", cycles = 1 }'
STUDY = f"""\
format = 1

[variants.soft]
set = ["axis.x.damping_ratio=0.05"]

[controllers.mine.axis.x]
kp = "0.01 V/um"
ti = "5 ms"
td = "0 ms"

[[experiment]]
name = "first"
axes = ["x"]
{REFERENCE}
controllers = ["open loop", "mine"]
variants = ["as modelled", "soft"]

[[experiment]]
name = "second"
axes = ["x"]
{COMMAND}
"""
HEAD = '[[experiment]]\nname = "second"'


def changed(text: str, old: str, new: str) -> str:
    """Return a text with one occurrence of `old` replaced; it must be there."""
    assert old in text
    return text.replace(old, new, 1)


def contents(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def assert_refused(ended: Any, *named: str) -> None:
    """Assert exit code 2 and one message at the end of stderr, progress alone before it."""
    assert (ended.code, ended.stdout) == (2, ""), ended.stderr
    *before, last = ended.stderr.splitlines()
    assert last.startswith("flexdesign: ")
    assert all(line.lstrip()[:1].isdigit() for line in before), ended.stderr
    assert "Traceback" not in ended.stderr
    for words in named:
        assert words in last


def published(entry: str) -> tuple[str, str]:
    return REFERENCE, f'{REFERENCE}\npublished = [{{ place = "Fig 1", {entry} }}]'


#: id: (what is replaced in the study, by what, what the one line names: place and value, remedy)
STUDIES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "unknown key": ("format = 1", "format = 1\nrobustms = 1.6", ("robustms = 1.6", "did you mean robust_ms?")),
    "unknown key of an experiment": (
        'name = "first"', 'name = "first"\ncontroler = "mine"',
        ("experiment 1.controler = mine", "did you mean controllers?"),
    ),
    "unknown shape": ('shape = "step"', 'shape = "stp"', ("experiment 1.reference.shape = stp", "did you mean step?")),
    "unknown key of a shape": ('hold = "50 ms"', 'hld = "50 ms"', ("reference.hld = 50 ms", "did you mean hold?")),
    "unknown controller": (
        '"mine"]', '"mien"]', ("experiment 1 (first).controllers = mien", "did you mean mine?"),
    ),
    "nothing after a plus": ('"mine"]', '"mine +"]', ('controllers = ""', "is not a known controller")),
    "unknown variant": ('"soft"]', '"sofd"]', ("experiment 1 (first).variants = sofd", "did you mean soft?")),
    "unknown axis": (
        'axes = ["x"]\nref', 'axes = ["xx"]\nref', ("(first).axes = xx", "axis of the stage model; did you mean x?"),
    ),
    "unknown measure": (
        *published('measure = "overshot", value = "3 um"'),
        ("experiment 1.published 1.measure = overshot", "did you mean overshoot?"),
    ),
    "published in another unit": (
        *published('measure = "overshoot", value = "3 ms"'), ("published 1.value = 3 ms", "not a unit of length"),
    ),
    "published NaN": (
        *published('measure = "overshoot", value = "nan um"'), ("published 1.value = nan um", "not a finite number"),
    ),
    "published uncertainty without unit": (
        *published('measure = "overshoot", value = "3 um", uncertainty = "1"'),
        ("published 1.uncertainty", "the unit is missing"),
    ),
    "published for an unknown axis": (
        *published('measure = "overshoot", value = "3 um", axis = "w"'),
        ("experiment 1 (first).published 1.axis = w", "known: x, y, all axes"),
    ),
    "published for a controller that is not tried": (
        *published('measure = "overshoot", value = "3 um", controller = "robust"'),
        ("published 1.controller = robust", "not a controller of this experiment; known: open loop, mine"),
    ),
    "published without place": (
        REFERENCE, f'{REFERENCE}\npublished = [{{ measure = "overshoot", value = "3 um" }}]',
        ("experiment 1.published 1.place", "is missing; write for example place"),
    ),
    "command and reference": (COMMAND, f"{COMMAND}\n{REFERENCE}", ("experiment 2", "keep one of them")),
    "neither": (COMMAND, "", ("experiment 2", "neither a command, in volts, nor a reference")),
    "reference in volts": (
        REFERENCE, REFERENCE.replace("um", "V"), ("experiment 1.reference", "is in volts", "or name it command"),
    ),
    "command in metres": (
        COMMAND, COMMAND.replace(" V", " um"), ("experiment 2.command", "is in metres", "or name it reference"),
    ),
    "volts and metres": ('target = "10 um"', 'target = "10 V"', ("experiment 1.reference", "mixes volts and metres")),
    "more axes than named": (
        COMMAND, 'command = { shape = "line", points = [["0 V", "0 V"], ["9 V", "9 V"]], velocity = "100 V/s" }',
        ("experiment 2.command", "moves 2 axes, and axes names 1 (x)"),
    ),
    "controllers for a command": (
        COMMAND, f'{COMMAND}\ncontrollers = ["mine"]', ("experiment 2", "controllers, which need a reference"),
    ),
    "kp without unit": ('kp = "0.01 V/um"', "kp = 0.01", ("controllers.mine.axis.x.kp = 0.01", "needs plant_gain")),
    "kp with unit and plant": (
        'kp = "0.01 V/um"', 'kp = "0.01 V/um"\nplant_gain = 6', ("axis.x.kp = 0.01 V/um", "leave one of them out"),
    ),
    "kp NaN": ('kp = "0.01 V/um"', 'kp = "nan V/um"', ("axis.x.kp = nan V/um", "not a finite number")),
    "kp of another unit": ('kp = "0.01 V/um"', 'kp = "0.01 V/s"', ("axis.x.kp = 0.01 V/s", "is wrong here")),
    "kp that is no number": ('kp = "0.01 V/um"', "kp = true", ("axis.x.kp = true", "is not a number; allowed")),
    "no kp": ('kp = "0.01 V/um"', "", ("axis.x.kp", 'is missing; write for example kp = "0.05 V/um"')),
    "ti of zero": ('ti = "5 ms"', 'ti = "0 ms"', ("axis.x.ti = 0 ms", "allowed: more than 0")),
    "negative ti": ('ti = "5 ms"', 'ti = "-5 ms"', ("axis.x.ti = -5 ms", "allowed: more than 0")),
    "negative td": ('td = "0 ms"', 'td = "-1 ms"', ("axis.x.td = -1 ms", "allowed: 0 to")),
    "td without unit": ('td = "0 ms"', "td = 1", ("axis.x.td = 1", "the unit is missing")),
    "NaN in a command": ('high = "50 V"', 'high = "nan V"', ("experiment 2.command.high = nan V", "a finite number")),
    "infinite reference": ('target = "10 um"', 'target = "inf um"', ("reference.target = inf um", "a finite number")),
    "sampling too coarse": (
        'frequency = "20 Hz"', 'frequency = "800 Hz"',
        ("study.toml: experiment 2 (second).command", "sampling period of 1.000 ms", "every 0.6250 ms or less"),
    ),
    "too short": (
        REFERENCE, 'reference = { shape = "hold", level = "3 um", time = "1 ms" }',
        ("experiment 1 (first).reference", "over after 2 samples of 1 ms; make it longer"),
    ),
    "endless": ("cycles = 1 ", "cycles = 1e8 ", ("experiment 2 (second).command", "gives 5e+09 samples")),
    "two of one name": ('name = "second"', 'name = "first"', ("experiment 2 (first).name = first", "is used twice")),
    "two whose figures have one name": (
        'name = "second"', 'name = "First soft"',
        ("experiment 2 (First soft).name = First soft", "names the same figures as first"),
    ),
    "no name": ('name = "second"', "", ("experiment 2.name", 'is missing; write for example name = "step"')),
    "empty name": ('name = "second"', 'name = ""', ('experiment 2.name = ""', "needs a letter or a digit")),
    "no axes": ('axes = ["x"]\ncom', "com", ("experiment 2.axes", 'is missing; write for example axes = ["x"]')),
    "none of the axes": ('axes = ["x"]\nref', "axes = []\nref", ("experiment 1.axes = []", "name one or more")),
    "axes not in a list": ('axes = ["x"]\nref', 'axes = "x"\nref', ("experiment 1.axes = x", "expected a list")),
    "an axis twice": ('axes = ["x"]\nref', 'axes = ["x", "x"]\nref', ("experiment 1.axes", "names x twice")),
    "no controllers": ('["open loop", "mine"]', "[]", ("experiment 1.controllers = []", "name one or more")),
    "a controller twice": ('["open loop", "mine"]', '["mine", "mine"]', ("1.controllers", "names mine twice")),
    "no variants": ('["as modelled", "soft"]', "[]", ("experiment 1.variants = []", "name one or more")),
    "two feedbacks": ('"mine"]', '"mine + robust"]', ("(first).controllers = mine + robust", "joins two of a kind")),
    "two commands": (
        '"mine"]', '"open loop + feedforward"]', ("controllers = open loop + feedforward", "joins two of a kind"),
    ),
    "gains for another axis": (
        'axes = ["x"]\nref', 'axes = ["y"]\nref',
        ("controllers = mine", "no gains for axis y; add [controllers.mine.axis.y]"),
    ),
    "a controller of a known name": ("rs.mine", "rs.robust", ("controllers.robust", "choose another")),
    "a controller with a plus": ("controllers.mine", 'controllers."a + b"', ("controllers.a + b", "choose another")),
    "a variant of a known name": (
        "variants.soft", 'variants."as modelled"', ("variants.as modelled", "choose another"),
    ),
    "a variant of unknown keys": (
        "axis.x.damping_ratio=", "axis.x.damping=", ("axis.x.damping=0.05", "did you mean damping_ratio"),
    ),
    "a variant of an unknown axis": (
        "axis.x.damping_ratio=", "axis.w.damping_ratio=", ("axis.w.damping_ratio=0.05", "there is no axis w"),
    ),
    "a variant that is impossible": ("ratio=0.05", "ratio=-1", ("axis.x.damping_ratio=-1", "allowed: 0 to 100")),
    "a variant without equals sign": ("ratio=0.05", "ratio", ("axis.x.damping_ratio", 'table.key="value unit"')),
    "a variant that is no list": (
        '["axis.x.damping_ratio=0.05"]', '"axis.x.damping_ratio=0.05"', ("variants.soft.set", "expected a list"),
    ),
    "a variant of misspelt set": ("set =", "sets =", ("variants.soft.sets", "did you mean set?")),
    "a variant that is no table": ("[variants.soft]\nset", "[variants]\nsoft", ("variants.soft", "expected a table")),
    "format": ("format = 1", "format = 2", ("format = 2", "this version reads format = 1")),
    "no format": ("format = 1\n", "", ("format", "is missing; write format = 1")),
    "one experiment that is no list": (
        STUDY[STUDY.index("[[experiment]]") :], "[experiment]\nname = 'first'\n", ("experiment", "[[experiment]]"),
    ),
    "no experiment": (STUDY[STUDY.index("[[experiment]]") :], "", ("experiment", "is missing", "[[experiment]]")),
    "no TOML": ("format = 1", "format 1", ("study.toml", "is not valid TOML")),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "named"), STUDIES.values(), ids=STUDIES)
def test_a_bad_study_ends_in_one_line(
    tmp_path: Path, command_line: Run, old: str, new: str, named: tuple[str, ...]
) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "study.toml").write_text(changed(STUDY, old, new))
    assert_refused(command_line("simulate", "model.toml", "study.toml", "--out", "report"), "study.toml", *named)
    assert contents(tmp_path) == {"model.toml", "study.toml"}


def test_an_empty_study_is_refused(tmp_path: Path, command_line: Run) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "study.toml").touch()
    ended = command_line("simulate", "model.toml", "study.toml")
    assert_refused(ended, "study.toml: is empty; it needs format, experiment")
    assert contents(tmp_path) == {"model.toml", "study.toml"}


#: id: (rows of u.csv, or None for no such file; what the one line names)
RECORDINGS: dict[str, tuple[str | None, tuple[str, ...]]] = {
    "NaN": ("t [s],u [V]\n0,0\n0.01,nan\n0.02,0\n", ("u.csv: line 3, column u = nan", "correct the cell")),
    "no such file": (None, ("u.csv", "cannot be read: No such file")),
    "no such column": ("t [s],v [V]\n0,0\n0.01,5\n", ("u.csv: header", "there is no column u [V]; found v [V]")),
    "another unit": ("t [s],u [um]\n0,0\n0.01,5\n", ("u.csv: header", "there is no column u [V]; found u [um]")),
    "time that falls": ("t [s],u [V]\n0,0\n0.02,5\n0.01,0\n", ("line 4, column t = 0.01 s", "not later than the row")),
    "one row": ("t [s],u [V]\n0,0\n", ("u.csv", "needs at least two")),
}  # fmt: skip


@pytest.mark.parametrize(("rows", "named"), RECORDINGS.values(), ids=RECORDINGS)
def test_a_bad_recording_is_refused_before_anything_runs(
    tmp_path: Path, command_line: Run, rows: str | None, named: tuple[str, ...]
) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "study.toml").write_text(
        changed(STUDY, COMMAND, 'command = { shape = "csv", file = "u.csv", column = "u [V]" }')
    )
    if rows is not None:
        (tmp_path / "u.csv").write_text(rows)
    before = contents(tmp_path)
    ended = command_line("simulate", "model.toml", "study.toml", "--out", "report")
    assert_refused(ended, *named)
    assert len(ended.stderr.splitlines()) == 1  # not even the first experiment was begun
    assert contents(tmp_path) == before


def test_a_recording_of_uneven_time_is_taken_as_straight_lines(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(
        changed(STUDY, COMMAND, 'command = { shape = "csv", file = "u.csv", column = "u [V]" }')
    )
    (tmp_path / "u.csv").write_text("t [s],u [V]\n1,0\n1.01,5\n1.05,1\n")
    plan = experiments.read(tmp_path / "study.toml", ["x", "y"])
    sampled = plan.experiments[1].trajectory.sampled(5e-3)
    assert sampled == pytest.approx([0, 2.5, 5, 4.5, 4, 3.5, 3, 2.5, 2, 1.5, 1])


# --- the stage model ----------------------------------------------------------------------------------------------

RANGE = 'voltage_range = ["0 V", "100 V"]\n'

#: id: (what is replaced in the model, by what, what the one line names); without a study
MODELS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "no damping": ("damping_ratio = 0.1\n", "", ("model.toml: axis.x.damping_ratio", "is missing")),
    "no gain": ('gain = "2 um/V"\n', "", ("model.toml: axis.x.gain", 'for example gain = "1.5 um/V"')),
    "unknown gain": (
        'gain = "2 um/V"', 'gain = "nan um/V"', ("model.toml: axis.x.gain = nan um/V", "not a finite number"),
    ),
    "no range of voltage": (RANGE, "", ("model.toml: axis.x.actuator.voltage_range", "is missing", "or name a study")),
    "no actuator": ("\n[axis.y]", "\n[axis.z]", ("model.toml: axis.z.actuator.voltage_range", "is missing")),
    "a range that holds no rest": (
        '"0 V", ', '"20 V", ',
        ("model.toml: axis.x.actuator.voltage_range = 20 V to 100 V", "does not hold zero volts", "name a study"),
    ),
    "an angle": ('gain = "2 um/V"\nhyst', 'gain = "2 urad/V"\n#', ("model.toml: axis.x.gain = rad", "is no length")),
    "a slow clock": (
        "format = 1", 'format = 1\n\n[controller]\nrate = "1 Hz"',
        ("standard experiments: experiment 1 (hysteresis x).command", "sampling period of 1000 ms cannot follow"),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "named"), MODELS.values(), ids=MODELS)
def test_a_bad_model_ends_in_one_line(
    tmp_path: Path, command_line: Run, old: str, new: str, named: tuple[str, ...]
) -> None:
    one_axis = MODEL if "axis.z" in new else MODEL[: MODEL.index("\n[axis.y]")]
    (tmp_path / "model.toml").write_text(changed(one_axis, old, new))
    ended = command_line("simulate", "model.toml", "--out", "report")
    assert_refused(ended, *named)
    assert contents(tmp_path) == {"model.toml"}


@pytest.mark.parametrize("slope", ["2 um/V", "2.5 um/V"])
def test_a_hysteresis_that_has_no_inverse_is_refused_under_feedforward(
    tmp_path: Path, command_line: Run, slope: str
) -> None:
    (tmp_path / "model.toml").write_text(changed(MODEL, 'a = "0.4 um/V"', f'a = "{slope}"'))
    (tmp_path / "study.toml").write_text(changed(STUDY, '"mine"]', '"feedforward"]'))
    ended = command_line("simulate", "model.toml", "study.toml", "--out", "report")
    assert_refused(ended, f"model.toml: axis.x.hysteresis.a = {slope}", "a >= k_v", "there is no inverse")
    assert contents(tmp_path) == {"model.toml", "study.toml"}


# --- arguments ----------------------------------------------------------------------------------------------------

#: id: (arguments, what the one line names)
ARGUMENTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "override of an unknown key": (("--set", "axis.x.damping=1"), ("command line: axis.x.damping = 1", "known key")),
    "override of an unknown table": (("--set", "robust=1.6"), ("command line: robust = 1.6", "is not a known key")),
    "override of an unknown axis": (("--set", "axis.w.gain=1 um/V"), ("axis.w.gain = 1 um/V", "there is no axis w")),
    "override out of bounds": (("--set", "robust_ms=0.5"), ("command line: robust_ms = 0.5", "allowed: 1.05 to 5")),
    "override that is no switch": (("--set", "cycled=maybe"), ("command line: cycled = maybe", "true or false")),
    "override without value": (("--set", "cycled"), ("command line: --set = cycled", "table.key=")),
    "report folder is a file": (("--out", "model.toml"), ("command line: --out = model.toml", "it is a file")),
    "unwritable report folder": (("--out", "/proc/report"), ("--out = /proc/report", "cannot be written")),
    "unknown option": (("--seed", "1"), ("--seed", "simulate --help")),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "named"), ARGUMENTS.values(), ids=ARGUMENTS)
def test_bad_arguments_end_in_one_line(
    tmp_path: Path, command_line: Run, arguments: tuple[str, ...], named: tuple[str, ...]
) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "study.toml").write_text(STUDY)
    ended = command_line("simulate", "model.toml", "study.toml", *arguments)
    assert_refused(ended, *named)
    assert contents(tmp_path) == {"model.toml", "study.toml"}


def test_a_setting_of_a_study_needs_one(tmp_path: Path, command_line: Run) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    ended = command_line("simulate", "model.toml", "--set", "robust_ms=1.3")
    assert_refused(ended, "command line: --set = robust_ms=1.3", "name the study")
    assert contents(tmp_path) == {"model.toml"}


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("lin2019_stag",), ("MODEL = lin2019_stag", "did you mean lin2019_stage?")),
        (("none.toml",), ("MODEL = none.toml", "no such stage model")),
        (("lin2019_stage", "lin2019_experiment"), ("STUDY = lin2019_experiment", "did you mean lin2019_experiments?")),
        (("lin2019_stage", "none.toml"), ("STUDY = none.toml", "no such study of experiments")),
    ],
)
def test_a_name_that_is_not_there_gets_a_suggestion(
    tmp_path: Path, command_line: Run, arguments: tuple[str, ...], named: tuple[str, ...]
) -> None:
    assert_refused(command_line("simulate", *arguments), *named)
    assert contents(tmp_path) == set()


# --- what is read -------------------------------------------------------------------------------------------------


def test_what_the_tables_say_is_read(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(
        changed(STUDY, *published('measure = "settling_time", value = "0.2 s", uncertainty = "5 ms", axis = "x"'))
    )
    plan = experiments.read(tmp_path / "study.toml", ["x", "y"], ["robust_ms=1.8", "cycled=false"])
    assert (plan.name, plan.robust_ms, plan.cycled, plan.file) == ("study", 1.8, False, str(tmp_path / "study.toml"))
    first = plan.experiments[0]
    assert (first.axes, first.variants, first.trajectory.si) == (("x",), ("as modelled", "soft"), "m")
    assert (first.published[0].si, first.published[0].half_width) == (pytest.approx(0.2), pytest.approx(5e-3))
    assert plan.controllers["mine"].axis["x"].in_volts(2e-6) == pytest.approx(1e4)  # 0.01 V/um
    assert list(plan.variants_in_use()) == ["soft"]


def test_a_variant_that_no_experiment_names_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(changed(STUDY, '["as modelled", "soft"]', '["as modelled"]'))
    plan = experiments.read(tmp_path / "study.toml", ["x"])
    assert experiments.variants(plan, lambda _: pytest.fail("was read")) == {}


def test_a_refused_variant_names_the_study(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    plan = experiments.read(tmp_path / "study.toml", ["x"])

    def refuse(_: object) -> Any:
        raise InputError("command line", "axis.x.gain", "1 V", "is wrong")

    with pytest.raises(InputError) as refused:
        experiments.variants(plan, refuse)
    assert (refused.value.file, refused.value.field) == (str(tmp_path / "study.toml"), "variants.soft.set")
    assert (refused.value.value, refused.value.remedy) == ("axis.x.gain=1 V", "is wrong")


def test_a_bare_gain_keeps_the_gain_around_the_loop() -> None:
    """kp times the static gain is what the loop feels: 0.05 for a plant of 6 is 0.3; 2 um/V need 0.15 V/um."""
    gains = Gains.model_validate({"kp": 0.05, "plant_gain": 6.0})
    assert gains.in_volts(2e-6) * 2e-6 == pytest.approx(0.05 * 6.0)
    assert gains.in_volts(-2e-6) == pytest.approx(-0.15e6)
