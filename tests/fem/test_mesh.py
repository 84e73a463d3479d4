"""Meshes against the CAD solid they fill, and the operations on meshes against hand-made ones."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.design import design
from flexdesign.design.part import SymmetryPlane
from flexdesign.fem.meshing import developed, domain, mesh, sizing
from flexdesign.fem.meshing.domain import Domain, Face
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh
from flexdesign.fem.solving.elasticity import EDGES, Elasticity
from studies.verification.solids import METAL, Array, lattice, tag_facets, weld_points
from tests.fem.solids import Bracket, misplaced

#: Coordinates of a few centimetres in double precision, sums of thousands of them.
ROUNDING = 1e-12


def amplifier(**changes: float) -> Any:
    """Return the shipped amplifier with some dimensions changed."""
    read = design.read(design.find("bridge_amplifier"))
    return read.part_class(**{**read.dimensions, **changes})


def facet_areas(points: Array, facets: Array) -> Array:
    """Return the area vectors of facets, along the normal that their order of corners makes."""
    a, b, c = (points[facets[:, i]] for i in range(3))
    return np.cross(b - a, c - a) / 2


@pytest.fixture(scope="module")
def quarter() -> tuple[Domain, TaggedMesh]:
    """A quarter of the bracket, meshed coarsely."""
    body = domain.of_part(Bracket(), chord=1e-5)
    roots = np.array([[[4e-3, 9e-3, 0.0], [4e-3, 9e-3, 3e-3]]])
    field = sizing.Sizing(roots, np.array([0.8e-3]), growth=0.5, largest=2e-3)
    return body, mesh.tetrahedralize(body, field, 1e-4)


# --- the domain ---------------------------------------------------------------------------------------------------


def test_quarter_is_a_quarter() -> None:
    """The T: foot 8 x 9, bar 18 x 4, times the depth, exactly."""
    depth = 6e-3
    expected = (8e-3 * 9e-3 + 18e-3 * 4e-3) * depth
    whole, cut = (domain.of_part(Bracket(depth), symmetric=s, chord=1e-5) for s in (False, True))
    assert whole.volume == pytest.approx(expected, rel=ROUNDING)
    assert cut.copies * cut.volume == pytest.approx(expected, rel=ROUNDING)
    assert whole.copies == 1 and cut.copies == 4
    assert set(whole.ports) == {"input_left", "input_right", "output", "ground"}
    assert set(cut.ports) == {"input_right", "output", "ground"}


@pytest.mark.parametrize("fillet", [0.0, 0.2e-3])
def test_quarter_of_the_amplifier_is_a_quarter(fillet: float) -> None:
    """The CAD kernel integrates cylinders numerically, to 1e-9 or so."""
    part = amplifier(fillet_radius=fillet)
    whole, cut = (domain.of_part(part, symmetric=s, chord=1e-5) for s in (False, True))
    assert 4 * cut.volume == pytest.approx(whole.volume, rel=1e-9)


def test_a_tessellation_without_bound_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A triangle of area 1/2 with sides of at most L takes at least (1/2) / (sqrt(3)/4 L^2) of them: 11548 here."""
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    monkeypatch.setattr(developed, "MOST", 11_000)
    with pytest.raises(InputError, match=r"more than 11000 triangles with edges of at most 10 mm.*hinge thicker"):
        developed.split(corner, np.array([[0, 1, 2]]), 0.01)
    points, triangles = developed.split(corner, np.array([[0, 1, 2]]), 0.02)
    assert len(triangles) <= 11_000
    sides = np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2)
    assert sides.max() <= 0.02
    assert np.linalg.norm(facet_areas(points, triangles).sum(axis=0)) == pytest.approx(0.5, rel=ROUNDING)


