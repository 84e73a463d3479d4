"""Every bad input ends in one message that names the file, the field, the value and the remedy, and leaves nothing.

The tables give for each input what the message must name. The first ones go through the library alone; the last go
through the command line: exit code 2, one line on stderr, no traceback, nothing on stdout, nothing written.
"""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Cache
from flexdesign.design import study
from flexdesign.fem.meshing import domain, mesh
from flexdesign.report import render
from flexdesign.report.validation import export

DESIGN = """\
format = 1
part = "bridge_amplifier"
material = "Al 7075-T6"

[dimensions]
arm_span = "20 mm"
arm_offset = "1.6 mm"
arm_thickness = "4 mm"
hinge_length = "3 mm"
hinge_thickness = "0.5 mm"
width = "12 mm"
rod_length = "5 mm"
rod_thickness = "4 mm"
input_block_height = "12 mm"
input_block_depth = "6 mm"
block_width = "14 mm"
output_block_height = "6 mm"
ground_block_height = "6 mm"
fillet_radius = "0 mm"

[actuator]
free_stroke = "38 um"
voltage_range = ["0 V", "150 V"]
stiffness = "100 N/um"
preload = "20 N"
"""

MATERIAL = """
[material]
name = "my alloy"
youngs_modulus = "70 GPa"
poissons_ratio = 0.33
density = "2700 kg/m^3"
yield_strength = "300 MPa"
"""

STUDY = """\
format = 1
design = "design.toml"

[mesh]
levels = 3

[output]
stroke = "0.2 mm"
"""

PART = """\
from dataclasses import dataclass
from typing import ClassVar
from flexdesign import Linkage, Member, Parameter, Port, SymmetryPlane


@dataclass(frozen=True)
class Leaf:
    size: float
    dimensions: ClassVar = (Parameter("size", "m", "mm", "its size", plausible=(1e-3, 0.1)),)

    def solid(self):
        import cadquery as cq
        body = cq.Solid.makeBox(20, 10, 4, pnt=cq.Vector(-10, -5, -2))
        return body

    def ports(self):
        return (
            Port("left", "input", (-0.01, 0.0, 0.0), (-1.0, 0.0, 0.0)),
            Port("right", "input", (0.01, 0.0, 0.0), (1.0, 0.0, 0.0)),
            Port("output", "output", (0.0, 0.005, 0.0), (0.0, 1.0, 0.0)),
            Port("ground", "ground", (0.0, -0.005, 0.0), (0.0, -1.0, 0.0)),
        )

    def linkage(self):
        leaf = Member("leaf", "hinge", ("a", "b"), (0.0, 0.0, 0.0), (0.01, 0.0, 0.0), 1e-3, 4e-3)
        return Linkage({"a": (0.0, 0.0, 0.0), "b": (0.01, 0.0, 0.0)}, (leaf,))

    def symmetry(self):
        return (SymmetryPlane("x", {"left": "right"}),)

    def formulas(self, material, actuator_stiffness):
        return {}

    def formula_shares(self, material):
        return {}

    def intermediates(self, material, force):
        return {}
"""

USES_PART = 'format = 1\npart = "leaf"\nmaterial = "AZ31B"\n[dimensions]\nsize = "10 mm"\n'


def changed(text: str, old: str, new: str) -> str:
    """Return `text` with its one `old` replaced."""
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the template"
    return text.replace(old, new)


def refused(act: Callable[[], object], file: str, field: str, value: object, *remedy: str) -> None:
    """Assert that `act` is refused with an InputError that says what it must."""
    with pytest.raises(InputError) as caught:
        act()
    error = caught.value
    assert (Path(error.file).name, error.field, error.value) == (file, field, value)
    for words in remedy:
        assert words in error.remedy
    message = str(error)
    assert message.startswith(error.file) and field in message and "\n" not in message
    assert len(message.replace(error.file, file)) < 400  # however deep the folder that the file is in
    for jargon in ("Traceback", "_DesignFile", "_StudyFile", "pydantic", "Input should", "validation", "NoneType"):
        assert jargon not in message


# --- design files -------------------------------------------------------------------------------------------------

OF_LENGTH = ("not a unit of length", '"1.5 mm"')
WIDTH = 'width = "12 mm"'

