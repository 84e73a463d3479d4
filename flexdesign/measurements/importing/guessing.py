"""Assign variables to columns of a run by names, units and numbers; and list what only their owner can know."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexdesign.core import unit_tables
from flexdesign.core.errors import InputError
from flexdesign.measurements.importing import header_cells, rates, roles
from flexdesign.measurements.importing.contents import Contents, Variable, short_name
from flexdesign.measurements.importing.mapping import OF_RESPONSES, RESPONSE
from flexdesign.measurements.importing.roles import Role
from flexdesign.measurements.recordings import ALLOWED, AXES, FEWEST
from flexdesign.measurements.recordings.time_base import fit_grid

#: The unit that is proposed where nothing is known.
USUAL = {
    "t": "s", "u": "V", "x": "um", "r": "um", "v": "V", "i": "A", "f": "N", "T": "degC",
    RESPONSE: "um/V", "magnitude": "um/V", "re": "um/V", "im": "um/V", "phase": "deg", "coherence": "1",
}  # fmt: skip
#: Phases beyond this number of turns are in degrees.
TURNS = 2
#: What each column is, in words.
MEANS = {
    "t": "time", "u": "command", "x": "response", "r": "reference", "v": "voltage at the stack", "i": "current",
    "f": "force", "T": "temperature",
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """One column of a run, where known.

    Parameters
    ----------
    name
        Of the column.
    variable
        Which it is of the file; empty if none is known.
    unit
        What is to be written into the map; empty where the file says it and it is right, ``?`` where nobody knows.
    formula, constants, variables
        Of a column that is computed, and what stands in it: quantities, and units of variables.
    remark
        What the map says of it.
    """

    name: str
    variable: str
    unit: str = ""
    formula: str = ""
    constants: Mapping[str, str] = field(default_factory=dict)
    variables: Mapping[str, str] = field(default_factory=dict)
    remark: str = ""


@dataclass(frozen=True)
class Guess:
    """What a run of some files would be.

    Parameters
    ----------
    columns
        In order.
    rate
        Where there is no time; ``?`` if nobody knows.
    axes
        Of arrays that have several; ``?`` where nobody knows.
    is_response
        Whether it is a frequency response.
    questions
        What only the owner of the files can know, each a sentence without its full stop.
    left_out
        Variables with as many numbers as the columns that are none.
    """

    columns: tuple[Column, ...]
    rate: str = ""
    axes: tuple[str, ...] = ()
    is_response: bool = False
    questions: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def guess(contents: Contents) -> Guess:
    """Return what the variables of some files are.

    Raises
    ------
    InputError
        If each is a single number.
    """
    arrays = {name: variable for name, variable in contents.variables.items() if variable.size > 1}
    if not arrays:
        remedy = f"has one number of each variable; a recording has at least {FEWEST} rows"
        raise InputError(contents.paths[0], "", None, remedy)
    is_complex = [name for name, variable in arrays.items() if variable.is_complex]
    if is_complex:
        return _complex_response(
            contents, arrays, max(is_complex, key=lambda n: "transfer" in roles.classes(short_name(n)))
        )
    lines = {name: roles.line_of(_label(name, v), header_cells.si_of(v.unit)) for name, v in arrays.items()}
    shapes = ({"f", "magnitude", "phase"}, {"f", "re", "im"})
    remark = set(lines.values())
    if any(shape <= remark for shape in shapes) and not {"t", "u"} & {_role(n, v).column for n, v in arrays.items()}:
        return _real_response(contents, arrays, lines)
    return _run(contents, arrays)


def _label(name: str, variable: Variable) -> str:
    """Return what a file calls a variable."""
    return variable.label or short_name(name)


def _role(name: str, variable: Variable) -> Role:
    return roles.role_of(_label(name, variable), header_cells.si_of(variable.unit))


def _run(contents: Contents, arrays: Mapping[str, Variable]) -> Guess:
    found = {name: _role(name, variable) for name, variable in arrays.items()}
    columns: list[Column] = []
    questions: list[str] = []
    time = _time(arrays, found)
    if time:
        columns.append(_column("t", time, arrays[time], questions))
        found.pop(time)
    answers, doubt = _choose("x", found)
    questions += doubt
    commands, doubt = _choose("u", {name: role for name, role in found.items() if name not in answers.values()})
    questions += doubt
    if not answers:
        answers = _only_candidate(found, commands)
    on_axes = len(answers) > 1 or len(commands) > 1
    for axis, name in commands.items():
        cell = f"u{axis}" if axis and (len(commands) > 1 or (on_axes and axis in answers)) else "u"
        columns.append(_column(cell, name, arrays[name], questions))
    columns += [_column(axis or "x", name, arrays[name], questions) for axis, name in answers.items()]
    used = {column.variable for column in columns}
    for letter in ("r", "v", "i", "f", "T"):
        of_kind = [n for n, role in found.items() if role.column == letter and role.strength and n not in used]
        if len(of_kind) == 1 and _fits(letter, arrays[of_kind[0]]):
            columns.append(Column(letter, of_kind[0]))
            used.add(of_kind[0])
    columns = _without_command(columns, arrays, questions)
    for letter, name in (("u", "command"), ("x", "response")):
        if not any(column.name.lstrip("u") in ("", *AXES) and column.name[0] in _firsts(letter) for column in columns):
            columns.append(Column(letter, "", "?"))
            questions.append(f"which variable is the {name} {letter}")
    several = [c.variable for c in columns if c.variable and _is_several(arrays[c.variable])]
    axes = ("?", "?") if several else ()
    if axes:
        questions.append("what the axes of the arrays are (sample, channel, realisation, period), and which channel")
    rate = "" if time or any(v.step for v in arrays.values()) else rates.stated_rate(contents)
    if rate == "?":
        questions.append("the sampling rate, as there is no time")
    left = tuple(name for name in arrays if name not in {c.variable for c in columns} and name != time)
    return Guess(tuple(columns), rate, axes, False, tuple(questions), left)


def _firsts(letter: str) -> Sequence[str]:
    return ("u",) if letter == "u" else AXES


def _is_several(variable: Variable) -> bool:
    return sum(length > 1 for length in variable.shape) > 1


def _time(arrays: Mapping[str, Variable], found: Mapping[str, Role]) -> str:
    """Return the variable that is the time: by its name or its unit, else the one whose numbers rise evenly."""
    named = sorted((-role.strength, name) for name, role in found.items() if role.column == "t")
    rising = {name: _rises(arrays[name]) for _, name in named}
    if named:
        return next((name for _, name in named if rising[name]), named[0][1])
    if any(variable.step for variable in arrays.values()):
        return ""
    unknown = [n for n, v in arrays.items() if not v.unit and "count" not in roles.classes(_label(n, v)) and _rises(v)]
    is_only = len(arrays) > 2 and len(unknown) == 1
    is_count = is_only and bool((np.diff(arrays[unknown[0]].values().ravel()) == 1).all())
    return unknown[0] if is_only and not is_count else ""


def _rises(variable: Variable) -> bool:
    values = np.real(variable.values()).ravel()
    if len(values) < 3 or not np.isfinite(values).all() or not (np.diff(values) > 0).all():
        return False
    return fit_grid(values) is not None


def _choose(letter: str, found: Mapping[str, Role]) -> tuple[dict[str, str], list[str]]:
    """Return the variables of the clearest ones of a role, by axis, and what is to be asked of them."""
    of_kind = {name: role for name, role in found.items() if role.column == letter}
    best = max((role.strength for role in of_kind.values()), default=0)
    clear = {name: role for name, role in of_kind.items() if role.strength == best}
    if letter == "x" and best == 3 and len(clear) > 1:  # x and "Position": what measures motion goes first
        with_unit = {name: role for name, role in clear.items() if role.axis in ("", *AXES)}
        clear = with_unit or clear
    what = {"u": "command", "x": "response"}[letter]
    names = list(clear)
    if len(names) < 2:
        axis = next((role.axis for role in clear.values() if role.axis in AXES), "")
        axis = "" if axis == "y" and roles.is_output(short_name(names[0])) else axis  # the output y, with the input u
        doubt = []
        if names and best == 0 and letter == "u":
            doubt = [f"whether {_phrase(names[0])} is the command; only its unit says so"]
        return ({axis: names[0]} if names else {}), doubt
    axes = [role.axis for role in clear.values()]
    if best > 0 and len(set(axes)) == len(axes) and (set(axes) <= set(AXES) or set(axes) <= {"1", "2", "3"}):
        as_letter = {"1": "x", "2": "y", "3": "z"}
        return {as_letter.get(axis, axis): name for axis, name in zip(axes, names, strict=True)}, []
    return {"": names[0]}, [f"which of {_list(names)} is the {what} {letter}"]


def _only_candidate(found: Mapping[str, Role], commands: Mapping[str, str]) -> dict[str, str]:
    """Return the only variable that could be the response, where none is called or measured like one."""
    left = [name for name, role in found.items() if name not in commands.values() and role.column in ("", "u", "v")]
    left = [name for name in left if "count" not in roles.classes(short_name(name))]
    return {"": left[0]} if len(left) == 1 else {}


def _column(name: str, variable: str, of: Variable, questions: list[str]) -> Column:
    """Return a column of a variable; ask for its unit where the file does not say it or says one of another kind."""
    short, what = _phrase(variable), MEANS.get(name if name == "t" else name[0] if name[0] == "u" else "x", "response")
    if not of.unit:
        questions.append(f"the unit of {short}, the {what} {name} ({USUAL[_kind(name)]}?)")
        return Column(name, variable, "?")
    if not _fits(name, of):
        questions.append(f"unit and scale of {short}, the {what} {name}: the file says {of.unit}")
        return Column(name, variable, "?", remark=_scaled(of.unit))
    if _kind(name) == "x" and header_cells.si_of(of.unit) == "V":
        remark = 'if that is the voltage of a sensor: unit = "um" and scale, in um for each unit of it'
        if not _role(variable, of).strength or _role(variable, of).column != "x":
            questions.append(f"whether {short}, in {of.unit}, is the response, and how many um a volt of it is")
        return Column(name, variable, remark=remark)
    return Column(name, variable)


def _scaled(unit: str) -> str:
    """Return what the map says of a column whose unit is another one than it needs."""
    return f"the file says {unit!r}; add scale = ... in that unit for each of it"


def _kind(name: str) -> str:
    return "u" if name.startswith("u") else "x" if name in AXES else name


def _fits(name: str, of: Variable) -> bool:
    try:
        unit_tables.si_of(of.unit, {**ALLOWED, RESPONSE: OF_RESPONSES[RESPONSE]}[name])
    except ValueError:
        return False
    return True


def _without_command(columns: list[Column], arrays: Mapping[str, Variable], questions: list[str]) -> list[Column]:
    """Return columns with a command computed from the reference, where only a commanded position was recorded."""
    reference = next((column for column in columns if column.name == "r"), None)
    if reference is None or any(column.name.startswith("u") for column in columns):
        return columns
    name, unit = reference.variable, arrays[reference.variable].unit
    if not name.isidentifier():
        return columns
    questions.append(f"how many volts a commanded {unit} of {_phrase(name)} means: volts_per_length")
    made = Column("u", "", "V", f"volts_per_length * {name}", {"volts_per_length": f"? V/{unit}"})
    return [*columns, made]


def _complex_response(contents: Contents, arrays: Mapping[str, Variable], name: str) -> Guess:
    """Return the frequency response of an array of complex numbers."""
    questions: list[str] = []
    columns = []
    lines = {
        each: roles.line_of(_label(each, v), header_cells.si_of(v.unit)) for each, v in arrays.items() if each != name
    }
    columns.append(_frequency(_clearest_frequency(lines, arrays), arrays, questions))
    others = [each for each, variable in arrays.items() if variable.is_complex and each != name]
    if others and "transfer" not in roles.classes(short_name(name)):
        questions.append(f"which of {_list([name, *others])} is the response")
    if arrays[name].unit and _fits(RESPONSE, arrays[name]):
        columns.append(Column(RESPONSE, name))
    else:
        questions.append(f"the unit of {_phrase(name)}, the response per volt (um/V?)")
        columns.append(Column(RESPONSE, name, "?"))
    coherence = next((each for each, what in lines.items() if what == "coherence"), "")
    if coherence:
        columns.append(Column("coherence", coherence, "" if arrays[coherence].unit else "1"))
    several = _is_several(arrays[name])
    if several:
        questions.append("what the axes of the arrays are (frequency, channel, input, realisation), and which channel")
    used = {column.variable for column in columns}
    left = tuple(each for each in arrays if each not in used)
    return Guess(tuple(columns), "", ("?", "?") if several else (), True, tuple(questions), left)


def _clearest_frequency(lines: Mapping[str, str], arrays: Mapping[str, Variable]) -> str:
    """Return the frequency of several: one whose unit is known, then one that is no angular one; empty if none is."""
    named = [each for each, what in lines.items() if what == "f"]
    return min(named, default="", key=lambda n: (not arrays[n].unit, "angular" in roles.classes(_label(n, arrays[n]))))


def _frequency(name: str, arrays: Mapping[str, Variable], questions: list[str]) -> Column:
    if not name:
        questions.append("which variable is the frequency f")
        return Column("f", "", "?", remark="Hz?")
    if "angular" in roles.classes(_label(name, arrays[name])) and not arrays[name].unit:
        return Column("f", name, "rad/s", remark="an angular frequency, by its name")
    if arrays[name].unit:
        return Column("f", name)
    questions.append(f"the unit of {_phrase(name)}, the frequency f (Hz?)")
    return Column("f", name, "?", remark="Hz?")


def _real_response(contents: Contents, arrays: Mapping[str, Variable], lines: Mapping[str, str]) -> Guess:
    """Return the frequency response of columns of real numbers: magnitude and phase, or both parts."""
    questions: list[str] = []
    of = {what: name for name, what in reversed(list(lines.items())) if what}
    wanted = ("magnitude", "phase") if {"magnitude", "phase"} <= of.keys() else ("re", "im")
    columns = [_frequency(of["f"], arrays, questions)]
    for what in wanted:
        columns.append(_line(what, of[what], arrays[of[what]], questions))
    if "coherence" in of:
        columns.append(Column("coherence", of["coherence"], "" if arrays[of["coherence"]].unit else "1"))
    used = {column.variable for column in columns} | set(of.values())
    return Guess(tuple(columns), "", (), True, tuple(questions), tuple(name for name in arrays if name not in used))


def _line(what: str, name: str, variable: Variable, questions: list[str]) -> Column:
    si = header_cells.si_of(variable.unit)
    if what == "phase":
        largest = float(np.nanmax(np.abs(variable.values()), initial=0.0))
        if not variable.unit and not largest > TURNS * 2 * math.pi:
            questions.append(f"the unit of {_phrase(name)}, the phase (deg or rad?)")
            return Column(what, name, "?")
        return Column(what, name, "" if variable.unit else "deg")
    if si == header_cells.DECIBEL:
        questions.append(f"what 0 dB of {_phrase(name)} is: zero_db, such as 1 um/V")
        if name.isidentifier():
            constants, variables = {"zero_db": "? um/V"}, {name: "1"}
            return Column(what, "", "um/V", f"zero_db * 10 ** ({name} / 20)", constants, variables)
        return Column(
            what, name, "?", remark="in dB: write a formula, zero_db * 10 ** (NAME / 20), with [variables.NAME]"
        )
    if si in ("m/V", "rad/V") or (si == "1" and variable.unit):
        return Column(what, name)
    if variable.unit:
        questions.append(f"unit and scale of {_phrase(name)}, the {what} per volt: the file says {variable.unit}")
        return Column(what, name, "?", remark=_scaled(variable.unit))
    questions.append(f"the unit of {_phrase(name)}, the {what} per volt (um/V?)")
    return Column(what, name, "?")


def _phrase(name: str) -> str:
    return f'"{name}"'


def _list(names: Sequence[str]) -> str:
    return " and ".join(_phrase(name) for name in names) if len(names) < 3 else ", ".join(map(_phrase, names))
