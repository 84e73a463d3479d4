"""In which units sizes of a response are written."""

from __future__ import annotations

#: The units of a response as a whole, and of errors, by its SI unit.
DEFAULT_UNITS = {"m": ("um", "um"), "V": ("V", "mV"), "rad": ("urad", "urad")}
#: The same per volt, for frequency responses.
DEFAULT_UNITS |= {f"{si}/V": (f"{large}/V", f"{small}/V") for si, (large, small) in DEFAULT_UNITS.items()}


class ResponseUnits(str):
    """The SI unit of a response, which knows in which units sizes of it are written.

    To all who compute it is the SI unit and nothing else.

    Parameters
    ----------
    si
        The SI unit.
    unit
        That which the stage model says; empty for the usual ones.

    >>> ResponseUnits("rad"), ResponseUnits("rad").small
    ('rad', 'urad')
    >>> ResponseUnits("rad", "mrad").small, ResponseUnits("rad", "mrad").per_volt.large
    ('mrad', 'mrad/V')
    """

    __slots__ = ("unit",)
    unit: str

    def __new__(cls, si: str, unit: str = "") -> ResponseUnits:
        """Make one."""
        made = super().__new__(cls, si)
        made.unit = unit
        return made

    @property
    def large(self) -> str:
        """The unit of the response as a whole."""
        return self.unit or DEFAULT_UNITS[self][0]

    @property
    def small(self) -> str:
        """The unit of errors."""
        return self.unit or DEFAULT_UNITS[self][1]

    @property
    def per_volt(self) -> ResponseUnits:
        """The same for a response per volt."""
        return ResponseUnits(f"{self}/V", f"{self.unit}/V" if self.unit else "")
