"""From a CAD domain to tetrahedra whose boundary facets know which CAD face they lie on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import subprocess_call
from flexdesign.design.part import SymmetryPlane
from flexdesign.fem.meshing.domain import Domain, Face

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Corners of the four faces of a tetrahedron, each seen from outside counter-clockwise.
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])

#: A tetrahedron is flat if its volume is less than this share of the cube of its size.
FLAT = 1e-4
#: Fraction of the vertices on the surface that may stay off their CAD faces.
MOST_LOOSE = 5e-3


class Size(Protocol):
    """A target edge length as a function of place."""

    @property
    def largest(self) -> float:
        """The largest edge length [m]."""

    def background(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, NDArray[np.int32], FloatArray]:
        """Return points (n, 3), tetrahedra (m, 4) and edge lengths (n,) of a mesh that covers the box low..high."""


class MeshError(Exception):
    """A mesh that must not be used; the message says what to change."""


@dataclass(frozen=True)
class TaggedMesh:
    """Tetrahedra and the boundary facets that make up each CAD face.

    Parameters
    ----------
    points
        Vertices, shape (n, 3) [m].
    tets
        Corners of the positively oriented tetrahedra, shape (m, 4).
    facets
        Corners of the boundary facets, seen from outside counter-clockwise, shape (k, 3).
    faces
        Index of the CAD face each facet lies on, shape (k,).
    loose
        Vertices on the boundary that lie on their CAD faces within the mesher's envelope alone, by index.
    mesher
        Which program made it; empty for layers of prisms.
    """

    points: FloatArray
    tets: IntArray
    facets: IntArray
    faces: IntArray
    loose: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    mesher: str = ""

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return float(signed_volumes(self.points, self.tets).sum())

    def on_face(self, *indices: int) -> IntArray:
        """Return the facets on the given CAD faces, shape (k, 3)."""
        return self.facets[np.isin(self.faces, indices)]

    def quality(self) -> FloatArray:
        """Return the mean-ratio quality of each tetrahedron, 1 for regular and 0 for flat, shape (m,)."""
        corners = self.points[self.tets]
        pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
        squares = sum(((corners[:, a] - corners[:, b]) ** 2).sum(axis=1) for a, b in pairs)
        volumes = np.maximum(signed_volumes(self.points, self.tets), 0.0)
        return np.asarray(12 * (3 * volumes) ** (2 / 3) / squares)

    def arrays(self) -> dict[str, NDArray]:
        """Return the arrays that make up the mesh, for storing."""
        return {"points": self.points, "tets": self.tets, "facets": self.facets, "faces": self.faces,
                "loose": self.loose}  # fmt: skip


def tetrahedralize(domain: Domain, sizing: Size, envelope: float, passes: int = 80) -> TaggedMesh:
    """Fill the domain with tetrahedra and lay their boundary exactly on the CAD faces.

    Parameters
    ----------
    domain
        What to fill.
    sizing
        The target edge length.
    envelope
        How far the mesher may move the surface [m]; at most a twentieth of the thinnest section, as a looser one
        thickens or loses hinges.
    passes
        How often the mesher may improve its mesh at most.

    Raises
    ------
    MeshError
        If the mesher returns nothing usable.
    """
    points, triangles, owners = domain.surface()
    low, high = points.min(axis=0), points.max(axis=0)
    try:
        vertices, tets = subprocess_call.call(
            _fill,
            points,
            triangles,
            sizing.largest,
            envelope,
            float(np.linalg.norm(high - low)),
            sizing.background(low, high),
            passes,
        )
    except subprocess_call.ProcessDied as error:
        raise MeshError(
            "the mesher ended without a mesh; check that the solid is closed, or change mesh.at_root"
        ) from error
    if len(tets) == 0:
        raise MeshError("the mesher returned no tetrahedra; check that the solid is closed")
    mesh = tag(vertices, tets, domain, (points, triangles, owners))
    return replace(snap(mesh, domain, envelope), mesher="pytetwild")


def _fill(
    points: FloatArray,
    triangles: IntArray,
    largest: float,
    envelope: float,
    diagonal: float,
    background: tuple[FloatArray, NDArray[np.int32], FloatArray],
    passes: int,
) -> tuple[FloatArray, IntArray]:
    """Call the mesher, with lengths in diagonals of the bounding box: its tolerances are relative to it."""
    import pytetwild

    bg_points, bg_tets, bg_sizes = background
    vertices, tets = pytetwild.tetrahedralize(
        points / diagonal,
        triangles.astype(np.int32),
        edge_length_abs=largest / diagonal,
        epsilon=envelope / diagonal,
        simplify=False,
        bg_vertices=bg_points / diagonal,
        bg_tets=bg_tets,
        bg_values=bg_sizes / diagonal,
        num_opt_iter=passes,
    )
    return np.asarray(vertices) * diagonal, np.asarray(tets, dtype=np.int64)


def tag(
    points: FloatArray, tets: IntArray, domain: Domain, surface: tuple[FloatArray, IntArray, IntArray]
) -> TaggedMesh:
    """Orient the tetrahedra and give each boundary facet the CAD face whose tessellation is nearest to its middle."""
    negative = signed_volumes(points, tets) < 0
    tets = tets.copy()
    tets[negative] = tets[negative][:, [0, 1, 3, 2]]
    used, tets = np.unique(tets, return_inverse=True)
    points, tets = points[used], tets.reshape(-1, 4)
    facets = boundary(tets)
    return TaggedMesh(points, tets, facets, nearest_faces(points[facets], surface))


def nearest_faces(corners: FloatArray, surface: tuple[FloatArray, IntArray, IntArray]) -> IntArray:
    """Return the CAD face nearest to the middle of each facet (k, 3, 3), of a surface as `Domain.surface` gives it."""
    import pyvista as pv

    points, triangles, owners = surface
    nearest = pv.PolyData.from_regular_faces(points, triangles).find_closest_cell(corners.mean(axis=1))
    return np.asarray(owners[np.asarray(nearest)])


def snap(mesh: TaggedMesh, domain: Domain, envelope: float) -> TaggedMesh:
    """Move boundary vertices onto the CAD faces they belong to, and drop what this flattens.

    The mesher keeps the surface within its envelope; a hinge's stiffness goes with the cube of its thickness, so that
    the last micrometre counts. A vertex on several faces goes to their intersection. Where several curved faces cross,
    that may turn elements inside out: then the vertices of these elements stay where the mesher put them, off the
    surface by no more than envelope and chord. They are few, or the mesh is refused.

    Raises
    ------
    MeshError
        If a vertex has to move farther than three times the envelope, or more than `MOST_LOOSE` of the vertices on
        the surface would have to stay, or an element is inside out even so.
    """
    goal = _on_faces(mesh, domain)
    off = np.linalg.norm(goal - mesh.points, axis=1)
    if domain.thin is not None:  # faces that nearly touch meet far away: one of them must do
        far = np.flatnonzero(off > 3 * envelope)
        goal[far] = _on_nearest(mesh.points[far], domain)
        off = np.linalg.norm(goal - mesh.points, axis=1)
    largest = float(off.max())
    if largest > 3 * envelope + domain.chord:
        raise MeshError(f"a surface vertex lies {largest * 1e6:.2g} um off its CAD face; reduce mesh.envelope")
    loose = np.zeros(len(goal), dtype=bool)
    most = MOST_LOOSE * len(np.unique(mesh.facets))
    while True:
        points = np.where(loose[:, None], mesh.points, goal)
        turned = _inverted_elements(points, mesh.tets)
        new = np.unique(mesh.tets[turned])
        new = new[~loose[new] & (off[new] > 0)]
        if not len(new) or loose.sum() + len(new) > most:
            break
        loose[new] = True
    return _without_slivers(replace(mesh, points=points, loose=np.flatnonzero(loose)))


def _on_faces(mesh: TaggedMesh, domain: Domain) -> FloatArray:
    """Return the vertices moved onto the faces that each belongs to."""
    points = mesh.points.copy()
    vertex_faces = _memberships(mesh, domain)
    for _ in range(50):  # alternating projections converge to the intersection; planes at right angles in one round
        before = points.copy()
        for index, face in enumerate(domain.faces):
            vertices = vertex_faces[vertex_faces[:, 1] == index, 0]
            points[vertices] = _project(points[vertices], face)
        if np.abs(points - before).max() < 1e-13:
            break
    return points


def _inverted_elements(points: FloatArray, tets: IntArray) -> NDArray[np.bool_]:
    """Tell which tetrahedra are inside out, and not merely laid flat."""
    return signed_volumes(points, tets) < -FLAT * _sizes(points, tets)


def _sizes(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the cube of the largest distance of a tetrahedron's corners from its middle [m^3]."""
    corners = points[tets]
    return np.asarray(np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1) ** 3)


