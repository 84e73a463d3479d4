"""Solids with rigid bores, and their ports: the subjects of `test_rigid_bores` and of the reference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cadquery as cq

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Bore:
    """A port, by a point on its axis, the axis and the radius [mm]; a plane face, by its normal, without a radius."""

    point: Vector
    axis: Vector
    radius: float = 0.0

    def table(self, name: str) -> str:
        """Return the port's table in a design."""
        place = ", ".join(f'"{x:g} mm"' for x in self.point)
        way, size = ("axis", f'radius = "{self.radius:g} mm"\n') if self.radius else ("normal", "")
        return f'\n[ports.{name}]\npoint = [{place}]\n{way} = {list(self.axis)}\n{size}interface = "rigid"\n'


#: Ground and output of each.
PORTS = {
    "bush": (Bore((0, 0, 3), (0, 0, 1), 15), Bore((0, 0, 3), (0, 0, 1), 5)),
    "thin_bush": (Bore((0, 0, 6), (0, 0, 1), 8), Bore((0, 0, 6), (0, 0, 1), 6)),
    "link": (Bore((-18, 0, 4), (0, 0, 1), 4), Bore((18, 0, 4), (0, 0, 1), 4)),
    "lug": (Bore((0, -20, 3), (0, -1, 0)), Bore((0, 0, 3), (0, 0, 1), 5.5)),
    "flanged": (Bore((0, 0, 3), (0, 0, 1), 14), Bore((0, 0, 3), (0, 0, 1), 4)),
    "crossed": (Bore((-14, 0, 0), (0, 0, 1), 3), Bore((15, 0, 0), (0, 1, 0), 2)),
    "clevis": (Bore((5, 0, 0), (0, 1, 0), 3), Bore((20, 0, 0), (0, 0, 1), 4)),
}  # fmt: skip
#: Middles of re-entrant edges [mm].
REENTRANT = {"flanged": [(0, 0, 4)], "clevis": [(10, 0, 6), (10, 0, -6)]}


def drill(point: Vector, plane: str, radius: float) -> cq.Workplane:
    """Return a long cylinder."""
    return cq.Workplane(plane).circle(radius).extrude(40, both=True).translate(point)


def solid(name: str) -> cq.Workplane:
    """Return a solid [mm]."""
    flat = cq.Workplane()
    if name == "bush":
        return flat.circle(15).circle(5).extrude(6)
    if name == "thin_bush":
        return flat.circle(8).circle(6).extrude(12)
    if name == "link":
        return flat.slot2D(50, 14).extrude(8).cut(drill((-18, 0, 0), "XY", 4)).cut(drill((18, 0, 0), "XY", 4))
    if name == "lug":
        base = cq.Workplane().box(16, 20, 6).translate((0, -10, 3))
        return flat.circle(8).extrude(6).union(base).cut(drill((0, 0, 0), "XY", 5.5))
    if name == "flanged":
        return flat.circle(14).extrude(4).union(cq.Workplane().circle(7).extrude(16)).cut(drill((0, 0, 0), "XY", 4))
    if name == "crossed":
        return flat.box(40, 10, 10).cut(drill((-14, 0, 0), "XY", 3)).cut(drill((15, 0, 0), "XZ", 2))
    fork = flat.box(30, 20, 24).translate((15, 0, 0)).cut(cq.Workplane().box(22, 22, 12).translate((21, 0, 0)))
    return fork.edges("|Z and >X").fillet(9.5).cut(drill((20, 0, 0), "XY", 4)).cut(drill((5, 0, 0), "XZ", 3))


def write(name: str, folder: Path) -> Path:
    """Write STEP file and design of a solid; return the design."""
    cq.exporters.export(solid(name), str(folder / f"{name}.step"))
    tables = [bore.table(port) for port, bore in zip(("ground", "output"), PORTS[name], strict=True)]
    design = folder / f"{name}.toml"
    design.write_text(f'format = 1\npart = "{name}.step"\nmaterial = "Al 7075-T6"\n' + "".join(tables))
    return design