def test_ports_are_found_where_they_are() -> None:
    part = amplifier()
    body = domain.of_part(part, chord=1e-5)
    for port in part.ports():
        if port.name in body.ports:
            face = body.faces[body.ports[port.name]]
            assert face.normal == pytest.approx(np.array(port.normal), abs=1e-12)
            assert face.offset == pytest.approx(np.dot(port.normal, port.point), abs=1e-15)


def test_faces_in_the_planes_are_found() -> None:
    """The plane x = 0 cuts the amplifier twice, through output and ground block; z = 0 cuts it once."""
    body = domain.of_part(amplifier(), chord=1e-5)
    assert [len(faces) for faces in body.plane_faces] == [2, 1]
    for plane, faces in zip(body.planes, body.plane_faces, strict=True):
        for index in faces:
            expected = np.zeros(3)
            expected[plane.index] = -1.0
            assert body.faces[index].normal == pytest.approx(expected, abs=1e-12)


def test_surface_is_closed_and_holds_the_volume() -> None:
    """Each edge is in two triangles, in opposite directions; the divergence theorem gives the volume."""
    body = domain.of_part(amplifier(), chord=1e-5)
    points, triangles, owners = body.surface()
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    assert len(there) == len(edges)
    assert all((b, a) in there for a, b in there)
    outward = facet_areas(points, triangles)
    volume = np.einsum("ij,ij->", points[triangles].mean(axis=1), outward) / 3
    assert abs(volume) == pytest.approx(body.volume, rel=1e-9)
    assert set(owners) == set(range(len(body.faces)))


@pytest.mark.parametrize(
    ("changes", "symmetric", "why"),
    [
        ({"point": (0.0, 12e-3, 0.0)}, True, "no plane face"),  # inside the body
        ({"normal": (0.0, -1.0, 0.0)}, True, "no plane face"),  # points inwards
        ({"point": (20e-3, 13e-3, 0.0)}, False, "no plane face"),  # beside the face
        ({"point": (1e-3, 13e-3, 0.0)}, True, "must lie in the symmetry plane x = 0"),
    ],
)
def test_a_port_that_is_not_on_the_solid_is_refused(changes: dict[str, Any], symmetric: bool, why: str) -> None:
    with pytest.raises(InputError, match=why) as caught:
        domain.of_part(misplaced(Bracket(), "output", **changes), symmetric=symmetric, chord=1e-5)
    assert caught.value.field == "ports.output"


class Lopsided(Bracket):
    """The bracket with a longer right arm, which still calls itself symmetric."""

    def solid(self) -> Any:
        import cadquery as cq

        return (
            cq.Workplane(obj=super().solid())
            .union(cq.Workplane("XY").box(4, 4, 6).translate((11, 11, 0)))
            .solids()
            .val()
        )


class Turned(Bracket):
    """An S: half a turn brings it onto itself, a mirror does not, though both halves have one volume."""

    def solid(self) -> Any:
        import cadquery as cq

        outline = [(-9, -4), (4, -4), (4, 9), (9, 9), (9, 13), (-4, 13), (-4, 0), (-9, 0)]
        return cq.Workplane("XY").polyline(outline).close().extrude(3, both=True).solids().val()


TURNED = misplaced(Turned(), "ground", point=(0.0, -4e-3, 0.0))


@pytest.mark.parametrize("part", [Lopsided(), TURNED], ids=["volume", "shape"])
def test_a_plane_that_is_none_is_refused(part: Bracket) -> None:
    with pytest.raises(InputError) as caught:
        domain.of_part(part, chord=1e-5)
    assert caught.value.field == "symmetry" and caught.value.value == "x"


# --- the mesh -----------------------------------------------------------------------------------------------------


def test_mesh_fills_the_solid_exactly(quarter: tuple[Domain, TaggedMesh]) -> None:
    body, tets = quarter
    assert tets.volume == pytest.approx(body.volume, rel=ROUNDING)
    assert mesh.signed_volumes(tets.points, tets.tets).min() > 0
    assert tets.quality().min() > 0.01