#: id: (what is replaced, by what, field, value, words of the remedy)
DESIGNS: dict[str, tuple[str, str, str, object, tuple[str, ...]]] = {
    "force for a length": (WIDTH, 'width = "5 N"', "dimensions.width", "5 N", ("'N'", *OF_LENGTH)),
    "area for a length": (WIDTH, 'width = "12 mm^2"', "dimensions.width", "12 mm^2", OF_LENGTH),
    "temperature for a length": (WIDTH, 'width = "12 degC"', "dimensions.width", "12 degC", OF_LENGTH),
    "no unit": (WIDTH, "width = 12", "dimensions.width", 12, ("unit is missing", '"1.5 mm"')),
    "no unit in text": (WIDTH, 'width = "12"', "dimensions.width", '"12"', ("unit is missing",)),
    "unknown unit": (WIDTH, 'width = "12 mmm"', "dimensions.width", "12 mmm", ("unknown unit 'mmm'",)),
    "unreadable unit": (WIDTH, 'width = "12 m*"', "dimensions.width", "12 m*", ("cannot read the unit 'm*'",)),
    "decimal comma": (WIDTH, 'width = "12,5 mm"', "dimensions.width", "12,5 mm", ("written with a point",)),
    "no number": (WIDTH, 'width = "wide"', "dimensions.width", "wide", ("does not begin with a number",)),
    "empty text": (WIDTH, 'width = ""', "dimensions.width", '""', ("is empty", '"1.5 mm"')),
    "nan mm": (WIDTH, 'width = "nan mm"', "dimensions.width", "nan mm", ("not a finite number",)),
    "inf": (WIDTH, "width = inf", "dimensions.width", float("inf"), ("not a finite number",)),
    "overflow": (WIDTH, 'width = "1e400 mm"', "dimensions.width", "1e400 mm", ("not a finite number",)),
    "overflow by the unit": (WIDTH, 'width = "1e308 km"', "dimensions.width", "1e308 km", ("not a finite number",)),
    "negative": (WIDTH, 'width = "-12 mm"', "dimensions.width", "-12 mm", ("allowed: 0.5 to 200 mm",)),
    "zero": (WIDTH, 'width = "0 mm"', "dimensions.width", "0 mm", ("allowed: 0.5 to 200 mm",)),
    "a thousand times too wide": (WIDTH, 'width = "12 m"', "dimensions.width", "12 m", ("0.5 to 200 mm",)),
    "a thousand times too narrow": (WIDTH, 'width = "12 um"', "dimensions.width", "12 um", ("0.5 to 200 mm",)),
    "boolean for a number": (WIDTH, "width = true", "dimensions.width", "true", ("not a number with a unit",)),
    "list for a number": (WIDTH, "width = [1, 2]", "dimensions.width", [1, 2], ("not a number with a unit",)),
    "table for a number": (WIDTH, "width = { mm = 12 }", "dimensions.width", None, ("not a number with a unit",)),
    "missing dimension": (WIDTH, "", "dimensions.width", None, ("is missing", "amplifier along z", "mm")),
    "misspelt dimension": (WIDTH, 'widht = "12 mm"', "dimensions.widht", "12 mm", ("did you mean width?",)),
    "hinge thicker than its arm": (
        'hinge_thickness = "0.5 mm"', 'hinge_thickness = "5 mm"',
        "dimensions.hinge_thickness", "5 mm", ("at most 3.6 mm", "thinner than its arm"),
    ),
    "hinges meet": (
        'hinge_length = "3 mm"', 'hinge_length = "25 mm"',
        "dimensions.hinge_length", "25 mm", ("at most 18 mm", "must not meet"),
    ),
    "arm overlaps the input block": (
        'rod_length = "5 mm"', 'rod_length = "2 mm"',
        "dimensions.rod_length", "2 mm", ("2.2 mm or more", "0 for no rod", "overlaps the input block"),
    ),
    "arm too steep": (
        'arm_offset = "1.6 mm"', 'arm_offset = "18 mm"',
        "dimensions.arm_offset", "18 mm", ("at most 17 mm", "steeper than 45 degrees"),
    ),
    "block does not cover the arm": (
        'output_block_height = "6 mm"', 'output_block_height = "3 mm"',
        "dimensions.output_block_height", "3 mm", ("4 mm or more", "covers the arm's end"),
    ),
    "input block thinner than the rod": (
        'input_block_depth = "6 mm"', 'input_block_depth = "4 mm"',
        "dimensions.input_block_depth", "4 mm", ("4.2 mm to", "stands out from the rod"),
    ),
    "fillet too large": (
        'fillet_radius = "0 mm"', 'fillet_radius = "2 mm"',
        "dimensions.fillet_radius", "2 mm", ("at most 1.35 mm", "two fillets must fit"),
    ),
    "fillet too small": (
        'fillet_radius = "0 mm"', 'fillet_radius = "1 um"',
        "dimensions.fillet_radius", "1 um", ("0.005 mm or more", "0 for sharp roots"),
    ),
    "later format": ("format = 1", "format = 2", "format", 2, ("reads format = 1", "newer flexdesign")),
    "format as text": ("format = 1", 'format = "1"', "format", '"1"', ("reads format = 1",)),
    "format as boolean": ("format = 1", "format = true", "format", "true", ("reads format = 1",)),
    "missing format": ("format = 1\n", "", "format", None, ("is missing", "write format = 1")),
    "missing part": ('part = "bridge_amplifier"\n', "", "part", None, ("is missing", 'part = "bridge_amplifier"')),
    "missing material": ('material = "Al 7075-T6"\n', "", "material", None, ("is missing", 'material = "AZ31B"')),
    "unknown part": ("bridge_amplifier", "bridge_amplifer", "part", "bridge_amplifer", ("mean bridge_amplifier?",)),
    "another unknown part": ("bridge_amplifier", "quoin", "part", "quoin",
        ("no such part", "known: apa300ml_shell, bridge_amplifier")),
    "unknown material": ("Al 7075-T6", "Al 7075", "material", "Al 7075", ("did you mean Al 7075-T6?", "[material]")),
    "number for a material": ('"Al 7075-T6"', "7075", "material", 7075, ("expected a name", "[material] table")),
    "list for a part": ('"bridge_amplifier"', "[1]", "part", [1], ("expected text",)),
    "misspelt table": ("[actuator]", "[actuater]", "actuater", None, ("did you mean actuator?",)),
    "misspelt dimensions": ("[dimensions]", "[dimension]", "dimension", None, ("did you mean dimensions?",)),
    "misspelt key": ("preload =", "perload =", "actuator.perload", "20 N", ("did you mean preload?",)),
    "list for a table": ("[actuator]", "[[actuator]]", "actuator", None, ("expected a table: [actuator]",)),
    "actuator without stiffness": (
        'stiffness = "100 N/um"\n', "", "actuator.stiffness", None, ("is missing", '"1.5 N/mm"'),
    ),
    "negative stiffness": (
        '"100 N/um"', '"-100 N/um"', "actuator.stiffness", "-100 N/um", ("allowed: 1 to 2e+07 N/mm",),
    ),
    "force for a stiffness": (
        '"100 N/um"', '"100 N"', "actuator.stiffness", "100 N", ("not a unit of stiffness", '"1.5 N/mm"'),
    ),
    "preload without a number": (
        '"20 N"', '"abc"', "actuator.preload", "abc", ("does not begin with a number", '"1.5 N"'),
    ),
    "a thousand times too much stroke": (
        '"38 um"', '"38 mm"', "actuator.free_stroke", "38 mm", ("allowed: 0.0001 to 10 mm",),
    ),
    "one voltage": (
        '["0 V", "150 V"]', '["150 V"]', "actuator.voltage_range", ["150 V"], ("two voltages", '["0 V", "150 V"]'),
    ),
    "voltages reversed": (
        '["0 V", "150 V"]', '["150 V", "0 V"]', "actuator.voltage_range", ["150 V", "0 V"], ("must be the lower one",),
    ),
    "voltage in millimetres": (
        '["0 V", "150 V"]', '["0 V", "150 mm"]',
        "actuator.voltage_range", ["0 V", "150 mm"], ("not a unit of voltage", '"1.5 V"'),
    ),
    "settings of a study": ("[actuator]", "[mesh]\nlevels = 2\n[actuator]", "mesh", None, ("belongs to a study",)),
}  # fmt: skip

