"""Small bodies for the tests: structured meshes that need no mesher, and parts that need no file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from skfem import MeshTet

from flexdesign.fem import ports, statics
from flexdesign.fem.domain import Domain
from flexdesign.fem.elasticity import Elasticity
from flexdesign.fem.mesh import TaggedMesh, boundary, mirrored
from flexdesign.fem.ports import PortSpace
from flexdesign.fem.statics import Checks
from flexdesign.materials import Material
from flexdesign.model import Linkage, Parameter, Quantity
from flexdesign.part import Axis, Port, SymmetryPlane

Array = np.ndarray[Any, Any]
Where = Callable[[Array], Array]

METAL = Material("metal", 70e9, 0.33, 2800.0, 500e6, "round numbers of aluminium")
#: Without lateral contraction a clamp disturbs neither tension nor pure bending: beam theory is exact there.
CORK = Material("cork", 70e9, 0.0, 2800.0, 500e6, "aluminium without lateral contraction")


def lattice(
    x: Array, y: Array, z: Array, inside: Where | None = None, wobble: float = 0.0, seed: int = 1
) -> tuple[Array, Array]:
    """Return points and positively oriented tetrahedra, six to a cell, of the cells whose centre is `inside`.

    Points that lie within the box are moved at random by up to `wobble`, so that no two elements are alike.
    """
    mesh = MeshTet.init_tensor(x, y, z)
    points, tets = mesh.p.T.copy(), mesh.t.T.astype(np.int64)
    if inside is not None:
        middle = [(axis[:-1] + axis[1:]) / 2 for axis in (x, y, z)]
        corner = points[tets].mean(axis=1)
        cell = [
            m[np.searchsorted(axis, corner[:, i]) - 1]
            for i, (axis, m) in enumerate(zip((x, y, z), middle, strict=True))
        ]
        tets = tets[inside(np.stack(cell, axis=1))]
        used, tets = np.unique(tets, return_inverse=True)
        points, tets = points[used], tets.reshape(-1, 4)
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    negative = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0
    tets[negative] = tets[negative][:, [0, 1, 3, 2]]
    if wobble:
        free = np.setdiff1d(np.arange(len(points)), boundary(tets))
        points[free] += wobble * np.random.default_rng(seed).uniform(-1, 1, (len(free), 3))
    return points, tets


def tagged(points: Array, tets: Array, patches: Mapping[str, Where]) -> tuple[TaggedMesh, dict[str, int]]:
    """Tag the boundary facets by the first patch that holds their middle; the rest gets the last number."""
    facets = boundary(tets)
    middle = points[facets].mean(axis=1)
    faces = np.full(len(facets), len(patches), dtype=np.int64)
    for index, patch in reversed(list(enumerate(patches.values()))):
        faces[patch(middle)] = index
    return TaggedMesh(points, tets, facets, faces), {name: index for index, name in enumerate(patches)}


def at(axis: str, value: float, *limits: tuple[str, float, float]) -> Where:
    """Return the test for lying in a coordinate plane, within limits along other axes."""

    def test(x: Array) -> Array:
        held = np.abs(x[:, "xyz".index(axis)] - value) < 1e-9
        for name, low, high in limits:
            held &= (x[:, "xyz".index(name)] > low) & (x[:, "xyz".index(name)] < high)
        return held

    return test


@dataclass(frozen=True)
class Solid:
    """A meshed body with its ports, ready to be solved; `planes` bound it where it is a part of a symmetric whole."""

    mesh: TaggedMesh
    domain: Domain
    ports: tuple[Port, ...]
    material: Material = METAL

    @classmethod
    def of(
        cls,
        cells: tuple[Array, Array],
        patches: Mapping[str, Where],
        ports: Sequence[Port],
        planes: Sequence[SymmetryPlane] = (),
        material: Material = METAL,
    ) -> Solid:
        """Tag a lattice: `patches` finds the ports by name; cut planes are found where coordinates vanish."""
        cuts = {f"cut {plane.axis}": at(plane.axis, 0.0) for plane in planes}
        mesh, index = tagged(*cells, {**cuts, **patches})
        domain = Domain(
            faces=(),
            planes=tuple(planes),
            ports={name: index[name] for name in patches},
            plane_faces=tuple((index[name],) for name in cuts),
            volume=mesh.volume,
            fingerprint="",
        )
        return cls(mesh, domain, tuple(ports), material)

    def whole(self, patches: Mapping[str, Where]) -> Solid:
        """Return the whole body: mirrored, welded, and tagged anew by where facets are."""
        points, tets, _ = mirrored(self.mesh.points, self.mesh.tets, self.domain.planes, {})
        return Solid.of(welded(points, tets), patches, self.ports, (), self.material)

    @property
    def body(self) -> Elasticity:
        """The discretised body."""
        return Elasticity(self.mesh, self.material)


def welded(points: Array, tets: Array, within: float = 1e-10) -> tuple[Array, Array]:
    """Join points that coincide."""
    _, first, inverse = np.unique(np.round(points / within), axis=0, return_index=True, return_inverse=True)
    return points[first], inverse.reshape(-1)[tets]


@dataclass
class Solved:
    """All symmetry classes of a solid, solved for all port loads."""

    solid: Solid
    body: Elasticity
    stiffness: sp.csr_matrix
    space: PortSpace
    matrix: Array
    checks: list[Checks] = field(default_factory=list)
    systems: list[statics.ClassSystem] = field(default_factory=list)
    displacements: list[Array] = field(default_factory=list)


def solve(solid: Solid) -> Solved:
    """Solve every class; the factors stay, for modes."""
    body = solid.body
    stiffness = body.stiffness()
    space = ports.port_space(body, solid.domain, solid.ports)
    found = Solved(solid, body, stiffness, space, np.zeros((space.size, space.size)))
    for cls in ports.classes(solid.domain):
        system = statics.class_system(body, solid.domain, cls, stiffness, [solid.domain.ports["ground"]])
        share, checks, displacements, _ = statics.class_compliance(body, system, stiffness, space)
        found.matrix += share
        found.checks.append(checks)
        found.systems.append(system)
        found.displacements.append(displacements)
    return found


def full(upper: sp.csr_matrix) -> sp.csr_matrix:
    """Return the symmetric matrix that `upper` is the upper triangle of."""
    return (upper + sp.triu(upper, k=1).T).tocsr()


def relative(found: Array, expected: Array) -> float:
    """Return the largest difference of two compliances, entry by entry, against the geometric mean of its diagonals."""
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    return float(np.abs((found - expected) / scale).max())


# --- bodies -----------------------------------------------------------------------------------------------------


def beam(
    length: float,
    height: float,
    width: float,
    cells: tuple[int, int, int],
    material: Material = CORK,
    wobble: float = 0.0,
) -> Solid:
    """Return a beam along x from the ground at x = 0 to the output at its tip, centred on the axis."""
    x = np.linspace(0, length, cells[0] + 1)
    y = np.linspace(-height / 2, height / 2, cells[1] + 1)
    z = np.linspace(-width / 2, width / 2, cells[2] + 1)
    ends = (
        Port("output", "output", (length, 0.0, 0.0), (1.0, 0.0, 0.0)),
        Port("ground", "ground", (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    )
    cut = lattice(x, y, z, wobble=wobble)
    return Solid.of(cut, {"output": at("x", length), "ground": at("x", 0.0)}, ends, material=material)


RING_X, RING_Y, RING_Z = 20e-3, 15e-3, 4e-3
RING_PLANES = (SymmetryPlane("x", {"input_left": "input_right"}), SymmetryPlane("z", {}))
RING_PORTS = (
    Port("input_left", "input", (-14e-3, 0.0, 0.0), (1.0, 0.0, 0.0)),
    Port("input_right", "input", (14e-3, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    Port("output", "output", (0.0, RING_Y, 0.0), (0.0, 1.0, 0.0)),
    Port("ground", "ground", (0.0, -RING_Y, 0.0), (0.0, -1.0, 0.0)),
)
RING_PATCHES = {
    "input_right": at("x", 14e-3, ("y", -5e-3, 5e-3)),
    "input_left": at("x", -14e-3, ("y", -5e-3, 5e-3)),
    "output": at("y", RING_Y, ("x", -5e-3, 5e-3)),
    "ground": at("y", -RING_Y, ("x", -10e-3, 10e-3)),
}


def ring(material: Material = METAL) -> Solid:
    """Return a quarter of a ring like an amplifier's: thicker below than above, mirror images in x = 0 and z = 0."""
    x = np.array([0.0, 5e-3, 10e-3, 14e-3, 17e-3, RING_X])
    y = np.array([-RING_Y, -11e-3, -8e-3, -5e-3, 0.0, 5e-3, 12e-3, RING_Y])
    z = np.linspace(0.0, RING_Z, 3)

    def inside(c: Array) -> Array:
        return (c[:, 0] > 14e-3) | (c[:, 1] < -8e-3) | (c[:, 1] > 12e-3)

    kept = {name: RING_PATCHES[name] for name in ("input_right", "output", "ground")}
    return Solid.of(lattice(x, y, z, inside, wobble=3e-4), kept, RING_PORTS, RING_PLANES, material)