def test_every_cad_face_is_covered_exactly(quarter: tuple[Domain, TaggedMesh]) -> None:
    """Each face's facets lie in its plane, point outwards and add up to its area."""
    body, tets = quarter
    assert set(tets.faces) == set(range(len(body.faces)))
    for index, face in enumerate(body.faces):
        facets = tets.on_face(index)
        assert np.abs(tets.points[facets] @ face.normal - face.offset).max() < 1e-15
        areas = facet_areas(tets.points, facets)
        drawn = np.linalg.norm(facet_areas(face.points, face.triangles), axis=1).sum()  # of plane polygons
        assert areas.sum(axis=0) == pytest.approx(drawn * face.normal, rel=ROUNDING, abs=ROUNDING * drawn)
        assert np.all(areas @ face.normal > 0)


def test_boundary_is_closed_and_outward(quarter: tuple[Domain, TaggedMesh]) -> None:
    _, tets = quarter
    outward = facet_areas(tets.points, tets.facets)
    total = np.linalg.norm(outward, axis=1).sum()
    assert np.abs(outward.sum(axis=0)).max() < ROUNDING * total
    volume = np.einsum("ij,ij->", tets.points[tets.facets].mean(axis=1), outward) / 3
    assert volume == pytest.approx(tets.volume, rel=ROUNDING)


def test_mesh_is_finer_where_it_was_asked_to_be(quarter: tuple[Domain, TaggedMesh]) -> None:
    """Mean edges near the root are between half and three halves of what was asked; the mesher is loose.

    Asked is 0.8 mm + distance / 2; the mean distance within a radius of 1 mm is 2/3 mm.
    """
    _, tets = quarter
    roots = np.array([[[4e-3, 9e-3, 0.0], [4e-3, 9e-3, 3e-3]]])
    near = sizing.edge_length_at_roots(tets.points, tets.tets, roots, 1e-3)
    everywhere = sizing.edge_length_at_roots(tets.points, tets.tets, roots, 1.0)
    asked = 0.8e-3 + 0.5 * 2 / 3 * 1e-3
    assert 0.5 * asked < near < 1.5 * asked
    assert near < 0.8 * everywhere


@pytest.fixture(scope="module")
def rounded() -> tuple[Domain, TaggedMesh]:
    """A narrow amplifier with fillets of 0.2 mm at its hinge roots, meshed coarsely."""
    part = amplifier(fillet_radius=0.2e-3, width=1.5e-3)
    body = domain.of_part(part, chord=5e-6)
    roots, owners = sizing.root_edges(part.linkage().of_kind("hinge"), body)
    field = sizing.Sizing(roots, np.full(len(owners), 0.24e-3), growth=0.6, largest=2e-3)
    return body, mesh.tetrahedralize(body, field, 25e-6)


def off_face(points: Array, face: Face) -> Array:
    """Return the distance of points from a face's plane or cylinder."""
    if face.normal is not None:
        return np.abs(points @ face.normal - face.offset)
    assert face.axis is not None
    radial = np.cross(points - face.axis[0], face.axis[1])
    return np.abs(np.linalg.norm(radial, axis=1) - face.radius)


def test_boundary_vertices_lie_on_planes_and_cylinders(rounded: tuple[Domain, TaggedMesh]) -> None:
    """Each on one of the faces its facets are tagged with; off all of them by rounding alone unless two are tangent.

    Where a fillet runs out into a plane, facets straddle: a vertex then belongs to one of the two.
    """
    body, tets = rounded
    cylinders = [i for i, face in enumerate(body.faces) if face.axis is not None]
    assert len(cylinders) == 16  # four hinges with two ends and two sides
    assert set(cylinders) <= set(tets.faces)
    tangent = set(body.tangent_faces())
    off: dict[int, dict[int, float]] = {}
    for index in np.unique(tets.faces):
        vertices = np.unique(tets.on_face(index))
        for vertex, distance in zip(vertices, off_face(tets.points[vertices], body.faces[index]), strict=True):
            off.setdefault(vertex, {})[int(index)] = distance
    exact = 0
    for distances in off.values():
        assert min(distances.values()) < 1e-13
        straddling = any((c, p) in tangent for c in distances for p in distances)
        if not straddling:
            assert max(distances.values()) < 1e-13
            exact += any(index in cylinders for index in distances)
    assert exact > 16  # vertices on cylinders alone, or on them and the end faces