#: The same for a design with a material of its own.
MATERIALS: dict[str, tuple[str, str, str, object, tuple[str, ...]]] = {
    "incompressible": ("0.33", "0.5", "material.poissons_ratio", 0.5, ("allowed: 0 to 0.495",)),
    "boolean ratio": ("0.33", "true", "material.poissons_ratio", "true", ("not a number", "0 to 0.495")),
    "ratio with a unit": ("0.33", '"0.33 mm"', "material.poissons_ratio", "0.33 mm", ("the number has no unit",)),
    "density without unit": ("2700 kg/m^3", "2700", "material.density", '"2700"', ("unit is missing", "kg/m^3")),
    "density in g/m^3": ("2700 kg/m^3", "2700 g/m^3", "material.density", "2700 g/m^3", ("50 to 30000 kg/m^3",)),
    "modulus in kPa": ("70 GPa", "70 kPa", "material.youngs_modulus", "70 kPa", ("1 to 2e+06 MPa",)),
    "misspelt property": ("density", "densty", "material.densty", "2700 kg/m^3", ("did you mean density?",)),
    "missing property": ('density = "2700 kg/m^3"\n', "", "material.density", None, ("is missing", "kg/m^3")),
    "nameless": ('name = "my alloy"\n', "", "material.name", None, ("is missing",)),
}


@pytest.mark.parametrize(("old", "new", "field", "value", "remedy"), DESIGNS.values(), ids=DESIGNS)
def test_a_bad_design_is_refused(
    tmp_path: Path, old: str, new: str, field: str, value: object, remedy: tuple[str, ...]
) -> None:
    path = tmp_path / "design.toml"
    path.write_text(changed(DESIGN, old, new))
    refused(lambda: study.read(path), "design.toml", field, value, *remedy)


@pytest.mark.parametrize(("old", "new", "field", "value", "remedy"), MATERIALS.values(), ids=MATERIALS)
def test_a_bad_material_is_refused(
    tmp_path: Path, old: str, new: str, field: str, value: object, remedy: tuple[str, ...]
) -> None:
    path = tmp_path / "design.toml"
    path.write_text(changed(DESIGN, 'material = "Al 7075-T6"\n', "") + changed(MATERIAL, old, new))
    refused(lambda: study.read(path), "design.toml", field, value, *remedy)


def test_the_templates_are_good(tmp_path: Path) -> None:
    (tmp_path / "design.toml").write_text(DESIGN)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "material.toml").write_text(changed(DESIGN, 'material = "Al 7075-T6"\n', "") + MATERIAL)
    (tmp_path / "leaf.py").write_text(PART)
    (tmp_path / "leaf.toml").write_text(USES_PART)
    for name in ("design", "study", "material"):
        study.read(tmp_path / f"{name}.toml")
    body = domain.of_part(study.read(tmp_path / "leaf.toml").design.part(), chord=1e-5)
    assert body.volume == pytest.approx(10e-3 * 10e-3 * 4e-3)  # half of it


# --- study files and overrides ------------------------------------------------------------------------------------

#: id: (what is replaced, by what, field, value, words of the remedy)
STUDIES: dict[str, tuple[str, str, str, object, tuple[str, ...]]] = {
    "one mesh": ("levels = 3", "levels = 1", "mesh.levels", 1, ("allowed: 2 to 5, a whole number",)),
    "99 meshes": ("levels = 3", "levels = 99", "mesh.levels", 99, ("allowed: 2 to 5",)),
    "meshes in words": ("levels = 3", 'levels = "three"', "mesh.levels", "three", ("a whole number",)),
    "meshes as text": ("levels = 3", 'levels = "3"', "mesh.levels", '"3"', ("a whole number",)),
    "half a mesh": ("levels = 3", "levels = 2.5", "mesh.levels", 2.5, ("a whole number",)),
    "boolean meshes": ("levels = 3", "levels = true", "mesh.levels", "true", ("a whole number",)),
    "envelope too large": ("levels = 3", "envelope = 0.4", "mesh.envelope", 0.4, ("allowed: 0.001 to 0.05",)),
    "misspelt setting": ("levels = 3", "level = 3", "mesh.level", 3, ("did you mean levels?",)),
    "number for a table": ("[mesh]\nlevels = 3", "mesh = 3", "mesh", 3, ("expected a table: [mesh]",)),
    "misspelt settings": ("[mesh]", "[mehs]", "mehs", None, ("did you mean mesh",)),
    "stroke in newtons": ('"0.2 mm"', '"0.2 N"', "output.stroke", "0.2 N", OF_LENGTH),
    "no stroke at all": ('"0.2 mm"', '"0 mm"', "output.stroke", "0 mm", ("more than 0, at most 50 mm",)),
    "no design": ('design = "design.toml"\n', "", "design", None, ("is missing", 'design = "bridge_amplifier"')),
    "unknown design": ("design.toml", "bridge_amplifer", "design", "bridge_amplifer", ("mean bridge_amplifier",)),
    "missing design file": ("design.toml", "no/where.toml", "design", "no/where.toml", ("no such file",)),
    "its own design": ("design.toml", "study.toml", "design", "study.toml", ("cannot be its own design",)),
    "a folder as design": ('"design.toml"', '"."', "design", ".", ("is a folder", ".toml")),
    "dimensions in a study": ("[mesh]", "[dimensions]\n[mesh]", "dimensions", None, ("belongs to the design",)),
}

