"""A part condensed to its ports: stiffness and mass between amplitudes of port shapes and of internal vectors.

Craig and Bampton (1968), AIAA Journal 6(7): with the faces of the ports moving in the shapes of `port_shapes`, of
amplitudes q, the inside follows statically, and moves besides in internal vectors while the ports rest:

    u = Psi q + Z eta,     K_ii Psi_i = -K_ib Phi.

The internal vectors are the lowest modes with all ports held, and where an actuator pushes the answers K_ii^-1 f to its
ports' unit loads (`ports`; attachment modes: Craig, 2000, AIAA 2000-1573): its ports are not bonded to anything, and
their faces stay free to deform. Both are exact in statics, and so is the sum.

The ground's port is one like the others: what is held is decided where parts are put together.

A symmetric part is condensed on its fundamental domain, symmetry class by symmetry class. A plane's reflection S takes
a motion u(x) of the faces to S u(S x), whose amplitudes are R q; a class is the space of all q with R q = +q or -q for
each plane, and condensed alone, as no class does work on another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from flexdesign.design.materials import Material
from flexdesign.design.part import Piece, SymmetryPlane
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.solving import modes, port_compliance
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.port_compliance import PortSpace, SymmetryClass
from flexdesign.fem.solving.port_shapes import Motions, PortShapes, rigid_motions
from flexdesign.fem.solving.solver import factorize, times
from flexdesign.fem.solving.statics import dofs_on

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Interior:
    """The fundamental domain, and how it and its mirror images move with the amplitudes.

    Parameters
    ----------
    body
        The domain's elements.
    planes
        The planes it is mirrored in.
    vectors
        Displacements of its degrees of freedom by amplitude, shape (n_dofs, n + m).
    reflections
        For each plane R, the amplitudes of S u(S x), shape (n + m, n + m).
    """

    body: Elasticity
    planes: tuple[SymmetryPlane, ...]
    vectors: FloatArray
    reflections: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Superelement:
    """A condensed part: n amplitudes of the bonded ports' shapes first, then m of internal vectors.

    Parameters
    ----------
    shapes
        Of each bonded port, in the part's order.
    stiffness, mass
        Shape (n + m, n + m): [N/m] and [kg] between the amplitudes.
    averages
        By port the motions of its face in the mean, those that its force and moment do work on, shape (6, n + m).
    extension
        What an actuator feels, motions of the input ports against their outward normals, shape (n + m,).
    material
        What it is made of.
    unknowns
        Of the mesh of the fundamental domain it was condensed from.
    interior
        What goes on inside, for pictures and for large displacements; None if nobody asked.
    """

    shapes: tuple[PortShapes, ...]
    stiffness: FloatArray
    mass: FloatArray
    averages: dict[str, FloatArray]
    extension: FloatArray
    material: Material
    unknowns: int
    interior: Interior | None = None

    @property
    def size(self) -> int:
        """Number of amplitudes of port shapes, n."""
        return sum(shapes.count for shapes in self.shapes)

    @property
    def internal(self) -> int:
        """Number of internal vectors, m."""
        return len(self.stiffness) - self.size

    def rows(self, port: str) -> slice:
        """Return where the amplitudes of a bonded port stand."""
        names = [shapes.port.name for shapes in self.shapes]
        first = sum(shapes.count for shapes in self.shapes[: names.index(port)])
        return slice(first, first + self.of(port).count)

    def of(self, port: str) -> PortShapes:
        """Return the shapes of a bonded port."""
        return next(shapes for shapes in self.shapes if shapes.port.name == port)

    def rigid(self) -> FloatArray:
        """Return the amplitudes of the part's six rigid motions about the origin, shape (n + m, 6)."""
        motions = np.zeros((len(self.stiffness), 6))
        for shapes in self.shapes:
            motions[self.rows(shapes.port.name)] = shapes.coordinates(lambda x: rigid_motions(x, np.zeros(3)))
        return motions

    def to_store(self) -> tuple[dict[str, FloatArray], dict[str, Any]]:
        """Return arrays and a JSON-ready table from which `from_store` makes the same superelement."""
        arrays = {"stiffness": self.stiffness, "mass": self.mass, "extension": self.extension}
        arrays |= {f"average {port}": rows for port, rows in self.averages.items()}
        if self.interior is not None:
            arrays |= {"vectors": self.interior.vectors}
            arrays |= {f"reflection {i}": each for i, each in enumerate(self.interior.reflections)}
        shapes = {each.port.name: {"size": each.size, "degree": each.degree} for each in self.shapes}
        return arrays, {"shapes": shapes, "unknowns": self.unknowns}

    @classmethod
    def from_store(
        cls, arrays: dict[str, FloatArray], table: dict[str, Any], piece: Piece, body: Elasticity, domain: Domain
    ) -> Superelement:
        """Rebuild a superelement of a piece from what `to_store` returned, and the body it was condensed from."""
        found = {port.name: port for port in piece.ports()}
        interior = None
        if "vectors" in arrays:
            reflections = tuple(arrays[f"reflection {i}"] for i in range(len(domain.planes)))
            interior = Interior(body, domain.planes, arrays["vectors"], reflections)
        averages = {key.partition(" ")[2]: rows for key, rows in arrays.items() if key.startswith("average ")}
        return cls(
            shapes=tuple(PortShapes(found[name], **sizes) for name, sizes in table["shapes"].items()),
            stiffness=arrays["stiffness"],
            mass=arrays["mass"],
            averages=averages,
            extension=arrays["extension"],
            material=body.material,
            unknowns=table["unknowns"],
            interior=interior,
        )

    def with_material(self, material: Material) -> Superelement:
        """Return the same shape of another isotropic material with the same Poisson's ratio.

        Stiffness goes with Young's modulus, mass with density; displacement shapes are the same.

        Raises
        ------
        ValueError
            If the ratio is another, or one of the materials is a crystal.
        """
        ours = self.material
        if ours.crystal is not None or material.crystal is not None or ours.poissons_ratio != material.poissons_ratio:
            raise ValueError(f"a part of {ours.name} does not apply to {material.name}: condense it again")
        return replace(
            self,
            stiffness=material.youngs_modulus / ours.youngs_modulus * self.stiffness,
            mass=material.density / ours.density * self.mass,
            material=material,
        )


