"""From mesh to mesh: what is passed over, and whose estimates know of whose errors."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.core.result_cache import Cache
from flexdesign.design import study
from flexdesign.fem import mesh_refinement, stage_condensation
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.meshing import domain, methods
from flexdesign.fem.meshing.mesh import MeshError
from flexdesign.fem.meshing.methods import Extruded, Grading, Unstructured
from studies.error_bars.designs import PARTS

SIZES = (2e-5, 1e-5)


def refined(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, refused: set[int], cause: Exception
) -> tuple[list[Any], list[str], list[bool]]:
    """Return the levels of a study of three meshes, some of them refused, what was said, and which are whole."""
    tried: list[float] = []
    said: list[str] = []
    whole: list[bool] = []

    def level(*arguments: Any, all_classes: bool) -> Any:
        tried.append(arguments[4])
        if len(tried) - 1 in refused:
            raise InputError("part.toml", "mesh", None, f"mesh {len(tried)} is too coarse") from cause
        whole.append(all_classes)
        return arguments[4]

    monkeypatch.setattr(mesh_refinement, "_level", level)
    nothing: Any = SimpleNamespace(ports=lambda: [SimpleNamespace(role="input")])
    asked, method = study.read("bridge_amplifier"), SimpleNamespace(require_room=lambda _: None)
    return (
        mesh_refinement.refine(asked, nothing, nothing, cast(Any, method), Cache(tmp_path), said.append),
        said,
        whole,
    )


def test_a_mesh_that_cannot_be_used_is_passed_over(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    levels, said, whole = refined(monkeypatch, tmp_path, {0}, MeshError("off"))
    assert levels == [pytest.approx(1.35), 1.0]
    assert said == ["passing over this mesh: mesh 1 is too coarse"]
    assert whole == [True, True]  # two meshes must know what is extrapolated


def test_the_finest_of_three_meshes_goes_without_lateral_motions(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert refined(monkeypatch, tmp_path, set(), MeshError("off"))[2] == [True, True, False]


@pytest.mark.parametrize(("refused", "cause"), [({0, 2}, MeshError("off")), ({1}, MemoryError())])
def test_two_meshes_are_needed_and_memory_is_no_matter_of_the_mesh(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, refused: set[int], cause: Exception
) -> None:
    with pytest.raises(InputError, match=f"mesh {min(refused) + 1} is too coarse"):
        refined(monkeypatch, tmp_path, refused, cause)


@pytest.mark.parametrize(("refused", "tries", "meshed"), [(2, 3, 3), (3, 3, 3), (1, 1, 1), (0, 3, 1)])
def test_a_mesh_that_a_second_try_may_better_is_tried_again_and_only_a_good_one_kept(
    tmp_path: Path, refused: int, tries: int, meshed: int
) -> None:
    part = study.read("bridge_amplifier").design.part()
    body = domain.of_part(part, chord=domain.chord(part))
    hinges = part.linkage().of_kind("hinge")
    method = Stubborn(Extruded(Grading(body, part.linkage().members, 0.2, 1.2, None)), refused, tries)
    cache, said = Cache(tmp_path), list[str]()
    if refused < tries:
        _, checks = mesh_refinement.make_mesh(method, body, 1.0, hinges, cache, said.append)
        assert len(checks) == 4 and all(check.passed for check in checks)
        mesh_refinement.make_mesh(method, body, 1.0, hinges, cache, said.append)
    else:
        with pytest.raises(MeshError, match="upside down"):
            mesh_refinement.make_mesh(method, body, 1.0, hinges, cache, said.append)
    assert method.meshed == meshed
    assert said.count("meshing again: upside down") == min(refused, tries - 1)


#: Widths of the notched lever, of which the first asks for more than half a million tetrahedra.
WIDE, NARROW = "40 mm", "4 mm"


def wild(changes: list[str]) -> tuple[study.Study, Any, domain.Domain, Unstructured]:
    asked = study.read(str(PARTS / "notched_lever.toml"), ["mesh.method=wild", *changes])
    part = asked.design.part()
    body = domain.of_part(part, chord=domain.chord(part))
    method = mesh_refinement.method_of(asked, part, body)
    assert isinstance(method, Unstructured)
    return asked, part, body, method


def test_a_wild_mesh_without_end_is_refused_before_anything_is_meshed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(methods, "tetrahedralize", lambda *_: pytest.fail("it was meshed"))
    asked, part, body, method = wild([f'dimensions.width="{WIDE}"'])
    said = r"about 0\.\d+ million tetrahedra, and 0\.5 million are .* 24 GiB.*\"extruded\", a larger mesh\.at_root"
    with pytest.raises(InputError, match=said):
        mesh_refinement.refine(asked, part, body, method, Cache(tmp_path), pytest.fail)
    with pytest.raises(MeshError, match=said):
        mesh_refinement.make_mesh(method, body, 1.0, part.linkage().of_kind("hinge"), Cache(tmp_path), pytest.fail)
    for changes in ([f'dimensions.width="{NARROW}"'], [f'dimensions.width="{WIDE}"', "mesh.at_root=0.8"]):
        wild(changes)[3].require_room(1.0)


def test_parts_of_a_stage_are_refused_before_anything_is_condensed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage_condensation, "condense", lambda *_, **__: pytest.fail("it was condensed"))
    asked = study.read("lin2019_xyz_stage", ["mesh.method=wild", "mesh.at_root=0.005"])
    with pytest.raises(InputError, match=r"\w+\.py: mesh: the unstructured mesh would have about .* million"):
        stage_condensation.refine(asked, asked.design.stage().assembly(), Cache(tmp_path))


def test_an_accuracy_that_two_meshes_may_reach_asks_for_room_for_these_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[float] = []
    nothing: Any = SimpleNamespace(ports=lambda: [SimpleNamespace(role="input")])
    solved: list[float] = []
    monkeypatch.setattr(mesh_refinement, "_level", lambda *given, **_: solved.append(given[4]))
    monkeypatch.setattr(mesh_refinement, "gather_quantities", lambda *_: [])
    monkeypatch.setattr(mesh_refinement, "is_converged", lambda *_: True)
    for changes, head_start in (([], 1), (['mesh.accuracy="1 %"'], 0), (['mesh.accuracy="1 %"'], 1)):
        method: Any = SimpleNamespace(require_room=tried.append, scatter=MeshNoise(0.0), head_start=head_start)
        asked = study.read("bridge_amplifier", changes)
        mesh_refinement.refine(asked, nothing, nothing, method, Cache(tmp_path), pytest.fail)
    assert tried == pytest.approx([1.0, 1.35, 1.35**2])
    assert solved == pytest.approx([1.35**2, 1.35, 1.0, 1.35**2, 1.35, 1.35**3, 1.35**2])


class Stubborn:
    """A way to mesh that fails a number of times before it does not."""

    name = "stubborn"
    scatter = MeshNoise(0.0, 0.25)
    head_start = 0

    def __init__(self, method: Extruded, refused: int, tries: int) -> None:
        self.method, self.refused, self.tries, self.meshed = method, refused, tries, 0

    def mesh(self, coarseness: float) -> Any:
        self.meshed += 1
        if self.meshed <= self.refused:
            raise MeshError("upside down")
        return self.method.mesh(coarseness)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.method, name)


def found(k_in: float, ratio: float) -> dict[str, Quantity]:
    """Return what a mesh finds."""
    both = (Quantity("K_in", k_in, "N/m", "N/mm", "output free"), Quantity("lambda", ratio, "1", "", "output free"))
    return {quantity.key: quantity for quantity in both}


def test_an_amplification_that_does_not_move_inherits_the_scatter_of_the_stiffness() -> None:
    meshes = [found(1.02e6, -10.0), found(1.01e6, -10.0)]
    k_in, ratio = mesh_refinement.extrapolate_quantities(meshes, SIZES, MeshNoise(0.0, 0.25))
    assert ratio.value == -10.0 and k_in.half_width is not None and ratio.half_width is not None
    assert 0.0 < ratio.half_width / 10 < k_in.half_width / k_in.value
    _, alone = mesh_refinement.extrapolate_quantities(meshes, SIZES, MeshNoise(1e-4))
    assert alone.half_width is not None and alone.half_width / 10 < 1e-3  # a mesher without such scatter


@pytest.mark.parametrize("datum", [0.0, 1.0])
def test_the_error_of_a_place_does_not_depend_on_where_coordinates_begin(datum: float) -> None:
    """It is that of the distance from what the place is computed from."""
    meshes = [
        found(1e6, 1.0) | {"centre_x": Quantity("centre_x", datum + away, "m", "mm", datum=datum)}
        for away in (0.0202, 0.0201)
    ]
    centre = mesh_refinement.extrapolate_quantities(meshes, SIZES, MeshNoise(2e-3))[-1]
    (alone,) = mesh_refinement.extrapolate_quantities([found(0.0202, 1.0), found(0.0201, 1.0)], SIZES, MeshNoise(2e-3))[
        :1
    ]
    assert (centre.value - datum, centre.half_width) == pytest.approx((alone.value, alone.half_width), rel=0.01)


def test_the_estimated_error_is_the_largest() -> None:
    quantities = mesh_refinement.extrapolate_quantities(
        [found(1.02e6, -10.0), found(1.01e6, -10.0)], SIZES, MeshNoise(0.0, 0.25)
    )
    assert mesh_refinement.estimated_error(quantities) == pytest.approx(quantities[0].half_width / quantities[0].value)


def test_the_way_of_extrapolating_asks_for_no_other_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solutions in the cache stay good when estimates change, and only then."""
    before = mesh_refinement.engine()
    mesh_refinement.engine.cache_clear()
    read = Path.read_text

    def changed(name: str) -> Any:
        return lambda path, *a, **k: read(path, *a, **k) + ("# changed" if path.name == name else "")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "read_text", changed("convergence.py"))
        assert mesh_refinement.engine() == before
        mesh_refinement.engine.cache_clear()
        patched.setattr(Path, "read_text", changed("methods.py"))
        assert mesh_refinement.engine() != before
    mesh_refinement.engine.cache_clear()