#: id: (override, file, field, value, words of the remedy)
OVERRIDES: dict[str, tuple[str, str, str, object, tuple[str, ...]]] = {
    "no equals sign": ("mesh.levels", "command line", "--set", "mesh.levels", ('--set table.key="value unit"',)),
    "no key": ("=3", "command line", "--set", "=3", ("--set table.key=",)),
    "a dot too many": ("mesh..levels=3", "command line", "--set", "mesh..levels=3", ("--set table.key=",)),
    "unknown table": ("mehs.levels=3", "command line", "mehs.levels", "3", ("did you mean mesh",)),
    "bare dimension": ("width=12 mm", "command line", "width", "12 mm", ("write dimensions.width",)),
    "unknown setting": ("mesh.levles=3", "command line", "mesh.levles", 3, ("did you mean levels?",)),
    "unknown dimension": ("dimensions.with=3 mm", "command line", "dimensions.with", "3 mm", ("mean width",)),
    "key into a value": ("dimensions.width.x=3", "command line", "dimensions.width.x", "3", ("is a value (12 mm)",)),
    "wrong type": ("mesh.levels=many", "command line", "mesh.levels", "many", ("a whole number",)),
    "wrong unit": ("dimensions.width=5 N", "command line", "dimensions.width", "5 N", OF_LENGTH),
    "no value": ("dimensions.width=", "command line", "dimensions.width", '""', ("is empty",)),
    "hinge too thick": ("dimensions.hinge_thickness=6 mm", "command line", "dimensions.hinge_thickness", "6 mm", ()),
    "arm too thin for the file's hinge": (
        "dimensions.arm_thickness=0.5 mm", "design.toml", "dimensions.hinge_thickness", "0.5 mm", ("0.45 mm",),
    ),
    "another design": ("design=other", "command line", "design", "other", ("is a design itself",)),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "field", "value", "remedy"), STUDIES.values(), ids=STUDIES)
def test_a_bad_study_is_refused(
    tmp_path: Path, old: str, new: str, field: str, value: object, remedy: tuple[str, ...]
) -> None:
    (tmp_path / "design.toml").write_text(DESIGN)
    path = tmp_path / "study.toml"
    path.write_text(changed(STUDY, old, new))
    refused(lambda: study.read(path), "study.toml", field, value, *remedy)


@pytest.mark.parametrize(("override", "file", "field", "value", "remedy"), OVERRIDES.values(), ids=OVERRIDES)
def test_a_bad_override_is_refused(
    tmp_path: Path, override: str, file: str, field: str, value: object, remedy: tuple[str, ...]
) -> None:
    path = tmp_path / "design.toml"
    path.write_text(DESIGN)
    refused(lambda: study.read(path, ["title=Mine", override]), file, field, value, *remedy)


# --- files that are none ------------------------------------------------------------------------------------------

#: id: (content, words of the remedy)
CONTENTS: dict[str, tuple[bytes, tuple[str, ...]]] = {
    "empty": (b"", ("is empty", "format")),
    "not TOML": (changed(DESIGN, "[dimensions]", "dimensions").encode(), ("not valid TOML", "line 5", "correct")),
    "text without end": (changed(DESIGN, '"12 mm"\nrod', '"12 mm\nrod').encode(), ("not valid TOML", "line 11")),
    "a key twice": (DESIGN.replace("format = 1", "format = 1\nformat = 1").encode(), ("not valid TOML", "line 2")),
    "a number without end": (b"format = " + b"1" * 5000, ("not valid TOML",)),
    "nested without end": (b"format = " + b"[" * 100_000, ("not valid TOML",)),
    "not UTF-8": (b"format = 1\n" + "title = 'Verstärker'".encode("latin-1"), ("not UTF-8", "line 2", "save it as")),
    "binary": (bytes(range(256)), ("not UTF-8",)),
    "null bytes": (b"\0" * 9, ("not valid TOML", "line 1")),
}

#: id: (argument, file, field, value, words of the remedy)
ARGUMENTS: dict[str, tuple[str, str, str, object, tuple[str, ...]]] = {
    "missing file": ("none.toml", "none.toml", "", None, ("no such file",)),
    "missing file with a near name": ("bridge_amplifer.toml", "bridge_amplifer.toml", "", None, ("bridge_amplifier",)),
    "misspelt name": ("bridge_amplifer", "command line", "STUDY", "bridge_amplifer", ("mean bridge_amplifier",)),
    "unknown name": (
        "zzz",
        "command line",
        "STUDY",
        "zzz",
        ("no such design or study", "known: bridge, bridge_amplifier"),
    ),
    "empty name": ("", "command line", "STUDY", '""', ("known: bridge, bridge_amplifier",)),
    "a folder": ("folder", "folder", "", None, ("is a folder", ".toml")),
    "a folder called .toml": ("folder.toml", "folder.toml", "", None, ("is a folder",)),
    "a part": ("leaf.py", "leaf.py", "", None, ("is a part", ".toml")),
    "a name without end": ("x" * 5000, "command line", "STUDY", "x" * 5000, ("too long",)),
}


@pytest.mark.parametrize(("content", "remedy"), CONTENTS.values(), ids=CONTENTS)
def test_a_file_that_is_no_toml_is_refused(tmp_path: Path, content: bytes, remedy: tuple[str, ...]) -> None:
    path = tmp_path / "design.toml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        study.read(path)
    error = caught.value
    assert Path(error.file).name == "design.toml"
    assert "\n" not in str(error)
    for words in remedy:
        assert words in error.remedy


