"""Valid files of every format that the program reads; the shipped ones where there are some."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from flexdesign.core import data_files

RATE, COUNT = 2000.0, 60
TIME = np.arange(COUNT) / RATE
COMMAND = 10 * np.sin(2 * np.pi * 55 * TIME) + 20
MOTION = 3 * COMMAND + 0.01 * np.cos(731 * TIME)
FREQUENCIES = np.linspace(10.0, 300.0, 16)
RESPONSE = 2.0 / (1 - (FREQUENCIES / 118.0) ** 2 + 2j * 0.03 * FREQUENCIES / 118.0)

DESIGN = b"""\
format = 1
title = "An amplifier"
part = "bridge_amplifier"

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

[material]
name = "my alloy"
youngs_modulus = "70 GPa"
poissons_ratio = 0.33
density = "2700 kg/m^3"
yield_strength = "300 MPa"

[actuator]
name = "a stack"
free_stroke = "38 um"
voltage_range = ["0 V", "150 V"]
stiffness = "100 N/um"
contact_stiffness = "500 N/um"
preload = "20 N"
hysteresis = { model = "bouc-wen", a = "0.1 um/V", b = "0.0165 1/V", c = "0.004 1/V" }

[tolerances]
dimensions = "5 um"
modulus = 0.02

[effects.over_cut]
thinner = "10 um"
"""
STUDY = b"""\
format = 1
design = "design.toml"
title = "A study"

[mesh]
method = "extruded"
levels = 3
accuracy = "1 %"
at_root = 0.05
largest = "2 mm"
cross_check = false

[modes]
count = 2

[output]
load = "1 N/um"
stroke = "0.2 mm"
sensor = ["0 mm", "20 mm", "5 mm"]
large_steps = 4

[variants]
"wider" = ["dimensions.width=13 mm"]
"""
MATERIAL = b"""\
format = 1
name = "my alloy"
youngs_modulus = "70 GPa"
poissons_ratio = 0.33
density = "2700 kg/m^3"
yield_strength = "300 MPa"
source = "a data sheet"
"""
SWEEP = b"""\
format = 1
title = "Which one?"
design = "bridge_amplifier"
evaluator = "analytic"
show = ["lambda_output_free"]

[vary]
"dimensions.width" = ["10 mm", "12 mm"]
"dimensions.hinge_thickness" = { from = "0.3 mm", to = "0.8 mm", count = 4, spacing = "log" }
"actuator.preload" = { from = "10 N", to = "30 N", count = 3 }
material = ["AZ31B", "Ti-6Al-4V"]

[sample]
method = "latin-hypercube"
count = 8
seed = 1

[limits]
"|stroke_output_free|" = "> 150 um"

[aim]
maximise = "K_out_actuator_installed"
"""
AXIS = b"""
[axis.x]
natural_frequency = "118 Hz"
damping_ratio = 0.03
gain = "2.3 um/V"
effects = { creep = { per_decade = 0.02 } }
hysteresis = { model = "bouc-wen", a = "0.46 um/V", b = "0.0165 1/V", c = "0.004 1/V", n = 1 }
modes = [{ frequency = "300 Hz", damping_ratio = 0.02, share = 0.1 }]
assumed = ["bouc_wen"]
uncertainty = { gain = "1 %" }
sources = { gain = "a measurement" }

[axis.x.actuator]
free_stroke = "40 um"
voltage_range = ["0 V", "150 V"]
stiffness = "60 N/um"

[axis.x.driver]
limits = ["0 V", "150 V"]
bandwidth = "1 kHz"

[axis.x.sensor]
noise = "2 nm"
range = ["0 mm", "5 mm"]

[axis.y]
natural_frequency = "118 Hz"
damping_ratio = 0.03
gain = "2.3 um/V"

[controller]
rate = "1000 Hz"
delay = "1 ms"

[coupling.quadratic]
y_from_x = "0.01 1/mm"
"""
MEASUREMENTS = b"""\
title = "Bench 3, first assembly"
axis = "x"
command_is = "monitor"
scale = 20
bias = "0 V"
limits = ["0 V", "150 V"]
between_samples = "hold"
noise = "3 nm"

[sensors.x]
noise = "2 nm"
range = ["0 um", "5 mm"]
point = ["0 mm", "12 mm", "3 mm"]
direction = [1, 0, 0]

[[run]]
file = "run.csv"
kind = "multisine"
role = "identify"
closed_loop = false
conditions = { payload = "50 g", temperature = "23 degC" }