def test_fillets_are_where_they_were_drawn(rounded: tuple[Domain, TaggedMesh]) -> None:
    """Cylinders of the radius asked for, tangent to leaf and arm, their axis one radius away from both."""
    body, _ = rounded
    hinges = {h.name: h for h in amplifier(fillet_radius=0.2e-3, width=1.5e-3).linkage().of_kind("hinge")}
    leaf = hinges["hinge_inner_ur"]
    axes = np.array([face.axis[0][:2] for face in body.faces if face.axis is not None])
    assert all(face.radius == pytest.approx(0.2e-3, rel=1e-9) for face in body.faces if face.axis is not None)
    expected = [
        (x + inward * 0.2e-3, leaf.centre[1] + side * (leaf.thickness / 2 + 0.2e-3))
        for x, inward in ((leaf.start[0], 1), (leaf.end[0], -1))
        for side in (1, -1)
    ]
    for place in expected:
        assert np.linalg.norm(axes - place, axis=1).min() < 1e-9


# --- operations ---------------------------------------------------------------------------------------------------


def box(n: int = 3) -> tuple[Domain, TaggedMesh]:
    """A cube of 1 m with its six planes as CAD faces, index 2 * axis + (1 if upper)."""
    axis = np.linspace(0.0, 1.0, n)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    faces = []
    for k in range(3):
        for value in (0.0, 1.0):
            points = np.insert(corners, k, value, axis=1)
            normal = np.eye(3)[k] * (1 if value else -1)
            faces.append(Face(points, np.array([[0, 1, 2], [0, 2, 3]]), normal, float(normal @ points[0])))
    patches = {f"{k}{v}": (lambda x, k=k, v=v: np.abs(x[:, k] - v) < 1e-9) for k in range(3) for v in (0, 1)}
    tets, _ = tag_facets(*lattice(axis, axis, axis), patches)
    return Domain(tuple(faces), (), {}, (), 1.0, ""), tets


def test_facets_of_one_tetrahedron_point_outwards() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    tets = np.array([[0, 1, 2, 3]])
    assert mesh.signed_volumes(points, tets) == pytest.approx([1 / 6])
    facets = mesh.boundary(tets)
    outward = facet_areas(points, facets)
    away = points[facets].mean(axis=1) - points.mean(axis=0)
    assert len(facets) == 4 and np.all(np.einsum("ij,ij->i", outward, away) > 0)
    assert TaggedMesh(points, tets, facets, np.zeros(4, int)).quality() == pytest.approx(
        [12 * 0.5 ** (2 / 3) / 9]  # three edges of 1, three of sqrt 2
    )
    regular = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    upright = tets if mesh.signed_volumes(regular, tets)[0] > 0 else tets[:, [0, 1, 3, 2]]
    assert TaggedMesh(regular, upright, facets, np.zeros(4, int)).quality() == pytest.approx([1.0])


def test_tagging_orients_and_drops_unused_points() -> None:
    body, tets = box()
    points = np.vstack([[[9.0, 9.0, 9.0]], tets.points])  # a point that nothing uses
    spoiled = tets.tets + 1
    spoiled[::2] = spoiled[::2][:, [0, 1, 3, 2]]
    found = mesh.tag(points, spoiled, body, body.surface())
    assert len(found.points) == len(tets.points)
    assert mesh.signed_volumes(found.points, found.tets).min() > 0
    for index, face in enumerate(body.faces):
        assert np.abs(found.points[found.on_face(index)] @ face.normal - face.offset).max() == 0.0
        assert np.linalg.norm(facet_areas(found.points, found.on_face(index)), axis=1).sum() == pytest.approx(1.0)