@pytest.mark.parametrize(("argument", "file", "field", "value", "remedy"), ARGUMENTS.values(), ids=ARGUMENTS)
def test_a_file_that_is_not_there_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    argument: str,
    file: str,
    field: str,
    value: object,
    remedy: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "leaf.py").write_text(PART)
    refused(lambda: study.read(argument), file, field, value, *remedy)


# --- part files ---------------------------------------------------------------------------------------------------

CLASS = "@dataclass(frozen=True)\nclass Leaf:"
SOLID = "        return body"
OUTPUT = '"output", "output", (0.0, 0.005, 0.0), (0.0, 1.0, 0.0)'

#: id: (what is replaced, by what, field, value, words of the remedy)
PARTS: dict[str, tuple[str, str, str, object, tuple[str, ...]]] = {
    "syntax error": ("def ports(self):", "def ports(self:", "", None, ("SyntaxError", "leaf.py, line 16")),
    "raises on import": (CLASS, f"1 / 0\n{CLASS}", "", None, ("ZeroDivisionError", "leaf.py, line 6", "correct it")),
    "exits on import": (CLASS, f"raise SystemExit(3)\n{CLASS}", "", None, ("SystemExit: 3", "leaf.py, line 6")),
    "imports what is not there": (CLASS, f"import nowhere\n{CLASS}", "", None, ("No module named 'nowhere'",)),
    "raises in several lines": (CLASS, f"raise ValueError('a\\nb')\n{CLASS}", "", None, ("ValueError: a b",)),
    "no class": ("    dimensions: ClassVar", "    sizes: ClassVar", "", None, ("one class with `dimensions`", "none")),
    "two classes": (CLASS, f"class Other:\n    dimensions = ()\n\n{CLASS}", "", None, ("Other, Leaf",)),
    "lacks a method": ("def symmetry(", "def symmetries(", "Leaf", None, ("lacks symmetry()",)),
    "lacks what it needs": ("def ports(self)", "def faces(self)", "Leaf", None, ("lacks ports()",)),
    "dimensions are numbers": (
        'Parameter("size", "m", "mm", "its size", plausible=(1e-3, 0.1)),', "1.0, 2.0",
        "Leaf.dimensions", None, ("tuple of flexdesign.Parameter",),
    ),
    "raises in __init__": (
        "    def solid(self):", "    def __post_init__(self):\n        1 / 0\n\n    def solid(self):",
        "Leaf", None, ("ZeroDivisionError: division by zero", "leaf.py, line 12"),
    ),
    "raises in solid()": (SOLID, "        return 1 / 0", "Leaf.solid()", None, ("ZeroDivisionError", "line 14")),
    "a fillet the kernel cannot make": (
        SOLID, "        return body.fillet(50, body.Edges())", "Leaf.solid()", None, ("StdFail_NotDone", "line 14"),
    ),
    "solid() returns a workplane": (
        SOLID, "        return cq.Workplane(body)", "Leaf.solid()", "Workplane", (".val()",),
    ),
    "solid() returns nothing": (SOLID, "        pass", "Leaf.solid()", "None", ("CadQuery shape",)),
    "ports() raises": ("        return (\n            Port(", "        return (\n            Prt(", "Leaf.ports()",
        None, ("NameError", "leaf.py, line 18")),
    "ports() returns nothing": ("        return (\n            Port(", "        (\n            Port(", "Leaf.ports()",
        None, ("tuple of flexdesign.Port",)),
    "no output": (OUTPUT, OUTPUT.replace('"output", "output"', '"output", "input"'), "Leaf.ports()",
        "ground, input", ("no port with the role output",)),
    "two ports of one name": ('"right", "input"', '"left", "input"', "Leaf.ports()", "left", ("two ports",)),
    "a normal of length 2": (OUTPUT, OUTPUT.replace("(0.0, 1.0, 0.0)", "(0.0, 2.0, 0.0)"), "Leaf.ports()",
        (0.0, 2.0, 0.0), ("normal of output", "unit vector")),
    "a hinge without length": ("(0.01, 0.0, 0.0), 1e-3, 4e-3", "(0.0, 0.0, 0.0), 1e-3, 4e-3", "Leaf.linkage()",
        (0.0, 1e-3, 4e-3), ("leaf has no size",)),
    "a member between nowhere": ('("a", "b")', '("a", "c")', "Leaf.linkage()", None, ("joins c", "line 26")),
    "symmetry about w": ('SymmetryPlane("x"', 'SymmetryPlane("w"', "Leaf.symmetry()", "w", ("x, y or z",)),
    "symmetry swaps a pair twice": ('"left": "right"', '"left": "right", "right": "left"', "Leaf.symmetry()",
        "left, right", ("each pair once",)),
    "symmetry swaps no port": ('"left": "right"', '"left": "rigth"', "Leaf.symmetry()", "rigth", ("mean right",)),
}  # fmt: skip

#: The same for what only the solid tells.
SOLIDS: dict[str, tuple[str, str, str, object, tuple[str, ...]]] = {
    "two solids": (
        SOLID, "        return cq.Compound.makeCompound([body, body.moved(cq.Location((50, 0, 0)))])",
        "solid", None, ("one closed body, found 2",),
    ),
    "open shell": (
        SOLID, "        return cq.Shell.makeShell(body.Faces()[:5])", "solid", None, ("closed body, found 0",),
    ),
    "wrong symmetry": ("Vector(-10, -5, -2)", "Vector(-9, -5, -2)", "symmetry", "x", ("not its own mirror image",)),
    "port beside the solid": (OUTPUT, OUTPUT.replace("0.005", "0.006"), "ports.output", (0.0, 0.006, 0.0), ("face",)),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "field", "value", "remedy"), PARTS.values(), ids=PARTS)