def _memberships(mesh: TaggedMesh, domain: Domain) -> IntArray:
    """Return pairs of boundary vertex and CAD face, shape (k, 2).

    Facets may straddle the line where a fillet runs out into a plane, as no edge is there to be kept. A vertex with
    facets on both belongs to the nearer one alone; on both it would be drawn to that line.
    """
    pairs = np.unique(np.column_stack([mesh.facets.ravel(), np.repeat(mesh.faces, 3)]), axis=0)
    for curved, plane in domain.tangent_faces():
        on_curved, on_plane = (pairs[pairs[:, 1] == index, 0] for index in (curved, plane))
        both = np.intersect1d(on_curved, on_plane)
        if not len(both):
            continue
        to_curved, to_plane = (_distance_to_face(mesh.points[both], domain.faces[index]) for index in (curved, plane))
        loser = np.where(to_curved <= to_plane, plane, curved)
        lost = np.isin(pairs[:, 0] * len(domain.faces) + pairs[:, 1], both * len(domain.faces) + loser)
        pairs = pairs[~lost]
    return pairs


def _on_nearest(points: FloatArray, domain: Domain) -> FloatArray:
    """Return points moved onto the face that is nearest to each."""
    if not len(points):
        return points
    faces = [face for face in domain.faces if len(face.triangles)]
    away = np.array([_distance_to_face(points, face) for face in faces])
    nearest = away.argmin(axis=0)
    return np.array([_project(p[None], faces[index])[0] for p, index in zip(points, nearest, strict=True)])