# --- parts ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bracket:
    """An upright T on a foot: mirror images in x = 0 and z = 0, an input on each side, plane faces only."""

    depth: float = 6e-3
    dimensions: ClassVar[tuple[Parameter, ...]] = ()

    def solid(self) -> Any:
        """Return the T [mm]."""
        import cadquery as cq

        outline = [(-4, 0), (4, 0), (4, 9), (9, 9), (9, 13), (-9, 13), (-9, 9), (-4, 9)]
        return cq.Workplane("XY").polyline(outline).close().extrude(self.depth * 500, both=True).solids().val()

    def ports(self) -> tuple[Port, ...]:
        """Return the ends of the bar, its top and the foot."""
        return (
            Port("input_left", "input", (-9e-3, 11e-3, 0.0), (-1.0, 0.0, 0.0)),
            Port("input_right", "input", (9e-3, 11e-3, 0.0), (1.0, 0.0, 0.0)),
            Port("output", "output", (0.0, 13e-3, 0.0), (0.0, 1.0, 0.0)),
            Port("ground", "ground", (0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        )

    def linkage(self) -> Linkage:
        """Return no members."""
        return Linkage({}, ())

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return both planes."""
        return RING_PLANES

    def prismatic(self) -> Axis | None:
        """Return z."""
        return "z"

    def formulas(self, material: Material, actuator_stiffness: float | None) -> Mapping[str, Sequence[Quantity]]:
        """Return none."""
        return {}

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return none."""
        return {}

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return none."""
        return {}


def misplaced(part: Any, name: str, **changes: Any) -> Any:
    """Return the part with one port changed."""

    class Misplaced(type(part)):  # type: ignore[misc]
        def ports(self) -> tuple[Port, ...]:
            return tuple(replace(port, **changes) if port.name == name else port for port in part.ports())

    return Misplaced()