def test_snapping_restores_displaced_vertices_to_edges_and_corners() -> None:
    """Boundary vertices moved at random come back to their planes; those at corners exactly to the corner."""
    body, tets = box(4)
    outer = np.unique(tets.facets)
    points = tets.points.copy()
    points[outer] += 1e-3 * np.random.default_rng(0).uniform(-1, 1, (len(outer), 3))
    found = mesh.snap(dataclasses.replace(tets, points=points), body, 1e-3)
    assert found.volume == pytest.approx(1.0, rel=ROUNDING)
    corners = np.all((tets.points == 0) | (tets.points == 1), axis=1)
    np.testing.assert_allclose(found.points[corners], tets.points[corners], atol=1e-15)
    inner = np.setdiff1d(np.arange(len(points)), outer)
    np.testing.assert_array_equal(found.points[inner], points[inner])


def test_a_vertex_far_off_its_face_is_refused() -> None:
    body, tets = box()
    points = tets.points.copy()
    points[0] += [0.0, 0.0, 0.02]
    with pytest.raises(MeshError, match=r"lies 2e\+04 um off its CAD face; reduce mesh\.envelope"):
        mesh.snap(dataclasses.replace(tets, points=points), body, 1e-3)


def test_snapping_drops_slivers_on_the_surface() -> None:
    """A flat tetrahedron glued onto the top face, as meshers leave them: dropped, and what it hid keeps the tag."""
    body, tets = box()
    top = tets.on_face(5)
    pair = next((a, b) for i, a in enumerate(top) for b in top[i + 1 :] if len(set(a) & set(b)) == 2)
    shared = sorted(set(pair[0]) & set(pair[1]))
    others = [next(v for v in facet if v not in shared) for facet in pair]
    points = tets.points.copy()
    flat = np.array([[*shared, *others]])
    lifted = points.copy()
    lifted[others[1], 2] += 1e-6
    if mesh.signed_volumes(lifted, flat)[0] < 0:
        flat = flat[:, [1, 0, 2, 3]]
    everything = np.vstack([tets.tets, flat])
    facets = mesh.boundary(everything)
    owner = {tuple(sorted(f)): face for f, face in zip(tets.facets.tolist(), tets.faces.tolist(), strict=True)}
    faces = np.array([owner.get(tuple(sorted(f)), 5) for f in facets.tolist()])
    found = mesh.snap(TaggedMesh(points, everything, facets, faces), body, 1e-3)
    assert len(found.tets) == len(tets.tets)
    for index in range(6):
        assert {tuple(sorted(f)) for f in found.on_face(index).tolist()} == {
            tuple(sorted(f)) for f in tets.on_face(index).tolist()
        }


def bulged(count: int) -> tuple[Domain, TaggedMesh, int]:
    """A box of which the mesher put one vertex 0.9e-3 above its face, and the one below it 0.5e-3 above it, too."""
    body, tets = box(count)
    points = tets.points.copy()
    top = np.linalg.norm(points - [0.5, 0.5, 1.0], axis=1).argmin()
    below = np.linalg.norm(points - points[top] + [0.0, 0.0, 1 / count], axis=1).argmin()
    points[top, 2], points[below, 2] = 1 + 0.9e-3, 1 + 0.5e-3
    assert mesh.signed_volumes(points, tets.tets).min() > 0
    return body, dataclasses.replace(tets, points=points), int(top)