[[run]]
file = "response.csv"
input = "dac"
output = "x"
amplitude = "2 V"
bias = "40 V"
averages = 16
period = "0.1 ms"
"""
MAP = b"""\
title = "Bench 3"
rate = "2 kHz"
axes = ["sample", "channel"]
command_is = "monitor"
limits = ["0 V", "150 V"]

[text]
separator = ";"
decimal = ","
skip = 0
encoding = "utf-8"

[constants]
kv = "243.45 V s/m"

[variables.pulse]
variable = "u"
unit = "V"

[[run]]
name = "one"
kind = "multisine"
[run.columns.u]
formula = "2 * pulse + sqrt(pulse ** 2)"
unit = "V"
[run.columns.x]
variable = "x"
unit = "um"
scale = 1e3
offset = 1

[[run]]
name = "two"
[run.columns.u]
variable = "u"
unit = "V"
channel = 1
[run.columns.x]
variable = "x"
unit = "um"
"""
#: A map for variables called u and x, whatever file they are in.
SHORT_MAP = """\
rate = "2 kHz"
axes = ["sample", "channel"]
[[run]]
name = "one"
[run.columns.u]
variable = "NAME_u"
unit = "V"
CHANNEL_u
[run.columns.x]
variable = "NAME_x"
unit = "um"
CHANNEL_x
"""
STATIC = b"""\
# Two variants of one amplifier.
quantity,value,unit,sigma,boundary,hinge_thickness [mm]
K_in,657.37,N/mm,0.5 %,free,0.35
lambda,-11.938,1,0.1,free,0.35
K_out,4.386,N/mm,,free,0.5
K_out,86.262,N/mm,0.5 %,held,
"""
EXPERIMENTS = b"""\
format = 1
title = "Experiments"
robust_ms = 1.6
cycled = true

[variants."light damping"]
set = ["axis.x.damping_ratio=0.02"]
controllers_know = false

[controllers.mine]
axis.x = { kp = "0.05 V/um", ti = "4 ms", td = "1 ms" }
axis.y = { kp = 0.3, plant_gain = 2.0 }
source = "a paper"

[[experiment]]
name = "step"
title = "10 um, X"
axes = ["x"]
reference = { shape = "step", start = "0 um", target = "10 um", wait = "20 ms", hold = "400 ms" }
controllers = ["robust", "feedforward + mine"]
variants = ["as modelled", "light damping"]
published = [{ measure = "overshoot", value = "3 um", place = "Fig 1", axis = "x", controller = "robust" }]

[[experiment]]
name = "recorded"
axes = ["x", "y"]
command = { shape = "csv", file = "command.csv", column = ["ux [V]", "uy [V]"] }
"""
OVERRIDES = b"""\
axis.x.damping_ratio=0.02
axis.x.gain*=1.2
controller.rate="2 kHz"
axis.x.sensor.noise="3 nm"
title="changed"
"""


def table(*columns: tuple[str, Any], separator: str = ",", decimal: str = ".") -> bytes:
    """Return a table in text with a header."""
    rows = [
        [f"{value:.6g}".replace(".", decimal) for value in row] for row in zip(*(v for _, v in columns), strict=True)
    ]
    return "\n".join(separator.join(row) for row in [[name for name, _ in columns], *rows]).encode() + b"\n"


RUN = table(("t [s]", TIME), ("u [V]", COMMAND), ("x [um]", MOTION), ("T [degC]", 0.1 * TIME + 20))
LINES = table(
    ("f [Hz]", FREQUENCIES), ("magnitude [um/V]", np.abs(RESPONSE)), ("phase [deg]", np.angle(RESPONSE, deg=True)),
    ("coherence", np.full(len(FREQUENCIES), 0.98)),
)  # fmt: skip
TEXT = b"made by a scope\n" + table(("t", TIME), ("u", COMMAND), ("x", MOTION), separator=";", decimal=",")
FOLLOWED = table(("t [s]", TIME), ("ux [V]", COMMAND), ("uy [V]", COMMAND))


def package_file(name: str) -> bytes:
    """Return a file of ``studies/`` or ``geometry/``."""
    return (data_files.root() / name).read_bytes()


def _library_file(ending: str, write: Any) -> bytes:
    """Return what a library writes into a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"made{ending}"
        write(path)
        return path.read_bytes()


def parquet() -> bytes:
    from flexdesign.core import unit_tables

    def write(path: Path) -> None:
        unit_tables.write(path, {"t [s]": TIME, "u [V]": COMMAND, "x [um]": 1e-6 * MOTION}, "a run")

    return _library_file(".parquet", write)


