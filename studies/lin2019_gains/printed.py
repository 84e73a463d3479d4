"""What the paper prints, each number with its place, and what follows from the numbers of one axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, NamedTuple

from flexdesign import units
from flexdesign.control import PID, Plant, Ultimate
from flexdesign.control.ziegler_nichols import from_rule


class Sourced(NamedTuple):
    """A printed number: what it is, as printed for X/Y and for Z, its SI unit, and its place in the paper."""

    meaning: str
    xy: str
    z: str
    si: str
    place: str


#: Every number that enters. All else is computed.
PRINTED = {
    "gain": Sourced("static gain", "6.0777", "6.3621", "1", "eq (31)"),
    "t1": Sourced("first time constant", "0.0013708 s", "0.00089631 s", "s", "eq (31)"),
    "t2": Sourced("second time constant", "0.0013635 s", "0.00089631 s", "s", "eq (31)"),
    "kp": Sourced("proportional gain", "0.01355", "0.04894", "1", "eq (34)"),
    "ti": Sourced("integral time", "0.003988 s", "0.003134 s", "s", "eq (34)"),
    "td": Sourced("derivative time", "0.000997 s", "0.0007835 s", "s", "eq (34)"),
    "period": Sourced("sampling interval", "0.001 s", "0.001 s", "s", "eq (33)"),
    "stiffness": Sourced("output stiffness, model", "18.3 N/mm", "25.6 N/mm", "N/m", "Table 1"),
    "fea_stiffness": Sourced("output stiffness, FEA", "19.0 N/mm", "24.1 N/mm", "N/m", "Table 1"),
    "input_stiffness": Sourced("input stiffness, model", "1.8 N/um", "2.6 N/um", "N/m", "Table 1"),
    "stroke": Sourced("motion at 120 V", "238 um", "202 um", "m", "section 4.2, Fig 7"),
    "moved": Sourced("motion in the coupling test", "262.64 um", "222.96 um", "m", "section 4.2, Figs 9, 11"),
    "input": Sourced("input in the coupling test", "40 um", "40 um", "m", "section 4.2"),
    "overshoot": Sourced("overshoot, open loop", "30 um", "", "m", "section 4.3.2, Fig 13"),
    "settling": Sourced("settling time, open loop", "0.4 s", "", "s", "section 4.3.2, Fig 13"),
    "shorter": Sourced("settling time saved by PID, more than", "50 %", "", "1", "section 4.3.2"),
}


@dataclass(frozen=True)
class Axis:
    """An axis as the paper prints it; `column` is its column of `PRINTED`."""

    name: str
    column: Literal["xy", "z"]

    def text(self, key: str) -> str:
        """Return a number as printed; empty where the paper prints none for this axis."""
        return str(getattr(PRINTED[key], self.column))

    def __getitem__(self, key: str) -> float:
        return units.from_text(self.text(key), PRINTED[key].si)

    def half_digit(self, key: str) -> float:
        """Return half a unit of the last digit printed, in SI."""
        number, _, unit = self.text(key).partition(" ")
        exponent = Decimal(number).as_tuple().exponent
        return 0.5 * 10.0 ** int(exponent) * units.factor(unit or "1", PRINTED[key].si)

    @property
    def model(self) -> Plant:
        """The printed transfer function."""
        return Plant.from_time_constants(self["gain"], self["t1"], self["t2"])

    @property
    def pid(self) -> PID:
        """The printed gains."""
        return PID(self["kp"], self["ti"], self["td"])

    @property
    def target(self) -> Ultimate:
        """The ultimate gain and period that the printed gains stand for."""
        return from_rule(self.pid)

    @property
    def loop_gain(self) -> float:
        """Ultimate gain times static gain: how small a loop gain at rest already oscillates."""
        return self.target.gain * self["gain"]

    @property
    def mass(self) -> float:
        """Table 1's stiffness times both time constants of eq (31) [kg]."""
        return self["stiffness"] * self["t1"] * self["t2"]

    def mass_of(self, plant: Plant) -> float:
        """Return the mass that puts Table 1's stiffness at the plant's natural frequency [kg]."""
        return self["stiffness"] / (2 * math.pi * plant.natural_frequency) ** 2

    def amplifications(self) -> dict[str, float]:
        """Return output over input motion by each place that tells it."""
        return {
            "eq (30) with (31)": self["input_stiffness"] / (4 * self["stiffness"] * self["gain"]),
            "eq (31), as gain from input to output motion": self["gain"],
            "Fig 7, motion at 120 V over the input of the coupling test": self["stroke"] / self["input"],
            "Figs 9 and 11, coupling test": self["moved"] / self["input"],
        }


AXES = (Axis("X/Y", "xy"), Axis("Z", "z"))


def frequency_bound(axis: Axis) -> float:
    """Return the lowest natural frequency that any delay and damping can give [Hz].

    At the limit of stability 1 - r^2 + 2j zeta r = -KuK exp(-j theta) with r = fu/f0, so that r^2 <= 1 + KuK.
    """
    return 1 / (axis.target.period * math.sqrt(1 + axis.loop_gain))


def damping_bound(axis: Axis) -> float:
    """Return the largest damping ratio that any delay can give: from the same, 2 zeta r <= KuK and r^2 >= 1 - KuK."""
    return axis.loop_gain / (2 * math.sqrt(1 - axis.loop_gain))
