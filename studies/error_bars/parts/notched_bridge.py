"""The bridge amplifier on right-circular notches: that of `filleted_bridge.py`, its necks declared as circles."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from flexdesign.core.errors import InputError
from flexdesign.core.model import Linkage
from flexdesign.design import part

Filleted = part.load("filleted_bridge", Path(__file__).parent)


class NotchedBridge(Filleted):  # type: ignore[misc, valid-type]
    """A bridge amplifier on notches, declared by `Member.curvature_radius`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not math.isclose(2 * self.fillet_radius, self.hinge_length, rel_tol=1e-9):
            remedy = f"half of the hinge's length, {500 * self.hinge_length:g} mm, makes a right-circular notch"
            raise InputError("design", "dimensions.fillet_radius", f"{1e3 * self.fillet_radius:g} mm", remedy)

    def linkage(self) -> Linkage:
        """Return the bridge's linkage with notches in the place of leaves."""
        whole = super().linkage()
        notch = {"curvature_radius": self.fillet_radius, "root_radius": 0.0, "roots": (None, None)}
        return replace(whole, members=tuple(replace(m, **notch) if m.kind == "hinge" else m for m in whole.members))
