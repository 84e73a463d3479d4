"""A mechanism as members between nodes: what hinge theory needs to know of a part, whosoever it is.

Frame: x along the input, y along the output, z out of the plane; metres and radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model.notch import Notch

Vector = tuple[float, float, float]
MemberKind = Literal["hinge", "arm", "rod", "block", "guide", "stub"]
RootKind = Literal["end", "flank", "block"]


@dataclass(frozen=True)
class Root:
    """What a member runs into at one of its ends.

    Parameters
    ----------
    kind
        ``end``: the end of a thicker beam on the same axis. ``flank``: the side of a beam that runs across and bends.
        ``block``: the side of a body that a mirror image of the member pulls at from behind.
    depth
        Thickness of an ``end``'s or ``flank``'s beam; of a ``block`` the distance to the plane of its mirror [m].
    overhang
        How far the body reaches beyond the member's axis on its nearer side [m]; not asked for an ``end``.
    side
        1 if that side is to the left of the member's axis, seen from its start to its end; -1 to the right.
    height
        Of a ``flank``, the distance along its beam from the member's axis to where the beam is held [m].
    """

    kind: RootKind
    depth: float
    overhang: float = math.inf
    side: Literal[1, -1] = 1
    height: float = math.inf


@dataclass(frozen=True)
class Member:
    """A slender piece of a mechanism, prismatic along its axis unless it has fillets or a notch.

    Parameters
    ----------
    name, kind
        ``hinge_1`` and ``hinge``.
    nodes
        Names of the two nodes it joins.
    start, end
        Positions of its two ends on the neutral axis [m].
    thickness
        Its in-plane thickness [m]; for a curved hinge the thickness of the neck.
    width
        Its out-of-plane depth [m].
    root_radius
        Fillet radius at its ends [m]; 0 for a sharp root.
    curvature_radius
        Radius of a circular notch [m]; infinite for a leaf.
    notch
        A notch of another shape; None for a leaf or a circular notch.
    roots
        What its start and its end run into, where theory needs to know; None at the other ends.
    lever
        Of a rod: how far to the left of its axis the hinge lies that bends it, seen from its start, the tip, to its
        end [m].
    """

    name: str
    kind: MemberKind
    nodes: tuple[str, str]
    start: Vector
    end: Vector
    thickness: float
    width: float
    root_radius: float = 0.0
    curvature_radius: float = math.inf
    roots: tuple[Root | None, Root | None] = (None, None)
    lever: float = 0.0
    notch: Notch | None = None

    @property
    def length(self) -> float:
        """Distance between the ends [m]."""
        return math.dist(self.start, self.end)

    @property
    def centre(self) -> Vector:
        """Middle of the member [m]."""
        return tuple((a + b) / 2 for a, b in zip(self.start, self.end, strict=True))  # type: ignore[return-value]

    @property
    def axis(self) -> Vector:
        """Unit vector from start to end."""
        return tuple((b - a) / self.length for a, b in zip(self.start, self.end, strict=True))  # type: ignore[return-value]

    @property
    def area(self) -> float:
        """Cross-section [m^2]."""
        return self.thickness * self.width

    @property
    def second_moment(self) -> float:
        """Second moment of area for bending in the plane [m^4]."""
        return self.width * self.thickness**3 / 12

    @property
    def profile(self) -> Notch | None:
        """The notch, circular or not; None for a leaf."""
        if math.isfinite(self.curvature_radius):
            return Notch.circular(self.curvature_radius, self.length / 2)
        return self.notch

    def thickness_at(self, s: float) -> float:
        """Return the nominal thickness at the distance `s` from the member's centre [m].

        Root fillets thicken a leaf near its ends; a notch thickens away from its neck.
        """
        return float(self.thicknesses(np.array([s]))[0])

    def thicknesses(self, s: Array) -> Array:
        """Return the nominal thickness at each of several distances from the centre, as `thickness_at` [m]."""
        if (notch := self.profile) is not None:
            return np.asarray(self.thickness + 2 * notch.rise(s))
        if self.root_radius == 0:
            return np.full(np.shape(s), self.thickness)
        into = np.clip(np.abs(s) - (self.length / 2 - self.root_radius), 0.0, self.root_radius)
        sagitta = self.root_radius - np.sqrt((self.root_radius - into) * (self.root_radius + into))
        return np.asarray(self.thickness + 2 * sagitta)


@dataclass(frozen=True)
class Linkage:
    """Members between nodes, and which nodes are the ports.

    Parameters
    ----------
    nodes
        Node name -> position [m].
    members
        The members, each between two named nodes.
    ports
        Port name -> node name.
    """

    nodes: Mapping[str, Vector]
    members: tuple[Member, ...]
    ports: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for member in self.members:
            for node in member.nodes:
                if node not in self.nodes:
                    raise ValueError(f"member {member.name} joins {node}, which is not among the nodes")
        for port, node in self.ports.items():
            if node not in self.nodes:
                raise ValueError(f"port {port} stands on {node}, which is not among the nodes")

    @property
    def slender(self) -> tuple[Member, ...]:
        """The members that are beams by their shape: all but blocks and stubs."""
        return tuple(member for member in self.members if member.kind not in ("block", "stub"))

    def of_kind(self, kind: MemberKind) -> tuple[Member, ...]:
        """Return the members of one kind."""
        return tuple(member for member in self.members if member.kind == kind)
