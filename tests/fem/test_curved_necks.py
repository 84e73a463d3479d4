"""Curved necks: how finely they are meshed, what the gate asks, and a lever beside hexahedra and beam theory."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.analytic import notch
from flexdesign.core.model import Member, by_key
from flexdesign.core.result_cache import Cache
from flexdesign.design import part as parts
from flexdesign.design import study
from flexdesign.fem import mesh_refinement, quantities
from flexdesign.fem.mesh_refinement import Level
from flexdesign.fem.meshing import domain, profile, resolution_gate, sizing
from flexdesign.fem.meshing.mesh import MeshError
from flexdesign.fem.meshing.sizing import Neck
from studies.error_bars import lever
from studies.error_bars.bridge import Fineness
from studies.error_bars.designs import PARTS
from studies.error_bars.hexahedra import Body, Plan, sheared_patch
from studies.verification.solids import lattice, tag_facets
from tests.fem.test_gate import EVERYWHERE, LEAF, NOTCH, knots, shaped

T, R = NOTCH.thickness, NOTCH.curvature_radius
#: The same notch, declared as two fillets that meet at the neck.
FILLETS = replace(NOTCH, name="fillets", curvature_radius=math.inf, root_radius=R)


# --- where elements are small -------------------------------------------------------------------------------------


@pytest.mark.parametrize("member", [NOTCH, FILLETS], ids=lambda m: m.name)
def test_a_notch_is_refined_on_its_profile_and_not_inside_the_metal(member: Member) -> None:
    """On the profile min(a t(s), sqrt(8 R d)), inside no more than b t(s); no roots at (+-l/2, +-t/2) in the metal.

    Where chords keep the profile's area, d is in proportion to t(s) times the cosine of the slope.
    """
    neck = Neck(member, surface=0.1, inside=0.2, chord=1e-3 * T)
    s = np.linspace(-R, R, 41)
    height = member.thicknesses(s)
    assert height == pytest.approx(T + 2 * (R - np.sqrt(R**2 - s**2)), abs=1e-12)
    on_profile = np.column_stack([s, height / 2, np.zeros_like(s)])
    assert neck(on_profile, 0.5) == pytest.approx(np.minimum(0.1 * height, math.sqrt(8 * R * 1e-3 * T)))
    kept = replace(neck, keeps_area=True)
    chord = 1e-3 * np.maximum(T, height * np.sqrt(1 - (s / R) ** 2))
    assert kept(on_profile, 0.5) == pytest.approx(np.minimum(0.1 * height, np.sqrt(8 * R * chord)), rel=1e-3)
    on_axis = np.column_stack([s, np.zeros_like(s), np.zeros_like(s)])
    assert np.all(neck(on_axis, 0.5) <= 0.2 * height * (1 + 1e-12))
    assert neck.on_profile(on_profile).all() and not neck.on_profile(on_profile * [1.0, 1.03, 1.0]).any()
    assert neck.finest == neck(np.array([[0.0, T / 2, 0.0]]), 0.5)[0]
    assert sizing.necks_in([member, LEAF], EVERYWHERE) == [member]


def test_fillets_that_leave_most_of_a_leaf_make_no_neck() -> None:
    for radius, curved in ((0.0, False), (0.8 * T, False), (1.2 * T, True), (R, True)):
        assert profile.is_curved(replace(LEAF, root_radius=radius)) is curved
    assert not profile.is_curved(replace(NOTCH, kind="rod"))


@pytest.fixture(scope="module")
def extruded() -> tuple[Any, Any]:
    """The lever and the way to mesh it."""
    asked = study.read(str(PARTS / "notched_lever.toml"))
    part = asked.design.part()
    body = domain.of_part(part, chord=domain.chord(part))
    return part, mesh_refinement.method_of(asked, part, body)


def test_meshes_of_a_notch_have_elements_across_the_neck_and_never_equally_many_layers(extruded: Any) -> None:
    """More elements from mesh to mesh, across the neck and along the width; the gate lets all three pass."""
    part, method = extruded
    across, layers = [], []
    for coarseness in (1.35**2, 1.35, 1.0):
        mesh = method.mesh(coarseness)
        (check,) = resolution_gate.check(mesh, method.grading.domain, part.linkage().of_kind("hinge"))
        across.append(check.across)
        layers.append(len(method.heights(coarseness)) - 1)
    assert across[0] > 3 and across == sorted(across)
    assert layers == sorted(set(layers))


# --- the gate -----------------------------------------------------------------------------------------------------


def test_a_neck_of_one_element_is_refused_though_it_is_as_thick_as_drawn() -> None:
    """Cells over the whole thickness, each as high as the others: one and two are refused, three and four pass."""
    for cells in (3, 4):
        (found,) = resolution_gate.check(shaped_across(NOTCH, cells), EVERYWHERE, [NOTCH])
        assert found.resolved and found.across == pytest.approx(cells, rel=0.03)
    for cells in (1, 2):
        assert resolution_gate.elements_across(shaped_across(NOTCH, cells), NOTCH) == pytest.approx(cells, rel=0.03)
    said = (
        r"^notch has 0\.98 elements across its curved neck of 0\.5 mm, 2\.5 at least are needed; reduce mesh\.at_root"
    )
    with pytest.raises(MeshError, match=said):
        resolution_gate.check(shaped_across(NOTCH, 1), EVERYWHERE, [NOTCH])


def shaped_across(member: Member, cells: int) -> Any:
    """The mesh of `shaped` with so many cells over the thickness."""
    half = member.length / 2
    x = np.concatenate([[-half - 1e-3], knots(member, 80), [half + 1e-3]])
    points, tets = lattice(x, np.linspace(-1, 1, cells + 1), np.linspace(-2e-3, 2e-3, 4))
    outline = np.array([member.thickness_at(min(abs(s), half)) for s in points[:, 0]])
    points[:, 1] *= outline / 2
    return tag_facets(points, tets, {})[0]


def test_nothing_is_asked_across_a_straight_leaf() -> None:
    flat = replace(LEAF, name="leaf")
    assert resolution_gate.elements_across(shaped_across(flat, 1), flat) == math.inf


def test_a_notch_declared_as_fillets_is_judged_as_one() -> None:
    """Chords of 0.12 % are more than the 0.1 % of a flat leaf, of which such a notch has nothing."""
    (as_fillets,) = resolution_gate.check(shaped(FILLETS, 40), EVERYWHERE, [FILLETS])
    (as_notch,) = resolution_gate.check(shaped(NOTCH, 80), EVERYWHERE, [NOTCH])
    assert as_fillets.limit == as_notch.limit == resolution_gate.CURVED_LIMIT
    assert as_fillets.deviation == pytest.approx(as_notch.deviation, rel=0.05)


# --- the lever ----------------------------------------------------------------------------------------------------


def levels_of(folder: Path, *overrides: str) -> tuple[Any, Any, list[Level]]:
    """Solve the lever on its first two meshes."""
    design = "filleted_lever" if "fillets" in overrides else "notched_lever"
    changes = [change for change in overrides if change != "fillets"]
    asked = study.read(str(PARTS / f"{design}.toml"), ['mesh.accuracy="2 %"', *changes])
    part = asked.design.part()
    body = domain.of_part(part, material=asked.design.material, chord=domain.chord(part))
    method = mesh_refinement.method_of(asked, part, body)
    return asked, method, mesh_refinement.refine(
        asked, part, body, method, Cache(folder), lambda _: None, all_classes=False
    )  # fmt: skip


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any, list[Level]]:
    return levels_of(tmp_path_factory.mktemp("cache"))


def gathered(found: tuple[Any, Any, list[Level]]) -> dict[str, Any]:
    asked, method, levels = found
    return by_key(mesh_refinement.gather_quantities(asked, levels, method.scatter))


def assert_contains(
    found: dict[str, Any], part: Any, material: Any, fineness: tuple[float, float] = (1.0, 1.6), weight: float = 0.8
) -> None:
    """Estimates hold what two meshes of hexahedra come to, whose own error is less than 0.05 %."""
    coarse, fine = (
        lever.solve(part, material.youngs_modulus, material.poissons_ratio, Fineness.of(level)).quantities
        for level in fineness
    )
    for key, value in fine.items():
        truth = value + weight * (value - coarse[key])
        assert abs(found[key].value - truth) <= found[key].half_width, key
        assert found[key].half_width < 0.02 * abs(found[key].value)


def test_error_bars_of_a_lever_hold(solved: Any) -> None:
    design = solved[0].design
    assert_contains(gathered(solved), design.part(), design.material)


@pytest.mark.slow
@pytest.mark.parametrize("radius", ["1.5 mm", "5 mm"])
def test_error_bars_of_other_radii_hold(radius: str, tmp_path: Path) -> None:
    """At R = 5 mm hexahedra of fineness 3.2, with nine layers in the half width, come to the same within 0.02 %."""
    found = levels_of(tmp_path, f'dimensions.radius="{radius}"')
    assert_contains(gathered(found), found[0].design.part(), found[0].design.material, (1.6, 2.5), 0.5)


def test_nominal_stress_of_a_notch_is_that_of_beam_theory(solved: Any) -> None:
    """The largest 6 (a + s) F / b t(s)^2 along the notch, by statics: 25.0 MPa per newton, safety 20."""
    part, found = solved[0].design.part(), gathered(solved)
    s = np.linspace(0.0, 0.5 * part.radius, 100_001)
    height = part.neck + 2 * (part.radius - np.sqrt(part.radius**2 - s**2))
    expected = (6 * (part.input_arm + s) / (part.width * height**2)).max()
    for level in solved[2]:
        (section,) = (x for x in level.solution.input_sections if x.member.kind == "hinge")
        assert section.normal == pytest.approx(0.0, abs=1e-8)
        assert section.shear == pytest.approx(1.0, rel=1e-7)
        assert abs(section.moment) == pytest.approx(part.input_arm, rel=1e-7)
        assert section.nominal_stress == pytest.approx(expected, rel=1e-4)
    stress = found["hinge_stress_1_N_of_actuator_force"]
    assert stress.value == pytest.approx(expected, rel=1e-4) and stress.value == pytest.approx(25.0e6, rel=2e-3)
    safety = found["safety_against_yield_hinge_stress_1_N_of_actuator_force"]
    assert safety.value == pytest.approx(solved[0].design.material.yield_strength / expected, rel=1e-3)


def test_bending_of_a_notch_is_what_paros_and_weisbord_say_of_its_moment(solved: Any) -> None:
    """Their rotation per moment times a^2, and the little that shear bends: more than FEM has in all.

    A beam of plane stress lacks what holds a wide neck from contracting, so that its share is a little above 100 %.
    """
    asked, method, levels = solved
    part, material = asked.design.part(), asked.design.material
    shares = quantities.compliance_shares(material, method.grading.domain, levels[-1].solution)["K_in_output_free"]
    hinge = notch.beam_integral(
        material.youngs_modulus,
        part.width,
        notch.circular_thickness(part.radius, part.neck),
        2 * part.radius,
        part.radius,
    )
    rotation, _ = notch.paros_weisbord(material.youngs_modulus, part.width, part.neck, part.radius)
    sway = 1 / hinge.sway_stiffness
    assert shares["hinge bending"] == pytest.approx(rotation * part.input_arm**2 + sway, rel=1e-4)
    assert 1.0 < shares["hinge bending"] / sum(shares.values()) < 1.1


def test_a_notch_declared_as_fillets_gives_the_same_answers(solved: Any, tmp_path: Path) -> None:
    same, other = gathered(solved), gathered(levels_of(tmp_path, "fillets"))
    for key in ("K_in_output_free", "lambda_output_free", "K_out_input_free", "hinge_stress_1_N_of_actuator_force"):
        assert other[key].value == pytest.approx(same[key].value, rel=1e-6)


@pytest.mark.slow
def test_wild_meshes_of_a_notch_agree(tmp_path: Path) -> None:
    """A narrow lever, as elements are as short along a neck as across it."""
    narrow = 'dimensions.width="2 mm"'
    wild = gathered(levels_of(tmp_path, narrow, "mesh.method=wild"))
    known = gathered(levels_of(tmp_path, narrow))
    for key in ("K_in_output_free", "lambda_output_free", "K_out_input_free", "hinge_stress_1_N_of_actuator_force"):
        assert abs(wild[key].value - known[key].value) <= math.hypot(wild[key].half_width, known[key].half_width), key


def test_tessellation_of_a_notch_has_no_needles(extruded: Any) -> None:
    """The wild mesher loses the surface of triangles that reach across the width."""
    part, method = extruded
    for face in method.grading.domain.faces:
        if face.axis is None:
            continue
        corners = face.points[face.triangles]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        assert sides.max() <= domain.LONGEST * math.sqrt(8 * part.radius * domain.chord(part))
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        assert area == pytest.approx(math.pi * part.radius * part.width / 2, rel=1e-3)
        away = face.points[:, :2] - face.axis[0, :2]
        assert np.linalg.norm(away, axis=1) == pytest.approx(part.radius, rel=1e-9)


# --- the reference ------------------------------------------------------------------------------------------------


def test_section_forces_of_hexahedra_balance_the_load() -> None:
    """A bar under forces on its end: N, V and the moment about a point of the section by statics."""
    x, y = np.linspace(0.0, 20e-3, 9), np.linspace(-1e-3, 1e-3, 3)

    def held(nodes: Any, z: Any) -> Any:
        fixed = np.zeros((len(nodes), 3, z.size), dtype=bool)
        fixed[nodes[:, 0] < 1e-9] = True
        return fixed

    body = Body(Plan.of([sheared_patch(x, y)]), np.linspace(0.0, 3e-3, 3), 70e9, 0.3, held)
    load = 5.0 * body.average(lambda x, y: x > 20e-3 - 1e-9, 0) - 2.0 * body.average(lambda x, y: x > 20e-3 - 1e-9, 1)
    moved = body.solve(load[:, None])[:, 0]
    body.release()
    forces = body.section_forces(moved, 10e-3, (10e-3, 0.0), 1e-3)
    assert -forces == pytest.approx([5.0, -2.0, -2.0 * 10e-3], rel=1e-7)


def test_levers_that_cannot_be_built_are_refused() -> None:
    cls = parts.load("notched_lever", PARTS)
    known = study.read(str(PARTS / "notched_lever.toml")).design.part()
    with pytest.raises(Exception, match="input boss"):
        cls(**{**{p.name: getattr(known, p.name) for p in cls.dimensions}, "input_arm": 4e-3})