@dataclass(frozen=True)
class _Share:
    """What one symmetry class gives: a basis of its q (n, d), and K, M, averages between q's and internal amplitudes.

    Of the whole part, and the internal vectors scaled for it.
    """

    cls: SymmetryClass
    basis: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    averages: FloatArray
    vectors: FloatArray

    @property
    def width(self) -> int:
        return self.basis.shape[1]


def condense(
    part: Piece,
    material: Material,
    domain: Domain,
    mesh: TaggedMesh,
    *,
    degree: int = 2,
    mode_count: int = 3,
    interior: bool = False,
    progress: Progress = lambda _: None,
) -> Superelement:
    """Condense a part, meshed on its fundamental domain, to its ports.

    Parameters
    ----------
    part, material, domain, mesh
        What to condense.
    degree
        Of the polynomials in which the faces of bonded ports may move, 1 at least.
    mode_count
        Internal modes to keep of each symmetry class; 0 for statics alone.
    interior
        Whether to keep what goes on inside, too.
    progress
        Receives a text about the progress.
    """
    body = Elasticity(mesh, material)
    stiffness, mass = body.stiffness(), body.mass()
    space = port_compliance.port_space(body, domain, part.ports())
    shapes = _shapes(part, domain, degree)
    reflections = [_reflection(shapes, plane) for plane in domain.planes]
    shares = []
    for cls in port_compliance.classes(domain):
        basis = _fitting(reflections, cls, sum(each.count for each in shapes))
        progress(f"{body.n_dofs} unknowns, {cls.name}")
        shares.append(_share(body, domain, cls, space, _bonded_motions(body, domain, shapes, basis), basis,
                             (stiffness, mass), mode_count))  # fmt: skip
    pairs = list(zip(shares, _ontos(shares), strict=True))
    k = np.sum([onto.T @ share.stiffness @ onto for share, onto in pairs], axis=0)
    m = np.sum([onto.T @ share.mass @ onto for share, onto in pairs], axis=0)
    averages = np.sum([share.averages @ onto for share, onto in pairs], axis=0)
    within = None
    if interior:
        vectors = np.sum([share.vectors @ onto for share, onto in pairs], axis=0)
        within = Interior(body, domain.planes, vectors, _on_all(reflections, shares))
    return Superelement(
        shapes=tuple(shapes),
        stiffness=(k + k.T) / 2,
        mass=(m + m.T) / 2,
        averages={port.name: averages[space.rows(port.name)] for port in space.ports},
        extension=space.extension @ averages,
        material=material,
        unknowns=body.n_dofs,
        interior=within,
    )


def _shapes(part: Piece, domain: Domain, degree: int) -> list[PortShapes]:
    images = {image: original for plane in domain.planes for image, original in plane.swaps.items()}
    found = {port.name: port for port in part.ports()}
    shapes = []
    for port in found.values():
        if port.role == "input":
            continue
        original = port.name
        while original not in domain.ports:
            original = images[original]
        reach = domain.faces[domain.ports[original]].points - np.array(found[original].point)
        shapes.append(PortShapes(port, float(np.abs(reach).max()), degree))
    return shapes


def _reflection(shapes: Sequence[PortShapes], plane: SymmetryPlane) -> FloatArray:
    """Return R, the amplitudes of S u(S x) from those of u, for the reflection in a plane."""
    names, starts = [each.port.name for each in shapes], np.cumsum([0, *(each.count for each in shapes)])
    swapped = {**plane.swaps, **{original: image for image, original in plane.swaps.items()}}
    whole = np.zeros((starts[-1], starts[-1]))
    for index, each in enumerate(shapes):
        onto = names.index(swapped.get(each.port.name, each.port.name))
        rows, columns = slice(starts[onto], starts[onto + 1]), slice(starts[index], starts[index + 1])
        whole[rows, columns] = shapes[onto].coordinates(_mirrored(each.at, plane.index))
    return whole