def test_a_bad_part_is_refused(
    tmp_path: Path, old: str, new: str, field: str, value: object, remedy: tuple[str, ...]
) -> None:
    (tmp_path / "leaf.py").write_text(changed(PART, old, new))
    (tmp_path / "leaf.toml").write_text(USES_PART)
    refused(
        lambda: domain.of_part(study.read(tmp_path / "leaf.toml").design.part(), chord=1e-5),
        "leaf.py", field, value, *remedy,
    )  # fmt: skip


@pytest.mark.parametrize("module", ["flexdesign.model", "flexdesign.part", "flexdesign.design"])
def test_a_part_that_imports_from_an_old_place_is_told_the_new_one(tmp_path: Path, module: str) -> None:
    """The last of these is there, and holds no Linkage."""
    (tmp_path / "leaf.py").write_text(changed(PART, "from flexdesign import", f"from {module} import"))
    (tmp_path / "leaf.toml").write_text(USES_PART)
    said = (f"imports from {module} what is not there", "write from flexdesign import Effect, Parameter, Port")
    refused(lambda: study.read(tmp_path / "leaf.toml").design.part(), "leaf.py", "", None, *said)


def test_two_circles_cut_from_a_solid_are_cylinders(tmp_path: Path) -> None:
    """Where the circles meet, the kernel keeps a trimmed surface."""
    cut = """\
        hole = cq.Workplane().circle(1).extrude(10, both=True)
        return cq.Workplane(body).cut(hole).cut(hole.translate((0.5, 0, 0))).val()"""
    (tmp_path / "leaf.py").write_text(changed(changed(PART, SOLID, cut), 'SymmetryPlane("x", {"left": "right"}),', ""))
    (tmp_path / "leaf.toml").write_text(USES_PART)
    body = domain.of_part(study.read(tmp_path / "leaf.toml").design.part(), chord=1e-5)
    found = [face.axis[0][0] for face in body.faces if face.axis is not None]
    assert {round(1e6 * x) for x in found} == {0, 500}
    assert all(face.radius == pytest.approx(1e-3) for face in body.faces if face.axis is not None)


FORMULAS = "def formulas(self, material, actuator_stiffness)"
ANSWERS = f"{FORMULAS.removesuffix(')')}, output_load)"

#: What is found of formulas before anything is solved: id: (what formulas() returns, words of the remedy)
ANSWERED = {
    "nothing": ("{}", ("returns nothing to compare", "K_in_output_free")),
    "None": ("None", ("must return quantities by the model's name",)),
    "numbers": ("{'PRB': [1.0, 2.0]}", ("must return quantities by the model's name",)),
    "a list": ("[]", ("must return quantities by the model's name",)),
    "models without quantities": ("{'PRB': []}", ("returns nothing to compare",)),
}


@pytest.mark.parametrize(("answer", "remedy"), ANSWERED.values(), ids=ANSWERED)
def test_formulas_that_cannot_be_used_are_refused_before_anything_is_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str, remedy: tuple[str, ...]
) -> None:
    from flexdesign.fem import mesh_refinement
    from flexdesign.workflows import validation

    def solved(*_: object) -> None:
        raise AssertionError("it was solved")

    monkeypatch.setattr(mesh_refinement, "refine", solved)
    part = changed(PART, FORMULAS, ANSWERS).replace("return {}", f"return {answer}", 1)
    (tmp_path / "leaf.py").write_text(part)
    (tmp_path / "leaf.toml").write_text(USES_PART)
    read = study.read(tmp_path / "leaf.toml")
    refused(lambda: validation.validate(read, Cache(tmp_path)), "leaf.py", "Leaf.formulas()", None, *remedy)


#: The same of the other methods: id: (method, what it returns, words of the remedy)
QUANTITY = "Quantity('K_in', 1e6, 'N/m', 'N/mm', 'output free')"
RETURNED = {
    "formulas that fail late": (
        "formulas",
        "Formulas({'PRB': lambda: [1 / 0]})",
        ("fails with ZeroDivisionError", "leaf.py, line", "correct the part"),
    ),
    "no shares": ("formula_shares", "None", ("must return compliances [m/N] by quantity and piece", "or {}")),
    "shares without pieces": ("formula_shares", "{'K_in_output_free': 5e-7}", ("by quantity and piece",)),
    "no intermediates": ("intermediates", "None", ("must return quantities by name", "or {}")),
    "intermediates as numbers": ("intermediates", "{'M': 1.0}", ("must return quantities by name",)),
}


@pytest.mark.parametrize(("method", "answer", "remedy"), RETURNED.values(), ids=RETURNED)
def test_what_a_method_returns_is_examined_before_anything_is_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, answer: str, remedy: tuple[str, ...]
) -> None:
    from flexdesign.fem import mesh_refinement
    from flexdesign.workflows import validation

    def solved(*_: object) -> None:
        raise AssertionError("it was solved")

    monkeypatch.setattr(mesh_refinement, "refine", solved)
    answers = {"formulas": f"{{'PRB': [{QUANTITY}]}}", "formula_shares": "{}", "intermediates": "{}", method: answer}
    part = changed(PART, FORMULAS, ANSWERS)
    for name in answers:
        head, _, tail = part.partition(f"    def {name}(")
        part = f"{head}    def {name}({tail.replace('return {}', f'return {answers[name]}', 1)}"
    imports = "from flexdesign.core.model import Quantity\nfrom flexdesign.core.model.formulas import Formulas\n"
    (tmp_path / "leaf.py").write_text(imports + part)
    (tmp_path / "leaf.toml").write_text(USES_PART)
    read = study.read(tmp_path / "leaf.toml")
    refused(lambda: validation.validate(read, Cache(tmp_path)), "leaf.py", f"Leaf.{method}()", None, *remedy)


