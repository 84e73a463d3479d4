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

    name: str = Field(examples=['name = "table"'])
    box: tuple[Text, Text, Text, Text] | None = None
    polygon: list[tuple[Text, Text]] | None = None


class FlexureTable(Repeated):
    """A flexure by its two ends, or by its middle, direction and length."""

    name: str = Field(examples=['name = "leaf"'])
    between: tuple[str, str] = Field(examples=['between = ["base", "table"]'])
    start: tuple[Text, Text] | None = Field(default=None, alias="from")
    end: tuple[Text, Text] | None = Field(default=None, alias="to")
    at: tuple[Text, Text] | None = None
    direction: Text = "0 deg"
    length: Text | None = None
    thickness: Text = Field(examples=['thickness = "0.5 mm"'])
    profile: Literal["leaf", "circular", "elliptic", "parabolic", "v"] = "leaf"
    depth: Text | None = None
    fillet: Text = 0
    kind: Literal["hinge", "rod"] = "hinge"


class PortTable(Repeated):
    """A port: the outermost straight side of a body in a direction, or the straight side on which a point lies."""

    role: Literal["ground", "input", "output"] = Field(examples=['role = "input"'])
    body: str = Field(examples=['body = "table"'])
    side: Literal["-x", "+x", "-y", "+y"] | None = None
    at: tuple[Text, Text] | None = None
    interface: Literal["traction", "rigid"] = "traction"
    name: str = ""
    axis: str | list[str] = ""

    @property
    def axes(self) -> list[str]:
        """The axis of each turned image."""
        return self.axis if isinstance(self.axis, list) else [self.axis] * self.repeat


class SketchTables(Table):
    """All of them."""

    plate: PlateTable = Field(examples=['[plate], and below it thickness = "12 mm"'])
    derived: dict[str, Text] = Field(default_factory=dict)
    body: list[BodyTable] = Field(
        examples=['body = [{ name = "base", box = ["0 mm", "0 mm", "30 mm", "10 mm"] }], one { } for each']
    )
    flexure: list[FlexureTable] = Field(
        examples=['flexure = [{ name = "leaf", between = [...], from = [...], to = [...], thickness = "0.5 mm" }]']
    )
    port: list[PortTable] = Field(
        examples=['port = [{ role = "input", body = "table", side = "-x" }], one { } for each']
    )
    active_axis: str = ""

    def of_role(self, role: str) -> list[PortTable]:
        """Return the ports of a role."""
        return [port for port in self.port if port.role == role]
