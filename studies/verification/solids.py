"""Structured meshes that need no mesher: boxes of tetrahedra, bent into the shape of a problem.

A lattice of cells is filled with six tetrahedra each and its points are mapped. On which side of the body a node lies
is read off its place in the lattice, before the mapping.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from skfem import MeshTet

from flexdesign.design.materials import Material
from flexdesign.design.part import Port, SymmetryPlane
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TaggedMesh, boundary, mirror_mesh
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.large_displacement import LargeDisplacement
from flexdesign.fem.solving.solver import factorize

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


def tag_facets(points: Array, tets: Array, patches: Mapping[str, Where]) -> tuple[TaggedMesh, dict[str, int]]:
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
        mesh, index = tag_facets(*cells, {**cuts, **patches})
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
        points, tets, _ = mirror_mesh(self.mesh.points, self.mesh.tets, self.domain.planes, {})
        return Solid.of(weld_points(points, tets), patches, self.ports, (), self.material)

    @property
    def body(self) -> Elasticity:
        """The discretised body."""
        return Elasticity(self.mesh, self.material)


def weld_points(points: Array, tets: Array, within: float = 1e-10) -> tuple[Array, Array]:
    """Join points that coincide."""
    _, first, inverse = np.unique(np.round(points / within), axis=0, return_index=True, return_inverse=True)
    return points[first], inverse.reshape(-1)[tets]


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


def hold_ground(solid: Solid) -> LargeDisplacement:
    """Return the body for large displacements, its ground held."""
    whole = port_compliance.classes(solid.domain)[0]
    body = solid.body
    return LargeDisplacement(body, statics.free_dofs(body, solid.domain, whole, [solid.domain.ports["ground"]]))


@dataclass(frozen=True)
class Bent:
    """A lattice that is mapped into a body, and the places in the lattice of its nodes."""

    flat: TaggedMesh
    shape: Where
    material: Material
    patches: Mapping[str, int]

    @classmethod
    def of(
        cls, cells: tuple[Array, Array], shape: Where, material: Material, patches: Mapping[str, Where] | None = None
    ) -> Bent:
        """Map a lattice.

        `shape` returns points for places, (n, 3) each, and must not turn cells inside out; `patches` finds the ports by
        name, in the lattice.
        """
        mesh, index = tag_facets(*cells, patches or {})
        return cls(mesh, shape, material, index)

    @cached_property
    def body(self) -> Elasticity:
        """The discretised body."""
        return Elasticity(replace(self.flat, points=self.shape(self.flat.points)), self.material)

    @cached_property
    def places(self) -> Array:
        """Places of the nodes in the lattice, shape (n, 3); the numbering is that of `body`."""
        return Elasticity(self.flat, self.material).positions

    def domain(self, *planes: SymmetryPlane) -> Domain:
        """Return the domain with its ports, for the classes of fields that are even or odd in planes."""
        return Domain((), planes, dict(self.patches), tuple(() for _ in planes), self.body.mesh.volume, "")

    def side(self, axis: str, value: float) -> Array:
        """Return the nodes on a plane of the lattice."""
        return np.flatnonzero(at(axis, value)(self.places))

    def facets(self, axis: str, value: float) -> Array:
        """Return the boundary facets on a plane of the lattice, shape (k, 3)."""
        return self.flat.facets[at(axis, value)(self.flat.points[self.flat.facets].mean(axis=1))]

    def node(self, *place: float) -> int:
        """Return the node nearest to a place in the lattice."""
        return int(np.linalg.norm(self.places - np.array(place), axis=1).argmin())

    def free(self, *held: tuple[Array, str]) -> Array:
        """Return the degrees of freedom left when some components, e.g. ``"xy"``, are held at some nodes."""
        dofs = [3 * nodes + "xyz".index(component) for nodes, components in held for component in components]
        return np.setdiff1d(np.arange(self.body.n_dofs), np.concatenate(dofs))

    def solve(self, free: Array, forces: Array) -> Array:
        """Return the displacements of the nodes (n, 3) under nodal forces (n_dofs,)."""
        factor = factorize(self.body.stiffness()[free][:, free].tocsr())
        moved = np.zeros(self.body.n_dofs)
        moved[free] = factor.solve(forces[free])
        factor.free()
        return moved.reshape(-1, 3)


def graded_intervals(first: float, last: float, count: int, growth: float = 1.0) -> Array:
    """Return `count` intervals from `first` to `last`, each `growth` times as long as the one before."""
    steps = growth ** np.arange(count)
    return first + (last - first) * np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])