def test_a_vertex_whose_snapping_would_turn_elements_stays_where_it_is() -> None:
    """One of 386 on the surface; the volume is that of the box and of the bulge, off by less than the envelope."""
    body, tets, top = bulged(8)
    found = mesh.snap(tets, body, 1e-3)
    assert found.loose.tolist() == [top]
    np.testing.assert_array_equal(found.points[top], tets.points[top])
    assert mesh.signed_volumes(found.points, found.tets).min() > 0
    assert 0 < found.volume - 1.0 < 1e-3 * (2 / 8) ** 2


def test_many_vertices_that_must_stay_refuse_the_mesh() -> None:
    """One of 98 is more than one of two hundred."""
    body, tets, _ = bulged(4)
    with pytest.raises(MeshError, match="snapping inverts elements"):
        mesh.snap(tets, body, 1e-3)


def test_snapping_that_turns_elements_inside_out_is_refused() -> None:
    body, tets = box()
    points = tets.points.copy()
    middle = np.flatnonzero(np.all(points == 0.5, axis=1))[0]
    points[middle, 2] = 1.4  # an inner vertex, which no face holds back
    with pytest.raises(MeshError, match="snapping inverts elements"):
        mesh.snap(dataclasses.replace(tets, points=points), body, 1e-3)


def test_mirrored_is_the_whole_with_fields_reflected() -> None:
    _, tets = box()
    planes = (SymmetryPlane("x", {}), SymmetryPlane("z", {}))
    field = tets.points * [1.0, 2.0, 3.0]  # odd across each plane in its own component: symmetric
    heat = tets.points[:, 0] ** 2 + tets.points[:, 1]
    points, whole, fields = mesh.mirror_mesh(tets.points, tets.tets, planes, {"u": field, "T": heat})
    assert mesh.signed_volumes(points, whole).sum() == pytest.approx(4.0, rel=ROUNDING)
    assert mesh.signed_volumes(points, whole).min() > 0
    np.testing.assert_allclose(fields["u"], points * [1.0, 2.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(fields["T"], points[:, 0] ** 2 + points[:, 1], atol=1e-15)
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_array_equal([low, high], [[-1, 0, -1], [1, 1, 1]])
    joined, _ = weld_points(points, whole)
    assert len(joined) == 5 * 3 * 5  # 3 x 3 x 3 points in an eighth


def test_mirrored_quadratic_elements_keep_their_edge_middles() -> None:
    """Each middle lies between the corners that scikit-fem's order says, in the images too, and none is inside out."""
    body = Elasticity(box()[1], METAL)
    points, cells, _ = mesh.mirror_mesh(
        body.positions, body.nodes, (SymmetryPlane("x", {}), SymmetryPlane("y", {})), {}
    )
    ends = points[cells[:, EDGES]]
    np.testing.assert_allclose(points[cells[:, 4:]], ends.mean(axis=2), atol=1e-15)
    assert mesh.signed_volumes(points, cells[:, :4]).min() > 0
    assert mesh.signed_volumes(points, cells[:, :4]).sum() == pytest.approx(4.0, rel=ROUNDING)


def test_written_mesh_reads_back(tmp_path: Path, quarter: tuple[Domain, TaggedMesh]) -> None:
    _, tets = quarter
    path = tmp_path / "mesh.vtu"
    mesh.write(path, tets, {"u": tets.points * 2.0})
    found = meshio.read(path)
    np.testing.assert_array_equal(found.points, tets.points)
    np.testing.assert_array_equal(found.cells_dict["tetra"], tets.tets)
    np.testing.assert_array_equal(found.cells_dict["triangle"], tets.facets)
    np.testing.assert_array_equal(found.cell_data_dict["cad_face"]["triangle"], tets.faces)
    np.testing.assert_array_equal(found.point_data["u"], tets.points * 2.0)


def test_arrays_hold_the_whole_mesh(quarter: tuple[Domain, TaggedMesh]) -> None:
    _, tets = quarter
    again = TaggedMesh(**tets.arrays())
    for name in ("points", "tets", "facets", "faces"):
        np.testing.assert_array_equal(getattr(again, name), getattr(tets, name))
