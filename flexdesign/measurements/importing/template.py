"""What files hold, written as a map that only wants completing: what is not known stands there to be replaced."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from flexdesign.core import unit_tables
from flexdesign.measurements.importing.contents import Contents, Variable
from flexdesign.measurements.importing.mapping import OF_RESPONSES, RESPONSE
from flexdesign.measurements.importing.readers import look
from flexdesign.measurements.recordings import ALLOWED

#: Words by which programs call the columns of a run, in small letters; a name that begins with one will do.
WORDS = {
    "t": ("t", "time", "zeit"),
    "u": ("u", "command", "cmd", "input", "dac", "drive", "voltage", "v"),
    "x": ("x", "y", "position", "pos", "displacement", "disp", "output", "sensor"),
}
#: The same of a frequency response, whose other column is the first array of complex numbers.
OF_LINES = {"f": ("f", "freq", "frequency", "frequencies", "hz"), "coherence": ("coherence", "coh")}
#: Names of scalars that are a sampling rate in Hz.
RATES = ("fs", "fsamp", "rate", "sample_rate", "samplerate", "samplingrate", "sampling_rate")
#: What those columns measure, by which a variable is guessed whose name says nothing.
BY_UNIT = {"t": ("s",), "x": ("m", "rad"), "u": ("V",)}
#: The unit that is written where nothing is known.
USUAL = {"t": "s", "u": "V", "x": "um", "f": "Hz", RESPONSE: "um/V", "coherence": "1"}


def propose(paths: Sequence[Path]) -> str:
    """Return a map for files: for each by itself where all hold variables of the same names, else for all together.

    Raises
    ------
    InputError
        As `look` does.
    """
    alone = [look([path]) for path in paths]
    if len(alone) > 1 and all(list(each.variables) == list(alone[0].variables) for each in alone):
        return template(alone[0], beside=paths[1:])
    return template(look(paths))


def template(contents: Contents, beside: Sequence[Path] = ()) -> str:
    """Return a map as text: what the files hold in comments, then a run with the columns that can be guessed.

    The text is TOML. Guesses are marked; lines that nobody can guess are ``?`` and refused until they are replaced.
    Files `beside` hold the same variables, and the map is for each of them.
    """
    more = f", and likewise in {len(beside)} more" if beside else ""
    lines = [f"# What is in {', '.join(path.name for path in contents.paths)}{more}:", "#"]
    rows = [_row(name, variable) for name, variable in contents.variables.items()]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, [*widths, 0], strict=True)]
        lines.append(f"#   {'  '.join(cells)}".rstrip())
    lines += ["#", *(f"# {' '.join(note.split())[:110]}" for note in contents.notes)]
    is_response = any(v.is_complex and v.size > 1 for v in contents.variables.values())
    guesses = _of_response(contents) if is_response else _guesses(contents, WORDS)
    several = any(np.squeeze(np.empty(v.shape, dtype=bool)).ndim > 1 for v in contents.variables.values())
    lines += [
        "# A map: complete it, then flexdesign import FILES --map map.toml -o FOLDER",
        "",
        f"title = {json.dumps(contents.paths[0].stem)}",
    ]
    if beside:
        lines.append("per_file = true  # each file by itself makes a run, named after it")
    has_time = is_response or "t" in guesses or any(v.step for v in contents.variables.values())
    if not has_time:
        lines.append(f'rate = "{_rate(contents) or "?"}"  # or map a column t')
    if several:
        of = "frequency, channel, input, realisation" if is_response else "sample, channel, realisation, period"
        lines.append(f'axes = ["?", "?"]  # of {of}')
    named = [] if beside else [f"name = {json.dumps(contents.paths[0].stem)}"]
    lines += ["", "[[run]]", *named, '# kind = "multisine"']
    optional = {"t", "coherence"} - guesses.keys()
    for column in ("f", RESPONSE, "coherence") if is_response else ("t", "u", "x"):
        if column in optional:
            continue
        lines += ["", f"[run.columns.{column}]", *_column(column, guesses.get(column), contents)]
    return "\n".join(lines) + "\n"


def _row(name: str, variable: Variable) -> list[str]:
    size = "scalar" if variable.size == 1 else " x ".join(map(str, variable.shape))
    if variable.is_complex:
        size = f"{size}, complex"
    unit = f"[{variable.unit}]" if variable.unit else "no unit"
    said = [f"{1 / variable.step:.6g} Hz"] if variable.step else []
    if variable.size == 1:
        said.append(f"= {variable.values().item():.6g}")
    return [json.dumps(name, ensure_ascii=False), size, unit, "; ".join([*said, variable.note]).strip("; ")]


def _of_response(contents: Contents) -> dict[str, str]:
    first = next(name for name, variable in contents.variables.items() if variable.is_complex and variable.size > 1)
    return {RESPONSE: first, **_guesses(contents, OF_LINES)}


def _guesses(contents: Contents, wanted: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Return the variables that are called as columns are; each for one column."""
    found: dict[str, str] = {}
    arrays = [name for name, variable in contents.variables.items() if variable.size > 1 and not variable.is_complex]
    for column, words in wanted.items():
        for name in arrays:
            last = name.replace(":", "/").replace(".", "/").rpartition("/")[2].lower()
            begins = [word for word in words if last == word or (len(word) > 1 and last.startswith(word))]
            if name not in found.values() and (begins or last.partition("_")[0] in words):
                found[column] = name
                break
    if wanted is WORDS:
        found |= _by_units(contents, [name for name in arrays if name not in found.values()], set(wanted) - set(found))
    return found


