"""What the paper prints, each number with its place, and what follows from the numbers of one axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from flexdesign.core import printed_numbers, units
from flexdesign.dynamics.control import PID, Plant, Ultimate
from flexdesign.dynamics.control.ziegler_nichols import from_rule


class PrintedNumber(NamedTuple):
    """A printed number: what it is, as printed for X/Y and for Z, its SI unit, and its place in the paper."""

    meaning: str
    xy: str
    z: str
    si: str
    place: str


PAPER = printed_numbers.read("lin2019")


def _printed_number(meaning: str, si: str, xy: tuple[str, str], z: tuple[str, str] | None) -> PrintedNumber:
    """Return a number of studies/lin2019.toml, by place and name for X/Y and for Z; None where none is printed."""
    return PrintedNumber(meaning, PAPER(*xy).text, PAPER(*z).text if z else "", si, xy[0])


def _both(meaning: str, si: str, place: str, name: str) -> PrintedNumber:
    """Return a number that is printed for X/Y and for Z."""
    return _printed_number(meaning, si, (place, f"{name}_xy"), (place, f"{name}_z"))


_FIG_7, _FIG_9, _FIG_13 = "section 4.2, Fig 7", "section 4.2, Figs 9 to 11", "section 4.3.2, Fig 13"
#: Every number that enters. All else is computed.
PRINTED = {
    "gain": _both("static gain", "1", "eq (31)", "gain"),
    "t1": _both("first time constant", "s", "eq (31)", "t1"),
    "t2": _both("second time constant", "s", "eq (31)", "t2"),
    "kp": _both("proportional gain", "1", "eq (34)", "kp"),
    "ti": _both("integral time", "s", "eq (34)", "ti"),
    "td": _both("derivative time", "s", "eq (34)", "td"),
    "period": _printed_number("sampling interval", "s", ("eq (33)", "period"), ("eq (33)", "period")),
    "stiffness": _both("output stiffness, model", "N/m", "Table 1, model", "K_out"),
    "fea_stiffness": _both("output stiffness, FEA", "N/m", "Table 1, FEA", "K_out"),
    "input_stiffness": _both("input stiffness, model", "N/m", "Table 1, model", "K_in"),
    "stroke": _both("motion at 120 V", "m", _FIG_7, "span"),
    "moved": _printed_number("motion in the coupling test", "m", (_FIG_9, "travel_x"), (_FIG_9, "travel_z")),
    "input": _printed_number("input in the coupling test", "m", (_FIG_9, "input"), (_FIG_9, "input")),
    "overshoot": _printed_number("overshoot, open loop", "m", (_FIG_13, "overshoot"), None),
    "settling": _printed_number("settling time, open loop", "s", (_FIG_13, "settling"), None),
    "shorter": _printed_number("settling time saved by PID, more than", "1", (_FIG_13, "shorter"), None),
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
        return printed_numbers.Printed(PRINTED[key].place, key, self.text(key)).half_digit(PRINTED[key].si)

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
        """The ultimate gain and period of the printed gains."""
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
        """Return output over input motion by each place that states it."""
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