def _mirrored(motions: Motions, axis: int) -> Motions:
    signs = np.ones(3)
    signs[axis] = -1.0
    return lambda places: signs[:, None] * motions(places * signs)


def _fitting(reflections: Sequence[FloatArray], cls: SymmetryClass, size: int) -> FloatArray:
    """Return an orthonormal basis, shape (size, d), of the amplitudes that belong to a class."""
    projector = np.eye(size)
    for reflection, sign in zip(reflections, cls.signs, strict=True):
        projector = projector @ (np.eye(size) + sign * reflection) / 2
    return np.asarray(scipy.linalg.orth(projector, rcond=1e-6))


def _bonded_motions(
    body: Elasticity, domain: Domain, shapes: Sequence[PortShapes], basis: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the degrees of freedom of the bonded faces in the domain, and their motions Phi by a basis of q."""
    faces, follow, first = [np.zeros(0, dtype=np.int64)], np.zeros((body.n_dofs, basis.shape[1])), 0
    for each in shapes:
        if each.port.name in domain.ports:
            dofs = dofs_on(body, [domain.ports[each.port.name]], range(3))
            values = each.at(body.positions[dofs[::3] // 3]).reshape(-1, each.count)
            follow[dofs] = values @ basis[first : first + each.count]
            faces.append(dofs)
        first += each.count
    return np.concatenate(faces), follow


def _share(
    body: Elasticity,
    domain: Domain,
    cls: SymmetryClass,
    space: PortSpace,
    followed: tuple[IntArray, FloatArray],
    basis: FloatArray,
    matrices: tuple[sp.csr_matrix, sp.csr_matrix],
    mode_count: int,
) -> _Share:
    """Condense one class."""
    (stiffness, mass), (faces, vectors), copies = matrices, followed, domain.copies
    planes = [dofs_on(body, nodes, cls.held_components(i)) for i, nodes in enumerate(domain.plane_faces)]
    interior = np.setdiff1d(np.arange(body.n_dofs), np.concatenate([faces, *planes]))
    factor = factorize(stiffness[interior][:, interior].tocsr())
    vectors[interior] = -factor.solve(times(stiffness, vectors)[interior])
    loads, projection = np.hstack([space.loads[name] for name in space.retained]), space.projection(cls)
    pushed = loads[:, np.any(projection != 0, axis=1) & space.of_role("input")][interior]
    internal = [factor.solve(pushed)] if pushed.shape[1] else []
    if mode_count:
        internal.append(modes.lowest(mass[interior][:, interior], factor.solve, mode_count)[1])
    factor.free()
    width = sum(each.shape[1] for each in internal)
    vectors = np.hstack([vectors, np.zeros((body.n_dofs, width))])
    if width:  # of unit mass each, as amplitudes of forces and of modes differ by many orders
        inertia = times(mass[interior][:, interior], each := np.hstack(internal))
        vectors[interior, -width:] = each / np.sqrt(copies * np.einsum("ij,ij->j", each, inertia))
    cut = np.repeat([2.0 ** (len(space.planes) - space.swaps(name)) for name in space.retained], 6)
    return _Share(
        cls=cls,
        basis=basis,
        stiffness=copies * vectors.T @ times(stiffness, vectors),
        mass=copies * vectors.T @ times(mass, vectors),
        averages=projection.T @ (cut[:, None] * (loads.T @ vectors)),
        vectors=vectors,
    )


def _ontos(shares: Sequence[_Share]) -> list[FloatArray]:
    """Return for each class its amplitudes, q's and internal ones, by those of the whole part: q, then all internal."""
    back = np.linalg.inv(np.hstack([share.basis for share in shares]))
    inner = [len(share.stiffness) - share.width for share in shares]
    size, first, interior = len(back), 0, len(back)
    ontos = []
    for share, count in zip(shares, inner, strict=True):
        onto = np.zeros((len(share.stiffness), size + sum(inner)))
        onto[: share.width, :size] = back[first : first + share.width]
        onto[share.width :, interior : interior + count] = np.eye(count)
        first, interior = first + share.width, interior + count
        ontos.append(onto)
    return ontos


def _on_all(reflections: Sequence[FloatArray], shares: Sequence[_Share]) -> tuple[FloatArray, ...]:
    """Extend reflections from q to the internal amplitudes: those of a class are even or odd in a plane as it is."""
    whole = []
    for plane, reflection in enumerate(reflections):
        signs = [np.full(len(s.stiffness) - s.width, float(s.cls.signs[plane])) for s in shares]
        whole.append(scipy.linalg.block_diag(reflection, np.diag(np.concatenate(signs))))
    return tuple(whole)
