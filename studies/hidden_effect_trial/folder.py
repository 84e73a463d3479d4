"""A case as a folder that the package reads, and its answer in a file elsewhere."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.hidden_effect_trial.cases import SEED, Case, is_rough
from studies.hidden_effect_trial.effects import BY_NAME
from studies.hidden_effect_trial.recordings import PERIOD

#: Stiffness that a model states which states mass and stiffness; only their ratio acts [N/m].
STIFFNESS = 18.3e3
#: What a case's folder holds.
MODEL, RUNS = "model.toml", "runs"


@dataclass(frozen=True)
class Answer:
    """What is hidden in a case.

    Parameters
    ----------
    case, kind
        Its name and kind.
    effects
        Values of what is hidden, SI, by effect.
    groups
        By effect, those that can replace it.
    ratio
        Effect to noise, by effect.
    floor
        Error that no model can go below, over the run for testing [m].
    stroke
        Gain times voltage range [m].
    validation_floor
        As `floor`, over the validation runs [m]; None where nothing is for testing.
    seed
        Of all cases.
    fault, structural
        Kind and root mean square of the bench's structural error [m]; none but on imperfect benches.
    """

    case: str
    kind: str
    effects: Mapping[str, Mapping[str, float]]
    groups: Mapping[str, tuple[str, ...]]
    ratio: Mapping[str, float]
    floor: float
    stroke: float
    validation_floor: float | None = None
    seed: int = SEED
    fault: str = ""
    structural: float = 0.0


def write(case: Case, folder: Path, answer: Path) -> None:
    """Write model and recordings into a folder, and the answer into a file elsewhere."""
    (folder / RUNS).mkdir(parents=True, exist_ok=True)
    answer.parent.mkdir(parents=True, exist_ok=True)
    (folder / MODEL).write_text(model_text(case), encoding="utf-8")
    (folder / RUNS / "measurements.toml").write_text(_measurements_text(case), encoding="utf-8")
    for run, reading in zip(case.runs, case.readings, strict=True):
        table = np.column_stack((np.arange(run.n) * PERIOD, run.u[: run.n], 1e6 * reading))
        # To ten microvolts and ten picometres: finer than anything that happens.
        np.savetxt(folder / RUNS / f"{run.name}.csv", table, ["%.3f", "%.5f", "%.5f"], ",", header=HEADER, comments="")
    answer.write_text(_answer_text(case), encoding="utf-8")


HEADER = "t [s],u [V],x [um]"


def _title(case: Case) -> str:
    return f"Hidden-effect trial, case {case.number}" if case.number else "A stage with a hidden effect"


def model_text(case: Case) -> str:
    """Return the stage model's file."""
    stated = case.nominal
    omega_known = (
        [f'mass = "{1e3 * STIFFNESS / stated.omega**2:.7g} g"', f'stiffness = "{STIFFNESS / 1e3:.7g} N/mm"']
        if case.lumped
        else [f'natural_frequency = "{stated.omega / (2.0 * np.pi):.7g} Hz"']
    )
    known = ("20 %", "25 %", "16 %", "20 %") if is_rough(case.number) else ("2 %", "3 %", "1.8 %", "10 %")
    mass, stiffness, frequency, gain = known
    sigma = f'mass = "{mass}", stiffness = "{stiffness}"' if case.lumped else f'natural_frequency = "{frequency}"'
    loop = f'a = "{1e6 * stated.a:.6g} um/V", b = "{stated.b:.6g} 1/V", c = "{stated.c:.6g} 1/V", n = 1'
    return "\n".join(
        [
            "format = 1",
            f'title = "{_title(case)}"',
            "",
            "[axis.x]",
            *omega_known,
            f"damping_ratio = {stated.zeta:.6g}",
            f'gain = "{1e6 * stated.gain:.6g} um/V"',
            *([f'hysteresis = {{ model = "bouc-wen", {loop} }}'] if stated.a > 0.0 else []),
            f'uncertainty = {{ {sigma}, gain = "{gain}", damping_ratio = "100 %" }}',
            "",
            "[axis.x.actuator]",
            f'free_stroke = "{1e6 * stated.stroke / 5.0:.4g} um"',
            f'voltage_range = ["0 V", "{stated.volts:g} V"]',
            "",
            "[controller]",
            f'rate = "{1.0 / PERIOD:g} Hz"',
            'delay = "0 ms"',
            "",
        ]
    )


def _measurements_text(case: Case) -> str:
    lines = [f'title = "{_title(case)}"', 'axis = "x"', 'command_is = "dac"']
    for run in case.runs:
        kind = run.name.partition("-")[2].replace("-", " ")
        between = "hold" if run.held else "linear"
        lines += ["", "[[run]]", f'file = "{run.name}.csv"', f'kind = "{kind}"', f'role = "{run.role}"']
        lines += [f'between_samples = "{between}"']
    return "\n".join([*lines, ""])


def _answer_text(case: Case) -> str:
    lines = ["# What is hidden in these recordings; numbers without a unit are pure.", f'case = "{case.name}"']
    lines += [f'kind = "{case.kind}"', *([f"seed = {case.seed}"] if case.number else [])]
    lines += [
        f"noise = {case.noise * 1e6:.9g}  # um",
        f"floor = {case.floor * 1e6:.6g}  # um",
        *([f"validation_floor = {case.validation_floor * 1e6:.6g}  # um"] if case.validation_floor else []),
        f"poles = {list(case.poles)}",
    ]
    if case.fault:
        lines += [f'fault = "{case.fault}"', f"structural = {case.structural * 1e6:.6g}  # um"]
    lines += [f"stroke = {case.stage.stroke * 1e6:.9g}  # um"]
    lines += ["", "[base] # SI", *(f"{name} = {value!r}" for name, value in vars(case.stage).items())]
    for name, values in case.effects.items():
        units = BY_NAME[name].units
        lines += ["", f"[effects.{name}]"]
        lines += [
            f"{key} = {float(value)!r}{f'  # {units[key]}' if units[key] != '1' else ''}"
            for key, value in values.items()
        ]
    for title, table in (("effect_to_noise", case.ratio), ("confusable", case.groups)):
        lines += ["", f"[{title}]"]
        lines += [f"{name} = {list(v) if isinstance(v, tuple) else float(v)!r}" for name, v in table.items()]
    return "\n".join([*lines, ""]).replace("'", '"')


def read_answer(path: Path) -> Answer:
    """Read the answer of a case."""
    stated: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    groups = {name: tuple(others) for name, others in stated["confusable"].items()}
    um = 1e-6
    effects = {name: dict(values) for name, values in stated.get("effects", {}).items()}
    if "electrostriction" in effects:  # the package states it as displacement per voltage squared [m/V^2]
        softer = 1.0 - effects.get("stiffness_loss", {}).get("ratio", 0.0)  # moves the table further
        effects["electrostriction"]["quadratic"] *= stated["base"]["gain"] / softer
    return Answer(
        stated["case"],
        stated["kind"],
        effects,
        groups,
        stated["effect_to_noise"],
        stated["floor"] * um,
        stated["stroke"] * um,
        stated["validation_floor"] * um if "validation_floor" in stated else None,
        stated.get("seed", SEED),
        stated.get("fault", ""),
        stated.get("structural", 0.0) * um,
    )