def test_a_linkage_whose_ports_stand_on_no_node_is_refused_by_the_compliance_model(tmp_path: Path) -> None:
    from flexdesign.analytic import static_model

    (tmp_path / "leaf.py").write_text(PART)
    (tmp_path / "leaf.toml").write_text(USES_PART)
    design = study.read(tmp_path / "leaf.toml").design
    remedy = ("no frame", "the port left stands on no node", "linkage()")
    refused(lambda: static_model.of_design(design, bare=True), "leaf.toml", "part", "Leaf", *remedy)
    refused(lambda: static_model.of_design(design), "leaf.toml", "part", "Leaf", *remedy)


def test_contributing_names_every_method_that_a_part_must_have() -> None:
    from flexdesign.design.part import METHODS

    text = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert [method for method in METHODS if f"`{method}()`" not in text] == []


@pytest.mark.parametrize(("old", "new", "field", "value", "remedy"), SOLIDS.values(), ids=SOLIDS)
def test_a_bad_solid_is_refused(
    tmp_path: Path, old: str, new: str, field: str, value: object, remedy: tuple[str, ...]
) -> None:
    (tmp_path / "leaf.py").write_text(changed(PART, old, new))
    (tmp_path / "leaf.toml").write_text(USES_PART)
    part = study.read(tmp_path / "leaf.toml").design.part()
    refused(lambda: domain.of_part(part, chord=1e-5), "part", field, value, *remedy)


# --- places that cannot be written --------------------------------------------------------------------------------


def contents(folder: Path) -> set[str]:
    """Return every path under a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


UNWRITABLE = {
    "a file": "a_file",
    "inside a file": "a_file/report",
    "no such device": "/dev/null/report",
    "a file system that takes no files": "/proc/report",
    "a name without end": "x" * 300,
}


@pytest.mark.parametrize("place", UNWRITABLE.values(), ids=UNWRITABLE)
def test_an_unwritable_report_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a_file").write_text("kept")
    refused(lambda: render.prepare(Path(place)), "command line", "--out", place, "cannot be written", "another folder")
    assert contents(tmp_path) == {"a_file"}


def test_preparing_a_report_folder_leaves_no_trace(tmp_path: Path) -> None:
    render.prepare(tmp_path / "deep" / "down")
    assert contents(tmp_path) == set()


@pytest.mark.parametrize("place", UNWRITABLE.values(), ids=UNWRITABLE)
def test_an_unwritable_cache_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a_file").write_text("kept")
    for act in (Cache(Path(place)).prepare, lambda: Cache(Path(place)).store("mesh", "key", {}, {})):
        refused(act, "cache", "folder", place, "cannot keep results", "--cache")
    assert contents(tmp_path) == {"a_file"}


def test_no_home_for_the_cache_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for variable in ("FLEXDESIGN_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    from flexdesign.core.result_cache import default_folder

    refused(default_folder, "environment", "FLEXDESIGN_CACHE", None, "no home folder")


def no_space(*_: object, **__: object) -> Any:
    """Fail as a full disk does."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("step", ["numpy.savez_compressed", "pathlib.Path.replace", "tempfile.NamedTemporaryFile"])
def test_a_full_disk_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    monkeypatch.setattr(step, no_space)
    store = Cache(tmp_path / "cache")
    act = lambda: store.store("mesh", "key", {"points": np.ones(3)}, {})  # noqa: E731
    refused(act, "cache", "folder", str(tmp_path / "cache"), "No space left on device", "free space")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_file_cut_off_by_the_system_leaves_nothing(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    noise = np.random.default_rng(0).standard_normal(100_000)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        with pytest.raises(InputError, match="File too large"):
            Cache(tmp_path).store("mesh", "key", {"points": noise}, {})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


#: id: (path, words of the remedy)
EXPORTS = {
    "unknown kind": ("mesh.abc", ("unknown kind of file", ".step", ".vtu")),
    "no suffix": ("mesh", ("unknown kind of file",)),
    "missing folder": ("nowhere/mesh.vtu", ("folder does not exist",)),
    "unwritable solid": ("/proc/solid.step", ("cannot be written",)),
    "unwritable mesh": ("/proc/mesh.vtu", ("cannot be written",)),
    "a device": ("/dev/null/solid.step", ("folder does not exist",)),
    "a folder": ("folder.vtu", ("is a folder",)),
    "a format for pictures": ("mesh.svg", ("cannot be written as .svg", ".vtu or .msh")),
}


@pytest.mark.parametrize(("path", "remedy"), EXPORTS.values(), ids=EXPORTS)
def test_an_export_that_cannot_be_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str, remedy: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder.vtu").mkdir()
    refused(lambda: export.writer(Path(path)), "command line", "--export", path, *remedy)
    assert contents(tmp_path) == {"folder.vtu"}


@pytest.mark.parametrize("name", ["a.step", "a.stp", "a.STL", "a.brep", "a.vtu", "a.vtk", "a.msh", "a.inp"])
def test_an_export_that_is_offered_can_be_written(tmp_path: Path, name: str) -> None:
    export.writer(tmp_path / name)
    assert contents(tmp_path) == set()


# --- through the command line -------------------------------------------------------------------------------------

#: id: (arguments after `validate`, what the one line names)
COMMANDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "wrong unit": (("--set", "dimensions.width=5 N"), ("dimensions.width = 5 N", "not a unit of length")),
    "two overrides": (
        ("--set", "dimensions.width=9 mm", "--set", "dimensions.rod_length=1 km"), ("rod_length = 1 km", "100 mm"),
    ),
    "override without value": (("--set", "mesh.levels"), ("--set = mesh.levels", "table.key=")),
    "too many meshes": (("--set", "mesh.levels=99", "--json"), ("mesh.levels = 99", "allowed: 2 to 5")),
    "misspelt study": (("bridge_amplifer",), ("STUDY = bridge_amplifer", "did you mean bridge_amplifier")),
    "missing file": (("none.toml",), ("none.toml", "no such file")),
    "empty file": (("empty.toml",), ("empty.toml", "is empty")),
    "part raises": (("raises.toml",), ("raises.py", "ZeroDivisionError", "line 6")),
    "part raises in several lines": (("lines.toml",), ("lines.toml", "dimensions.size", "one two")),
    "report folder is a file": (("--out", "empty.toml"), ("--out = empty.toml", "cannot be written")),
    "unwritable report folder": (("--out", "/proc/report"), ("--out = /proc/report", "cannot be written")),
    "cache is a file": (("--cache", "empty.toml"), ("empty.toml", "cannot keep results")),
    "unknown export": (("--export", "mesh.abc"), ("--export = mesh.abc", "unknown kind of file")),
    "export into a missing folder": (("--export", "no/mesh.vtu"), ("no/mesh.vtu", "folder does not exist")),
    "unknown option": (("--levels", "3"), ("--levels", "validate --help")),
    "option without value": (("--out",), ("--out", "--help")),
    "one argument too many": (("bridge_amplifier", "more"), ("more", "validate --help")),
}  # fmt: skip


