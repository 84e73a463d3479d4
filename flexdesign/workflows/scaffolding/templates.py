"""Small files to start from: a part with its design, an effect, a study. Each works as it is written."""

from __future__ import annotations

import keyword
from pathlib import Path

from flexdesign.core.errors import InputError
from flexdesign.workflows.scaffolding.folder import write_files

PART = '''"""A table on two leaves that bend into an S: all that a part has to state is its solid and its ports."""

from dataclasses import dataclass

import cadquery as cq

from flexdesign.core.model import Parameter
from flexdesign.design.part import Port


@dataclass(frozen=True)
class {name}:
    length: float  # m
    thickness: float
    width: float

    dimensions = (
        Parameter("length", "m", "mm", "length of a leaf", plausible=(2e-3, 0.1)),
        Parameter("thickness", "m", "mm", "thickness of a leaf", plausible=(5e-5, 5e-3)),
        Parameter("width", "m", "mm", "width of the plate", plausible=(1e-3, 0.1)),
    )

    def solid(self):  # mm
        l, t, w = 1e3 * self.length, 1e3 * self.thickness, 1e3 * self.width
        plate = cq.Workplane("XY").box(30, l + 20, w)
        between = cq.Workplane("XY").rect(20 - t, l).extrude(w, both=True)
        sides = cq.Workplane("XY").pushPoints([(-15, 0), (15, 0)]).rect(10 - t, l).extrude(w, both=True)
        return plate.cut(between).cut(sides).val()

    def ports(self):  # a point on each face and its outward normal
        y = self.length / 2 + 5e-3
        return (
            Port("input", "input", (-15e-3, y, 0.0), (-1.0, 0.0, 0.0)),
            Port("output", "output", (15e-3, y, 0.0), (1.0, 0.0, 0.0)),
            Port("ground", "ground", (0.0, -self.length / 2 - 10e-3, 0.0), (0.0, -1.0, 0.0)),
        )

    def prismatic(self):  # not needed; with it the mesh is made in layers, many times sooner
        return "z"
'''
DESIGN = """format = 1
part = "{file}.py"
material = "Al 7075-T6"

[dimensions]
length = "20 mm"
thickness = "0.5 mm"
width = "10 mm"
"""
EFFECT = '''"""The electronics of the sensor warm up: its reading drifts in proportion to time."""

from flexdesign import Disturbance, Effect, Parameter


def reading(values, recorded, time):
    """Return what is added to the reading [m]."""
    return values["rate"] * (time - time[0])


EFFECT = Effect(
    name="{file}",
    physics="The electronics of the sensor warm up.",
    where="the position sensor",
    reveal="a quiet recording of some minutes",
    remedy="wait before the measurement",
    reference="data sheet of the sensor",
    # Name, SI unit, unit shown, meaning, null (where the effect vanishes), size shown, plausible range.
    parameters=(Parameter("rate", "m/s", "nm/s", "drift of the reading", 0.0, 1e-8, (-5e-6, 5e-6)),),
    faces=(Disturbance(reading),),
)
'''
STUDY = """# How a design is solved. Every key has a default; see flexdesign validate --help.
format = 1
title = "My study"
design = "bridge_amplifier"     # or a file next to this one: "my_design.toml"

[mesh]
accuracy = "1 %"                # refined until the estimated error is smaller

[modes]
count = 4
"""


def write_part(name: str) -> list[Path]:
    """Write a part and its design, ``NAME.py`` and ``NAME.toml``; return the files, raise as `write_files` does."""
    path = _module_name(name)
    title = "".join(word.capitalize() for word in path.name.split("_"))
    files = {f"{path.name}.py": PART.format(name=title), f"{path.name}.toml": DESIGN.format(file=path.name)}
    return write_files(path.parent, files)


def write_effect(name: str) -> list[Path]:
    """Write an effect of a moving stage, ``NAME.py``; return the file, raise as `write_files` does."""
    path = _module_name(name)
    return write_files(path.parent, {f"{path.name}.py": EFFECT.format(file=path.name)})


def write_study(name: str) -> list[Path]:
    """Write a study of a design, ``NAME.toml``; return the file, raise as `write_files` does."""
    path = _module_name(name)
    return write_files(path.parent, {f"{path.name}.toml": STUDY})


def _module_name(name: str) -> Path:
    """Return a path without its ending, whose last part can be the name of a Python file."""
    path = Path(name)
    path = path.with_suffix("") if path.suffix in (".py", ".toml") else path
    if not path.name.isidentifier() or keyword.iskeyword(path.name):
        remedy = "is no name of a Python file; take letters, digits and _, such as my_part"
        raise InputError("command line", "NAME", name, remedy)
    return path
