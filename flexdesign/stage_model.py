"""The stage model: what FEM hands to dynamics, axis by axis, in a file that people can read.

Mass, stiffness and gain are those with the actuators installed: stack and seats in series, in place of a free input.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from flexdesign import units
from flexdesign.files import FORMAT


@dataclass(frozen=True)
class AxisModel:
    """One axis of a stage, in SI.

    Parameters
    ----------
    mass
        Lumped: what gives the mode that carries most of the output's compliance its frequency on `stiffness` [kg].
    stiffness
        At the output, actuator installed [N/m].
    stroke
        Output motion for the actuator's whole free stroke, signed [m].
    free_stroke
        That free stroke [m].
    voltage
        Voltage span of the free stroke [V]; None if unknown, and then there is no gain per volt.
    input_stiffness, amplification
        At the actuator, output free [N/m], and output motion per extension, signed.
    actuator_stiffness
        Stack and seats in series [N/m].
    modal_share
        What part of the output's compliance that mode carries; the rest belongs to modes this model does not have.
    uncertainty
        Half-width, relative, by field; of the discretisation alone.
    """

    mass: float
    stiffness: float
    stroke: float
    free_stroke: float
    voltage: float | None
    input_stiffness: float
    amplification: float
    actuator_stiffness: float
    modal_share: float
    uncertainty: Mapping[str, float] = field(default_factory=dict)

    @property
    def natural_frequency(self) -> float:
        """Of the output's mode with the actuator installed [Hz]."""
        return float((self.stiffness / self.mass) ** 0.5 / (2 * math.pi))


@dataclass(frozen=True)
class StageModel:
    """Axes by name, and where the numbers come from."""

    axes: Mapping[str, AxisModel]
    source: str

    def to_toml(self) -> str:
        """Return the model as TOML, every number with its unit."""
        lines = [f"# Stage model. {self.source}", f"format = {FORMAT}", ""]
        for name, axis in self.axes.items():
            lines += [f"[axis.{name}]", *_axis(axis), ""]
            lines += [f"[axis.{name}.actuator]", *_actuator(axis), ""]
        return "\n".join(lines)


def _axis(axis: AxisModel) -> list[str]:
    def text(value: float, unit: str, si: str) -> str:
        return f'"{units.to_text(value, unit, digits=6, si=si)}"'

    per_volt = axis.voltage is not None
    gain = axis.stroke / (axis.voltage or axis.free_stroke)
    uncertainty = ", ".join(
        f'{key} = "{units.significant(100 * value, 2)} %"' for key, value in axis.uncertainty.items()
    )
    return [
        f"mass = {text(axis.mass, 'g', 'kg')}",
        f"# lumped: its mode ({units.to_text(axis.natural_frequency, 'Hz')}) carries "
        f"{units.significant(100 * axis.modal_share, 3)} % of 1/stiffness; other modes carry the rest",
        f"stiffness = {text(axis.stiffness, 'N/mm', 'N/m')}          # at the output, actuator installed",
        f"gain = {text(gain, 'um/V' if per_volt else 'um/um', 'm/V' if per_volt else 'm/m')}"
        + ("" if per_volt else "              # per free stroke of the actuator; its voltage range is unknown"),
        f"input_stiffness = {text(axis.input_stiffness, 'N/um', 'N/m')}    # output free",
        f"amplification = {units.significant(axis.amplification, 6)}                # output free, signed",
        f"uncertainty = {{ {uncertainty} }}    # half-widths, discretisation alone",
        "# damping_ratio: not known from geometry; identify it from a measured step or frequency response",
    ]


def _actuator(axis: AxisModel) -> list[str]:
    return [
        f'free_stroke = "{units.to_text(axis.free_stroke, "um", si="m")}"',
        f'stiffness = "{units.to_text(axis.actuator_stiffness, "N/um", si="N/m")}"   # stack and seats in series',
    ]
