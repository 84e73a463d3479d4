"""The tables of a sketch, as files write them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from flexdesign.core.toml_files import Table, whole

#: A number with a unit, or arithmetic.
Text = str | int | float
Mirror = Literal["", "x", "y", "xy"]


class Repeated(Table):
    """A piece with its images."""

    mirror: Mirror = ""
    repeat: whole(1, 12) = 1  # type: ignore[valid-type]


class PlateTable(Table):
    """The plate that the mechanism is cut from."""

    thickness: Text = Field(examples=['thickness = "12 mm"'])


class BodyTable(Repeated):
    """A body: a box by two opposite corners, or a polygon by its corners in turn."""

    name: str
    box: tuple[Text, Text, Text, Text] | None = None
    polygon: list[tuple[Text, Text]] | None = None


class FlexureTable(Repeated):
    """A flexure by its two ends, or by its middle, direction and length."""

    name: str
    between: tuple[str, str]
    start: tuple[Text, Text] | None = Field(default=None, alias="from")
    end: tuple[Text, Text] | None = Field(default=None, alias="to")
    at: tuple[Text, Text] | None = None
    direction: Text = "0 deg"
    length: Text | None = None
    thickness: Text
    profile: Literal["leaf", "circular", "elliptic", "parabolic", "v"] = "leaf"
    depth: Text | None = None
    fillet: Text = 0
    kind: Literal["hinge", "rod"] = "hinge"


class PortTable(Repeated):
    """A port: the outermost straight side of a body in a direction."""

    role: Literal["ground", "input", "output"]
    body: str
    side: Literal["-x", "+x", "-y", "+y"]
    name: str = ""
    axis: str | list[str] = ""

    @property
    def axes(self) -> list[str]:
        """The axis of each turned image."""
        return self.axis if isinstance(self.axis, list) else [self.axis] * self.repeat


class SketchTables(Table):
    """All of them."""

    plate: PlateTable
    derived: dict[str, Text] = Field(default_factory=dict)
    body: list[BodyTable]
    flexure: list[FlexureTable]
    port: list[PortTable]
    active_axis: str = ""

    def of_role(self, role: str) -> list[PortTable]:
        """Return the ports of a role."""
        return [port for port in self.port if port.role == role]
