"""A whole stage as one body of finite elements: what condensed parts between rigid bodies are checked against.

Every part is meshed whole, every body box by box, all elastic. Where a part sits on a body, or a box on another, the
nodes of the finer face follow the other's displacement, u(x) = sum_a N_a(x) u_a in the element that x lies in: with D
their dependence on the nodes that are left, the stage's equations are

    D^T K D u = D^T f.

Parts keep their own meshes that way; only what goes on about a port within an element's size is left to interpolation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexdesign.design.assembly import Assembly, Box, Element, Placement
from flexdesign.design.materials import Material
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TaggedMesh, boundary
from flexdesign.fem.solving import modes
from flexdesign.fem.solving.elasticity import Elasticity, shape_functions
from flexdesign.fem.solving.solver import factorize
from studies.verification.loads import traction

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Places closer than this, relative to a mesh, are one.
SAME = 1e-7


@dataclass(frozen=True)
class WholePart:
    """A part's mesh with its mirror images, and its ports' facets by name."""

    mesh: TaggedMesh
    ports: Mapping[str, IntArray]


def mirror_part(mesh: TaggedMesh, domain: Domain) -> WholePart:
    """Return the whole part from the mesh of its fundamental domain."""
    points, tets = mesh.points, mesh.tets
    ports = {name: mesh.on_face(face) for name, face in domain.ports.items()}
    for plane in domain.planes:
        count, signs = len(points), np.where(np.arange(3) == plane.index, -1.0, 1.0)
        ports = _with_images(ports, {kept: image for image, kept in plane.swaps.items()}, count)
        points, tets = np.vstack([points, points * signs]), np.vstack([tets, tets[:, [0, 1, 3, 2]] + count])
        points, tets, ports = _weld(points, tets, ports)
    skin = boundary(tets)
    return WholePart(TaggedMesh(points, tets, skin, np.zeros(len(skin), dtype=np.int64)), ports)


def _with_images(ports: Mapping[str, IntArray], images: Mapping[str, str], count: int) -> dict[str, IntArray]:
    found: dict[str, IntArray] = {}
    for name, facets in ports.items():
        image = facets[:, [0, 2, 1]] + count
        if name in images:
            found |= {name: facets, images[name]: image}
        else:
            found[name] = np.vstack([facets, image])
    return found


def _weld(
    points: FloatArray, tets: IntArray, ports: Mapping[str, IntArray]
) -> tuple[FloatArray, IntArray, dict[str, IntArray]]:
    """Return a mesh with coincident points made one."""
    unit = SAME * np.ptp(points, axis=0).max()
    _, first, onto = np.unique(np.round(points / unit), axis=0, return_index=True, return_inverse=True)
    onto = onto.reshape(-1)
    return points[first], onto[tets], {name: onto[facets] for name, facets in ports.items()}


def box_mesh(box: Box, size: float) -> TaggedMesh:
    """Return a box as bricks of about this size [m], at least two along each edge, each cut into six tetrahedra."""
    counts = [max(2, round(edge / size)) for edge in box.size]
    axes = [c + np.linspace(-0.5, 0.5, n + 1) * s for c, s, n in zip(box.centre, box.size, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape([n + 1 for n in counts])
    corner = {
        (i, j, k): number[i : counts[0] + i, j : counts[1] + j, k : counts[2] + k].ravel()
        for i in (0, 1) for j in (0, 1) for k in (0, 1)
    }  # fmt: skip
    tets = []
    for way in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2), (2, 1, 0)):  # from corner to corner (Kuhn)
        path, at = [(0, 0, 0)], [0, 0, 0]
        for axis in way:
            at[axis] = 1
            path.append((at[0], at[1], at[2]))
        even = way in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        order = (0, 1, 2, 3) if even else (0, 1, 3, 2)
        tets.append(np.stack([corner[path[i]] for i in order], axis=1))
    stacked = np.vstack(tets)
    skin = boundary(stacked)
    return TaggedMesh(points, stacked, skin, np.zeros(len(skin), dtype=np.int64))


class MonolithicStage:
    """A stage's equations, all of its nodes.

    Parameters
    ----------
    assembly
        What is bonded to what; fixed bodies are rigid.
    parts
        The whole part of each element, by the element's name.
    material
        Of everything.
    box_size
        Edge length of the elements of the bodies [m].
    """

    def __init__(self, assembly: Assembly, parts: Mapping[str, WholePart], material: Material, box_size: float) -> None:
        self.assembly, self.parts = assembly, parts
        kinds = {id(part): Elasticity(part.mesh, material) for part in parts.values()}
        self._pieces = [_Piece(kinds[id(parts[e.name])], e.placement) for e in assembly.elements]
        self._boxes: dict[str, list[_Piece]] = {}
        for body in assembly.free_bodies:
            meshes = [Elasticity(box_mesh(box, box_size), material) for box in body.boxes]
            self._boxes[body.name] = [_Piece(mesh, Placement()) for mesh in meshes]
        every = [*self._pieces, *(piece for boxes in self._boxes.values() for piece in boxes)]
        starts = np.cumsum([0, *(piece.body.n_dofs for piece in every)])
        for piece, start in zip(every, starts[:-1].tolist(), strict=True):
            piece.start = start
        self._every, self._total = every, int(starts[-1])
        self._dependence = self._tie_matrix()

    @property
    def unknowns(self) -> int:
        """How many are left when ties and what is held are taken out."""
        return int(self._dependence.shape[1])

    def statics(self, loads: FloatArray) -> FloatArray:
        """Return displacements of all degrees of freedom under nodal forces, both (n, k)."""
        reduced = sp.triu(self._reduce("stiffness"), format="csr")
        factor = factorize(reduced)
        answer = self._dependence @ factor.solve(self._dependence.T @ loads)
        factor.free()
        return np.asarray(answer)

    def frequencies(self, count: int) -> FloatArray:
        """Return the lowest natural frequencies [Hz]."""
        factor = factorize(sp.triu(self._reduce("stiffness"), format="csr"))
        squares, _ = modes.lowest(sp.triu(self._reduce("mass"), format="csr"), factor.solve, count)
        factor.free()
        return np.asarray(np.sqrt(np.sort(squares)) / (2 * np.pi))

    def extension(self, element: str) -> FloatArray:
        """Return what an element's actuator feels, over all degrees of freedom, shape (n,)."""
        index = [e.name for e in self.assembly.elements].index(element)
        piece, part = self._pieces[index], self.parts[element]
        row = np.zeros(self._total)
        for port in self.assembly.elements[index].part.ports():
            if port.role == "input":
                facets, push = part.ports[port.name], -np.array(port.normal)
                forces = traction(piece.body, facets, partial(_everywhere, push))
                row[piece.dofs] += forces / (forces.reshape(-1, 3) @ push).sum()
        return row

    def translation(self, body: str) -> FloatArray:
        """Return the mean translation of a body's first box, as rows over all degrees of freedom, shape (3, n)."""
        piece = self._boxes[body][0]
        mass = piece.body.mass()
        whole = mass + sp.triu(mass, k=1).T
        rows = np.zeros((3, self._total))
        for axis in range(3):
            unit = np.tile(np.eye(3)[axis], piece.body.n_dofs // 3)
            rows[axis, piece.dofs] = (whole @ unit) / (unit @ whole @ unit)
        return rows

    def _reduce(self, what: str) -> sp.csr_matrix:
        made: dict[int, sp.csr_matrix] = {}
        blocks = []
        for piece in self._every:
            if id(piece.body) not in made:
                upper = getattr(piece.body, what)()
                made[id(piece.body)] = (upper + sp.triu(upper, k=1).T).tocsr()
            blocks.append(made[id(piece.body)])
        whole = sp.block_diag(blocks, format="csr")
        return (self._dependence.T @ whole @ self._dependence).tocsr()

    def _tie_matrix(self) -> sp.csr_matrix:
        """Return D, shape (n, unknowns)."""
        ties = list(self._ties())
        rows, columns = (np.concatenate([pair[i] for _, pair, _ in ties]) for i in (0, 1))
        follow = sp.csr_matrix((np.concatenate([w for _, _, w in ties]), (rows, columns)), (self._total, self._total))
        free = np.setdiff1d(np.arange(self._total), np.concatenate([places for places, _, _ in ties]))
        dependence = sp.csr_matrix((np.ones(len(free)), (free, np.arange(len(free)))), (self._total, len(free)))
        answer = dependence
        for _ in range(4):  # a box's node that others follow may follow a third
            dependence = follow @ dependence
            answer = answer + dependence
            if dependence.nnz == 0:
                break
        return answer.tocsr()

    def _ties(self) -> Iterator[tuple[IntArray, tuple[IntArray, IntArray], FloatArray]]:
        """Yield the degrees of freedom that follow, and (rows, columns), weights of what they follow."""
        for boxes in self._boxes.values():
            for index, piece in enumerate(boxes):
                nodes = np.unique(piece.body.surface_nodes(piece.body.mesh.facets))
                yield from _following(piece, nodes, boxes[:index])
        for element, piece in zip(self.assembly.elements, self._pieces, strict=True):
            yield from self._bond(element, piece)

    def _bond(
        self, element: Element, piece: _Piece
    ) -> Iterator[tuple[IntArray, tuple[IntArray, IntArray], FloatArray]]:
        for port, facets in self.parts[element.name].ports.items():
            if port not in element.bonds:
                continue
            nodes = np.unique(piece.body.surface_nodes(facets))
            if element.bonds[port] in self._boxes:
                yield from _following(piece, nodes, self._boxes[element.bonds[port]])
            else:  # held
                dofs = piece.start + (3 * nodes[:, None] + np.arange(3)).ravel()
                nothing = np.zeros(0, dtype=np.int64)
                yield dofs, (nothing, nothing), np.zeros(0)


def _everywhere(value: FloatArray, places: FloatArray) -> FloatArray:
    return np.broadcast_to(value, places.shape)


@dataclass
class _Piece:
    """A meshed part or box, where it lies, and where its degrees of freedom stand."""

    body: Elasticity
    placement: Placement
    start: int = 0

    @property
    def dofs(self) -> slice:
        return slice(self.start, self.start + self.body.n_dofs)


def _following(
    piece: _Piece, nodes: IntArray, masters: Sequence[_Piece]
) -> Iterator[tuple[IntArray, tuple[IntArray, IntArray], FloatArray]]:
    """Tie those nodes of a piece that lie in one of several boxes to its elements."""
    places = piece.placement.outside(piece.body.positions[nodes])
    left = np.ones(len(nodes), dtype=bool)
    for master in masters:
        low, high = (edge(master.body.mesh.points, axis=0) for edge in (np.min, np.max))
        slack = SAME * np.ptp(master.body.mesh.points, axis=0).max()
        within = left & np.all((places >= low - slack) & (places <= high + slack), axis=1)
        if not within.any():
            continue
        left &= ~within
        elements, barycentric = _locate(master.body, places[within])
        shape = shape_functions(barycentric)  # (q, 10)
        of_nodes = master.body.nodes[elements]
        turn = piece.placement.matrix
        # u_local = R^T sum_a N_a u_a
        q = len(elements)
        rows = np.broadcast_to(
            (piece.start + 3 * nodes[within])[:, None, None, None] + np.arange(3)[:, None], (q, 10, 3, 3)
        )
        columns = np.broadcast_to(master.start + 3 * of_nodes[:, :, None, None] + np.arange(3), (q, 10, 3, 3))
        weights = shape[:, :, None, None] * turn.T
        dofs = (piece.start + 3 * nodes[within][:, None] + np.arange(3)).ravel()
        yield dofs, (rows.ravel(), columns.ravel()), np.broadcast_to(weights, (q, 10, 3, 3)).ravel()


def _locate(body: Elasticity, places: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the element that each place lies in, shape (q,), and its barycentric coordinates there, shape (q, 4)."""
    gradients, _ = body.barycentric_gradients
    corners = body.mesh.points[body.mesh.tets]
    elements, coordinates = np.zeros(len(places), dtype=np.int64), np.zeros((len(places), 4))
    for index, place in enumerate(places):
        found = np.einsum("eki,ei->ek", gradients, place - corners[:, 0]) + np.array([1.0, 0.0, 0.0, 0.0])
        elements[index] = np.argmax(found.min(axis=1))
        coordinates[index] = found[elements[index]]
    return elements, coordinates