def matlab() -> bytes:
    from scipy.io import savemat

    stream = io.BytesIO()
    rig = {"u": COMMAND, "x": np.stack([MOTION, MOTION], axis=1), "info": {"name": "bench", "gain": 2.5}}
    savemat(stream, {"rig": rig, "fs": RATE, "note": "warm", "cells": np.array([1, "a"], dtype=object)})
    return stream.getvalue()


def matlab_compressed() -> bytes:
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, {"rig": {"u": COMMAND, "x": MOTION}}, do_compression=True)
    return stream.getvalue()


def matlab_73() -> bytes:
    import h5py

    def write(path: Path) -> None:
        with h5py.File(path, "w", userblock_size=512) as file:
            file.create_dataset("rig/u", data=COMMAND[:, None]).attrs["MATLAB_class"] = np.bytes_("double")
            file.create_dataset("rig/x", data=MOTION[:, None]).attrs["MATLAB_class"] = np.bytes_("double")
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")

    return _library_file(".mat", write)


def hdf5() -> bytes:
    import h5py

    def write(path: Path) -> None:
        log = np.zeros(COUNT, dtype=[("t", "f8"), ("tag", "S3"), ("u", "f4")])
        log["t"], log["u"] = 1e3 * TIME, COMMAND
        with h5py.File(path, "w") as file:
            group = file.create_group("bench")
            group.create_dataset("x", data=MOTION, compression="gzip").attrs["units"] = "um"
            group.create_dataset("u", data=COMMAND, chunks=(16,)).attrs["units"] = "V"
            file.create_dataset("log", data=log)
            file.create_dataset("text", data="warm")

    return _library_file(".h5", write)


def tdms() -> bytes:
    from nptdms import ChannelObject, TdmsWriter

    def write(path: Path) -> None:
        wave = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0}
        moments = np.datetime64("2026-01-01T00:00:00") + (1e6 * TIME).astype("timedelta64[us]")
        with TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    ChannelObject("bench", "u", COMMAND, properties={**wave, "unit_string": "V"}),
                    ChannelObject("bench", "x", MOTION, properties={**wave, "unit_string": "um"}),
                    ChannelObject("bench", "t", moments),
                    ChannelObject("notes", "who", ["a", "b"]),
                ]
            )

    return _library_file(".tdms", write)


def universal() -> bytes:
    import pyuff

    common: dict[str, Any] = {"type": 58, "binary": 0, "rsp_node": 4, "rsp_dir": 3, "ref_node": 0, "ref_dir": 0}
    common |= {f"id{k}": "" for k in range(1, 6)} | {"ver_num": 1, "load_case_id": 0, "z_axis_value": 0}
    common |= {"abscissa_spacing": 1, "abscissa_min": 0, "abscissa_inc": 1 / RATE, "abscissa_spec_data_type": 17}
    common |= {
        "rsp_ent_name": "NONE",
        "ref_ent_name": "NONE",
        "orddenom_spec_data_type": 0,
        "ordinate_spec_data_type": 8,
    }
    in_time = {**common, "func_type": 1, "x": TIME, "ord_data_type": 4}
    sets = [
        {**in_time, "id1": "u", "data": COMMAND, "ordinate_axis_units_lab": "V"},
        {**in_time, "id1": "x", "data": MOTION, "ordinate_axis_units_lab": "um"},
        {**common, "func_type": 4, "id1": "FRF", "x": FREQUENCIES, "data": RESPONSE, "ord_data_type": 6,
         "ordinate_axis_units_lab": "um", "orddenom_axis_units_lab": "V"},
    ]  # fmt: skip

    def write(path: Path) -> None:
        file = pyuff.UFF(str(path))
        for each in sets:
            file.write_sets(each, mode="add")

    return _library_file(".uff", write)


def numpy_array() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.stack([COMMAND, MOTION], axis=1))
    return stream.getvalue()


def numpy_archive() -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, u=COMMAND, x=MOTION, fs=RATE)
    return stream.getvalue()


def sweep_results() -> bytes:
    """Return the answers of a sweep, as they are kept."""
    from flexdesign.core.model import Quantity
    from flexdesign.workflows.sweeps.results import Results
    from flexdesign.workflows.sweeps.store import Store

    one = np.ones(2)
    kept = Results({"K": Quantity("K", 1.0, "N/m", "N/m", "free")}, {"K": one}, {"K": one}, ["", ""], one)
    with tempfile.TemporaryDirectory() as folder:
        Store(Path(folder)).keep(["a", "b"], kept)
        return next(Path(folder).rglob("*.npz")).read_bytes()