def _distance_to_face(points: FloatArray, face: Face) -> FloatArray:
    import pyvista as pv

    patch = pv.PolyData.from_regular_faces(face.points, face.triangles)
    _, nearest = patch.find_closest_cell(points, return_closest_point=True)
    return np.asarray(np.linalg.norm(points - nearest, axis=1))


def _project(points: FloatArray, face: Face) -> FloatArray:
    if face.normal is not None:
        return points - np.outer(points @ face.normal - face.offset, face.normal)
    if face.axis is not None:
        origin, direction = face.axis
        along = np.outer((points - origin) @ direction, direction)
        radial = points - origin - along
        return origin + along + radial * (face.radius / np.linalg.norm(radial, axis=1))[:, None]
    return points


def _without_slivers(mesh: TaggedMesh, smallest: float = 1e-9) -> TaggedMesh:
    """Drop tetrahedra that snapping laid flat into the boundary, layer by layer, and expose what was behind them."""
    volumes = signed_volumes(mesh.points, mesh.tets)
    flat = volumes < FLAT * _sizes(mesh.points, mesh.tets)
    if not flat.any():
        return mesh
    lost = np.abs(volumes[flat]).sum() / volumes.sum()
    if lost > smallest:
        raise MeshError(f"snapping inverts elements ({lost:.1e} of the volume); reduce mesh.envelope or mesh.at_root")
    owner = {
        tuple(facet): face
        for facet, face in zip(np.sort(mesh.facets, axis=1).tolist(), mesh.faces.tolist(), strict=True)
    }
    waiting = [[tuple(sorted(tet[f])) for f in TET_FACES.tolist()] for tet in map(np.array, mesh.tets[flat].tolist())]
    while waiting:
        outer = [facets for facets in waiting if any(facet in owner for facet in facets)]
        if not outer:
            raise MeshError("a flat element lies inside the body; choose another mesh.at_root")
        for facets in outer:
            face = next(owner[facet] for facet in facets if facet in owner)
            owner |= {facet: owner.get(facet, face) for facet in facets}
        waiting = [facets for facets in waiting if facets not in outer]
    tets = mesh.tets[~flat]
    skin = boundary(tets)
    owners = np.array([owner[tuple(facet)] for facet in np.sort(skin, axis=1).tolist()])
    used, renumbered = np.unique(
        tets, return_inverse=True
    )  # a vertex of dropped elements alone would carry no stiffness
    loose = np.searchsorted(used, np.intersect1d(mesh.loose, used))
    return TaggedMesh(mesh.points[used], renumbered.reshape(-1, 4), np.searchsorted(used, skin), owners, loose)


def signed_volumes(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the volume of each tetrahedron, negative where it is inside out, shape (m,)."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6)


def boundary(tets: IntArray) -> IntArray:
    """Return the facets that belong to one tetrahedron only, oriented outwards, shape (k, 3)."""
    facets = tets[:, TET_FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
    return facets[first[count == 1]]


#: How the nodes of a mirrored tetrahedron are to be listed so that it is not inside out.
_REFLECTED = {4: [0, 1, 3, 2], 10: [0, 1, 3, 2, 4, 8, 7, 6, 5, 9]}


def mirror_mesh(
    points: FloatArray, cells: IntArray, planes: Sequence[SymmetryPlane], fields: Mapping[str, FloatArray]
) -> tuple[FloatArray, IntArray, dict[str, FloatArray]]:
    """Return points, cells and nodal fields of the whole part; vector fields (n, 3) reflect, scalars repeat.

    Fields are taken as symmetric in every plane. Cells are tetrahedra of 4 nodes, or of 10 in scikit-fem's order.
    """
    whole = dict(fields)
    for plane in planes:
        sign = np.ones(3)
        sign[plane.index] = -1.0
        cells = np.vstack([cells, cells[:, _REFLECTED[cells.shape[1]]] + len(points)])
        points = np.vstack([points, points * sign])
        for name, values in whole.items():
            image = values * sign if values.ndim == 2 else values
            whole[name] = np.concatenate([values, image])
    return points, cells, whole


def write(path: Path, mesh: TaggedMesh, point_data: Mapping[str, FloatArray] | None = None) -> None:
    """Write the mesh [m] with meshio in the format that the file's suffix names, facets tagged with their CAD face."""
    import meshio

    cells = [("tetra", mesh.tets), ("triangle", mesh.facets)]
    tags = [np.full(len(mesh.tets), -1), mesh.faces]
    meshio.Mesh(mesh.points, cells, point_data=dict(point_data or {}), cell_data={"cad_face": tags}).write(path)