def _by_units(contents: Contents, arrays: Sequence[str], missing: Collection[str]) -> dict[str, str]:
    """Return the variables that can be but one column by their units: seconds, volts of a command, motion."""
    found: dict[str, str] = {}
    for column in (column for column in BY_UNIT if column in missing):
        fits = [name for name in arrays if name not in found.values() and _measures(contents, name, BY_UNIT[column])]
        if len(fits) == 1 or (fits and column == "u"):  # of several voltages a scope's first channel is the command
            found[column] = fits[0]
    left = [name for name in arrays if name not in found.values()]
    if "x" in missing and "x" not in found and len(left) == 1:
        found["x"] = left[0]
    return found


def _measures(contents: Contents, name: str, allowed: Sequence[str]) -> bool:
    """Tell whether the unit of a variable is one of those of some SI units."""
    try:
        return bool(unit_tables.si_of(contents.variables[name].unit, allowed))
    except ValueError:
        return False


def _column(column: str, name: str | None, contents: Contents) -> list[str]:
    variable = contents.variables[name] if name else None
    lines = [f"variable = {json.dumps(name or '?', ensure_ascii=False)}" + ("  # a guess" if name else "")]
    try:
        if not variable or not variable.unit:
            raise ValueError("no unit is known")
        unit_tables.si_of(variable.unit, (OF_RESPONSES if column in OF_RESPONSES else ALLOWED)[column])
    except ValueError:
        stands = f"  # the file says {variable.unit!r}" if variable and variable.unit else ""
        lines.append(f'unit = "?"{stands}' if stands or not variable else f'unit = "?"  # {USUAL[column]}?')
    if variable and name and column == "x" and _measures(contents, name, ("V",)):
        lines.append('# if that is the voltage of a sensor: unit = "um" and scale, in um for each unit of it')
    if variable and np.squeeze(np.empty(variable.shape, dtype=bool)).ndim > 1:
        lines.append("channel = 1")
    return lines


def _rate(contents: Contents) -> str:
    for name, variable in contents.variables.items():
        if (
            name.replace(":", ".").rpartition(".")[2].lower() in RATES
            and variable.size == 1
            and not variable.is_complex
        ):
            return f"{variable.values().item():.12g} Hz"
    return ""