def prepare_inputs(folder: Path) -> None:
    """Write the files that the commands name."""
    (folder / "empty.toml").touch()
    (folder / "raises.py").write_text(changed(PART, CLASS, f"1 / 0\n{CLASS}"))
    refuses = "    def __post_init__(self):\n        raise InputError('part', 'dimensions.size', None, 'one\\ntwo')\n"
    imports = "from flexdesign.core.errors import InputError\n"
    (folder / "lines.py").write_text(
        imports + changed(PART, "    def solid(self):", f"{refuses}\n    def solid(self):")
    )
    for name in ("raises", "lines"):
        (folder / f"{name}.toml").write_text(USES_PART.replace("leaf", name))


def assert_one_message(stderr: str, *named: str) -> None:
    """Assert that the last line is the one message, and that nothing but progress stands before it."""
    lines = stderr.splitlines()
    assert [line for line in lines if line.startswith("flexdesign:")] == lines[-1:], stderr
    assert all(line.lstrip()[:1].isdigit() for line in lines[:-1]), stderr
    assert "Traceback" not in stderr
    for words in named:
        assert words in lines[-1]


@pytest.mark.parametrize(("arguments", "named"), COMMANDS.values(), ids=COMMANDS)
def test_a_bad_command_ends_in_one_line(
    tmp_path: Path, command_line: Callable[..., Any], arguments: tuple[str, ...], named: tuple[str, ...]
) -> None:
    prepare_inputs(tmp_path)
    before = contents(tmp_path)
    ended = command_line("validate", *arguments)
    assert ended.code == 2
    assert ended.stdout == ""
    assert len(ended.stderr.splitlines()) == 1
    assert_one_message(ended.stderr, *named)
    assert contents(tmp_path) == before


#: id: (what is replaced in the part, by what, what the last line names)
BUILT = {
    "solid raises": (SOLID, "        return 1 / 0", ("solid()", "ZeroDivisionError", "leaf.py, line 14")),
    "two solids": (*SOLIDS["two solids"][:2], ("leaf", "solid", "one closed body")),
    "port beside the solid": (*SOLIDS["port beside the solid"][:2], ("leaf", "ports.output", "0.006")),
}


@pytest.mark.parametrize(("old", "new", "named"), BUILT.values(), ids=BUILT)
def test_a_bad_part_ends_in_one_line(
    tmp_path: Path, command_line: Callable[..., Any], old: str, new: str, named: tuple[str, ...]
) -> None:
    (tmp_path / "leaf.py").write_text(changed(PART, old, new))
    (tmp_path / "leaf.toml").write_text(USES_PART)
    ended = command_line("validate", "leaf.toml", "--out", "report", "--json")
    assert (ended.code, ended.stdout) == (2, "")
    assert_one_message(ended.stderr, *named)
    assert contents(tmp_path) == {"leaf.py", "leaf.toml", "cache"}


def test_a_full_disk_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command_line: Callable[..., Any]
) -> None:
    tets = np.array([[0, 1, 2, 3]])
    corner = mesh.TaggedMesh(np.vstack([np.zeros(3), np.eye(3)]), tets, mesh.boundary(tets), np.zeros(4, dtype=int))
    monkeypatch.setattr(mesh, "tetrahedralize", lambda *_: corner)
    monkeypatch.setattr(np, "savez_compressed", no_space)
    ended = command_line("validate", "bridge_amplifier", "--out", "report", "--json")
    assert (ended.code, ended.stdout) == (2, "")
    assert_one_message(ended.stderr, str(tmp_path / "cache"), "No space left on device", "free space")
    assert contents(tmp_path) == {"cache", "cache/mesh"}


def test_a_failed_run_leaves_the_last_report_alone(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    (tmp_path / "leaf.py").write_text(changed(PART, SOLID, "        return 1 / 0"))
    (tmp_path / "leaf.toml").write_text(USES_PART)
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "report.html").write_text("the last one")
    assert command_line("validate", "leaf.toml", "--out", "report").code == 2
    assert contents(tmp_path / "report") == {"report.html"}
    assert (tmp_path / "report" / "report.html").read_text() == "the last one"


def test_a_process_of_its_own_ends_with_code_2(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "flexdesign", "validate", "--set", "dimensions.width=nan mm", "--out", "report"]
    root = str(Path(__file__).parent.parent)
    environment = os.environ | {"PYTHONPATH": root, "FLEXDESIGN_CACHE": str(tmp_path / "cache")}
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert len(ended.stderr.splitlines()) == 1
    assert_one_message(ended.stderr, "command line: dimensions.width = nan mm", "not a finite number")
    assert contents(tmp_path) == set()
