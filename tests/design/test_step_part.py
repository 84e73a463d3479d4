"""Parts read from STEP files: names of faces survive, ports are found, and finite elements agree with the class."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cadquery as cq
import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError

from flexdesign.api.step_files import read_ports
from flexdesign.core.errors import InputError
from flexdesign.design import design, faces, step_file, step_part
from flexdesign.design.step_part import StepPart
from flexdesign.fem.quantities import port_stiffness
from tests.conftest import Ended

DESIGN = """format = 1
part = "{part}"
material = "Al 7075-T6"

[ports.ground]
{ground}

[ports.output]
{output}
"""


def exported(solid: cq.Shape, path: Path, names: dict[str, cq.Face], colours: dict[str, cq.Face] | None = None) -> Path:
    """Write a solid with named and coloured faces."""
    assembly = cq.Assembly(solid, name="part")
    for name, face in names.items():
        assembly.addSubshape(face, name=name)
    for colour, face in (colours or {}).items():
        assembly.addSubshape(face, color=cq.Color(*(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))))
    assembly.export(str(path))
    return path


def block() -> cq.Shape:
    return cq.Workplane().box(20, 10, 6).faces(">Z").workplane().hole(4).val()


def written(
    folder: Path, part: str = "part.step", ground: str = 'plane = "x = min"', output: str = 'plane = "x = max"'
):
    file = folder / "my_design.toml"
    file.write_text(DESIGN.format(part=part, ground=ground, output=output))
    return file


def ports_of(folder: Path, **tables: str) -> dict[str, tuple[int, ...]]:
    part = design.read(written(folder, **tables)).part()
    assert isinstance(part, StepPart)
    return {port.name: port.faces for port in part.ports()}


# --- names ------------------------------------------------------------------------------------------------------


def random_solid(rng: np.random.Generator) -> cq.Shape:
    """A box with pockets, holes and bosses at random."""
    size = rng.uniform(20, 60, 3)
    solid = cq.Workplane().box(*size)
    for _ in range(rng.integers(1, 4)):
        place, reach = rng.uniform(-0.5, 0.5, 3) * size, rng.uniform(0.1, 0.4, 3) * size
        tool = cq.Workplane(origin=tuple(place)).box(*reach)
        if rng.random() < 0.3:
            tool = cq.Workplane(origin=tuple(place)).circle(reach[0] / 2).extrude(reach[2])
        solid = solid.cut(tool) if rng.random() < 0.6 else solid.union(tool)
    return max(solid.val().Solids(), key=lambda each: each.Volume())


def require_names(folder: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    solid = random_solid(rng)
    some = rng.permutation(len(solid.Faces()))[: rng.integers(1, 6)]
    named = {f"port {rank}": solid.Faces()[i] for rank, i in enumerate(some.tolist())}
    body = step_file.read(exported(solid, folder / f"solid_{seed}.step", named))
    found = {name: body.solid.Faces()[i] for i, name in body.names.items()}
    assert found.keys() == named.keys()
    for name, face in named.items():
        assert found[name].Area() == pytest.approx(face.Area(), rel=1e-6)
        assert (found[name].Center() - face.Center()).Length < 1e-6


@pytest.mark.parametrize("seed", range(20))
def test_names_survive_the_file(tmp_path: Path, seed: int) -> None:
    require_names(tmp_path, seed)


@pytest.mark.slow
def test_names_survive_two_hundred_files(tmp_path: Path) -> None:
    for seed in range(100, 300):
        require_names(tmp_path, seed)


def test_names_stand_where_the_part_of_an_assembly_stands(tmp_path: Path) -> None:
    solid = cq.Workplane().box(4, 4, 4).val()
    inner = cq.Assembly(solid, name="inner", loc=cq.Location((10, 0, 0)))
    inner.addSubshape(max(solid.Faces(), key=lambda f: f.Center().x), name="far end")
    cq.Assembly(name="outer").add(inner).export(str(tmp_path / "a.step"))
    body = step_file.read(tmp_path / "a.step")
    ((index, name),) = body.names.items()
    assert name == "far end"
    assert body.solid.Faces()[index].Center().x == pytest.approx(12)


def test_a_body_coloured_as_a_whole_colours_its_faces(tmp_path: Path) -> None:
    """A face with a colour of its own keeps it."""
    solid = cq.Workplane().box(4, 4, 4).val()
    assembly = cq.Assembly(solid, name="body", color=cq.Color(0, 0, 1))
    assembly.addSubshape(max(solid.Faces(), key=lambda f: f.Center().x), color=cq.Color(1, 0, 0))
    assembly.export(str(tmp_path / "a.step"))
    body = step_file.read(tmp_path / "a.step")
    assert sorted(body.colours.values()) == ["#0000ff"] * 5 + ["#ff0000"]
    (red,) = (index for index, colour in body.colours.items() if colour == "#ff0000")
    assert body.solid.Faces()[red].Center().x == pytest.approx(2)


# --- how ports are found ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "output",
    [
        'face = "end"',
        'colour = "#ff0000"',
        'plane = "x = max"',
        'plane = "x = 10 mm"',
        'point = ["9.5 mm", "1 mm", "0 mm"]\nnormal = [1, 0, 0.05]',
    ],
)
def test_every_way_finds_the_same_face(tmp_path: Path, output: str) -> None:
    solid = block()
    end = max(solid.Faces(), key=lambda f: f.Center().x)
    exported(solid, tmp_path / "part.step", {"end": end}, {"#ff0000": end})
    (index,) = ports_of(tmp_path, output=output)["output"]
    body = step_file.read(tmp_path / "part.step")
    assert body.solid.Faces()[index].Center().x == pytest.approx(10)


def test_a_query_survives_a_small_edit(tmp_path: Path) -> None:
    query = 'point = ["10 mm", "0 mm", "0 mm"]\nnormal = [1, 0, 0]'
    for length, hole in ((20, 4), (21, 4.5), (19, 3)):
        solid = cq.Workplane().box(length, 10, 6).faces(">Z").workplane().hole(hole).edges("|Z and <X").fillet(1).val()
        exported(solid, tmp_path / f"part_{length}.step", {})
        (index,) = ports_of(tmp_path, part=f"part_{length}.step", output=query)["output"]
        face = step_file.read(tmp_path / f"part_{length}.step").solid.Faces()[index]
        assert face.Center().x == pytest.approx(length / 2)


def test_faces_in_one_plane_are_one_port(tmp_path: Path) -> None:
    solid = cq.Workplane().box(20, 10, 6).faces(">X").workplane().rect(2, 20).cutBlind(-2).val()
    exported(solid, tmp_path / "part.step", {})
    assert len(ports_of(tmp_path)["output"]) == 2


@pytest.mark.parametrize(("y", "pieces"), [(0.0, 2), (2.0, 1)])
def test_a_point_on_the_seam_of_a_plane_means_both_sides(tmp_path: Path, y: float, pieces: int) -> None:
    """Kernels that mirror a half leave its end face in two pieces."""
    half = cq.Workplane(origin=(0, 2.5, 0)).box(20, 5, 6).val()
    exported(half.fuse(half.mirror("XZ")), tmp_path / "part.step", {})
    query = f'point = ["10 mm", "{y} mm", "0 mm"]\nnormal = [1, 0, 0]'
    chosen = ports_of(tmp_path, output=query)["output"]
    areas = [step_file.read(tmp_path / "part.step").solid.Faces()[index].Area() for index in chosen]
    assert areas == pytest.approx([30.0] * pieces)


def test_inches_are_read_as_such(tmp_path: Path) -> None:
    exported(cq.Workplane().box(1, 1, 1).val(), tmp_path / "mm.step", {})
    text = (tmp_path / "mm.step").read_text()
    metres = re.sub(r"SI_UNIT\(\.MILLI\.,\.METRE\.\)", "SI_UNIT($,.METRE.)", text)
    assert metres != text
    (tmp_path / "m.step").write_text(metres)
    assert step_file.read(tmp_path / "mm.step").solid.Volume() == pytest.approx(1)
    assert step_file.read(tmp_path / "m.step").solid.Volume() == pytest.approx(1e9)


# --- bodies -----------------------------------------------------------------------------------------------------


def test_solids_that_touch_are_bonded_and_said_so(tmp_path: Path) -> None:
    two = cq.Compound.makeCompound(
        [cq.Workplane().box(4, 4, 4).val(), cq.Workplane(origin=(4, 0, 0)).box(4, 4, 4).val()]
    )
    cq.exporters.export(cq.Workplane(two), str(tmp_path / "two.step"))
    body = step_file.read(tmp_path / "two.step")
    assert body.solid.Volume() == pytest.approx(128)
    assert any("bonded" in note for note in body.notes)


@pytest.mark.parametrize(("shift", "words"), [(6, "2 mm away"), (3, "overlap by 16")])
def test_solids_apart_or_through_each_other_are_refused(tmp_path: Path, shift: float, words: str) -> None:
    two = cq.Compound.makeCompound(
        [cq.Workplane().box(4, 4, 4).val(), cq.Workplane(origin=(shift, 0, 0)).box(4, 4, 4).val()]
    )
    cq.exporters.export(cq.Workplane(two), str(tmp_path / "two.step"))
    with pytest.raises(InputError, match=words):
        step_file.read(tmp_path / "two.step")


def assembly(path: Path) -> Path:
    """Write two leaves of one shape on a plate, and a screw through the plate."""
    plate, leaf = cq.Workplane().box(20, 20, 4), cq.Workplane().box(1, 20, 10)
    whole = cq.Assembly(name="stage").add(plate, name="plate")
    for side in (-1, 1):
        whole.add(leaf, name="leaf" if side < 0 else "further leaf", loc=cq.Location((9.5 * side, 0, 7)))
    whole.add(cq.Workplane().circle(1).extrude(6), name="screw")
    whole.export(str(path))
    return path


@pytest.mark.parametrize(
    ("solids", "volume"),
    [(("further leaf",), 200), (("2",), 200), (("plate", "further leaf"), 1800), (("plate", "leaf"), 2000)],
)
def test_some_solids_of_an_assembly_are_taken(tmp_path: Path, solids: tuple[str, ...], volume: float) -> None:
    path = assembly(tmp_path / "stage.step")
    body = step_file.read(path, solids)
    assert body.solid.Volume() == pytest.approx(volume)
    assert any("Of the 4 solids of the file" in note and "taken" in note for note in body.notes)
    file = written(tmp_path, path.name)
    file.write_text(file.read_text().replace("material", f"solids = {[*solids]}\nmaterial"))
    assert design.read(file).part().solid().Volume() == pytest.approx(volume)


@pytest.mark.parametrize(
    ("solids", "words"),
    [
        ((), 'solid 1 "plate" and solid 4 "screw" of 4 overlap.*solids.*"leaf" .2, 3.'),
        (("leaf",), "18 mm away"),
        (("Leaf",), 'solids = Leaf: no solid has this name or number; the file holds "plate" .1., "leaf" .2, 3.'),
        (("5",), "no solid has this name or number"),
        (("0",), "no solid has this name or number"),
    ],
)
def test_solids_that_cannot_be_taken_are_refused(tmp_path: Path, solids: tuple[str, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        step_file.read(assembly(tmp_path / "stage.step"), solids)


def test_the_largest_solids_of_an_assembly_are_named_first_and_none_by_half(tmp_path: Path) -> None:
    """Screws overlap the plate that they are in, and there are many of them before the parts that are sought."""
    whole = cq.Assembly(name="stage")
    for k in range(12):
        whole.add(cq.Workplane().circle(1).extrude(6), name=f"Hex socket head cap screw M2 x {k}, stainless steel")
    whole.add(cq.Workplane().box(20, 20, 4), name="plate").add(cq.Workplane().box(5, 5, 9), name="slide")
    whole.export(str(tmp_path / "stage.step"))
    with pytest.raises(InputError, match=r'--solid\): "plate" \(13\), "slide" \(14\), .* and 10 more$'):
        step_file.read(tmp_path / "stage.step")


def test_all_solids_of_a_name_are_taken_and_a_body_may_have_several(tmp_path: Path) -> None:
    pair = cq.Compound.makeCompound([cq.Workplane(origin=(x, 0, 0)).box(4, 4, 4).val() for x in (0, 4)])
    cq.Assembly(name="stage").add(pair, name="pair").add(
        cq.Workplane(origin=(30, 0, 0)).box(1, 1, 1), name="loose"
    ).export(str(tmp_path / "stage.step"))
    assert step_file.read(tmp_path / "stage.step", ("pair",)).solid.Volume() == pytest.approx(128)
    with pytest.raises(InputError, match=r"make 2 bodies \(solids 1, 2; 3\); solid 3 .loose. is 23\.5 mm away"):
        step_file.read(tmp_path / "stage.step")


def test_solids_are_of_step_files(tmp_path: Path) -> None:
    file = tmp_path / "design.toml"
    file.write_text('format = 1\npart = "bridge_amplifier"\nsolids = [1]\nmaterial = "Al 7075-T6"\n')
    with pytest.raises(InputError, match="solids = 1: belong to a part from a STEP file"):
        design.read(file)


def test_an_open_shell_is_refused_and_a_closed_one_filled(tmp_path: Path) -> None:
    walls = cq.Workplane().box(4, 4, 4).val().Faces()
    cq.exporters.export(cq.Workplane(cq.Compound.makeCompound(walls[:-1])), str(tmp_path / "open.step"))
    with pytest.raises(InputError, match=r"no solid.*open shell.*close the surface"):
        step_file.read(tmp_path / "open.step")
    cq.exporters.export(cq.Workplane(cq.Compound.makeCompound(walls)), str(tmp_path / "closed.step"))
    body = step_file.read(tmp_path / "closed.step")
    assert body.solid.Volume() == pytest.approx(64)
    assert any("sewn" in note for note in body.notes)


def test_a_boundary_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    bow = [(0, 0), (10, 0), (10, 10), (4, -3), (0, 10)]
    wire = cq.Workplane().polyline(bow).close().wires().val()
    solid = cq.Solid.extrudeLinear(wire, [], cq.Vector(0, 0, 5))
    cq.exporters.export(cq.Workplane(solid), str(tmp_path / "bow.step"))
    with pytest.raises(InputError, match=r"crosses itself \(faces 1 and 3, between \(4, 0, 0\) and \(10, 0, 5\) mm\)"):
        step_file.read(tmp_path / "bow.step")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("nonsense", "is no STEP file that can be read"),
        ("ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;", ""),
    ],
)
def test_what_is_no_step_file_is_refused(tmp_path: Path, content: str, words: str) -> None:
    (tmp_path / "part.step").write_text(content)
    with pytest.raises(InputError, match=rf"part\.step.*{words}"):
        step_file.read(tmp_path / "part.step")


def test_the_kernel_writes_nothing_of_its_own(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Results are written to standard output; a file that ends in its middle made the kernel write there, too."""
    path = tmp_path / "cut.step"
    cq.exporters.export(cq.Workplane().box(3, 3, 3), str(path))
    capfd.readouterr()
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="is no STEP file that can be read"):
        step_file.read(path)
    assert capfd.readouterr().out == ""


def test_cavities_line_ends_and_round_faces_are_read(tmp_path: Path) -> None:
    """A hollow cube, a truncated cone with the line ends of Windows, and a ball of one face, by their volumes."""
    hollow = cq.Workplane().box(10, 10, 10).cut(cq.Workplane().box(5, 5, 5))
    cone = cq.Workplane().circle(3).workplane(offset=6).circle(1).loft()
    expected = {"hollow": 875.0, "cone": 26 * math.pi, "ball": 36 * math.pi}
    for name, body in {"hollow": hollow, "cone": cone, "ball": cq.Workplane().sphere(3)}.items():
        path = tmp_path / f"{name}.step"
        cq.exporters.export(body, str(path))
        if name == "cone":
            path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
        assert step_file.read(path).solid.Volume() == pytest.approx(expected[name], rel=1e-6)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"output": 'face = "ende"'}, "ports.output.face = ende: no face has this name; the nearest name is end, at"),
        ({"output": 'face = "top"\npoint = ["0 mm", "4 mm", "3 mm"]\nnormal = [0, 0, 1]'}, "nearest to where it was"),
        ({"output": 'face = "cone"'}, "cone is a cone; a port is a plane or a cylinder; the nearest plane face is"),
        (
            {"output": 'point = ["0 mm", "0 mm", "0 mm"]\naxis = [0, 0, 1]\nradius = "3 mm"'},
            "nearest is hole.*radius 2",
        ),
        ({"output": 'point = ["0 mm", "0 mm", "0 mm"]\naxis = [1, 0, 0]'}, "no cylinder like this is near this point"),
        ({"output": 'point = ["0 mm", "0 mm", "0 mm"]'}, "names no face.*point and axis"),
        ({"output": 'plane = "x = 12 mm"'}, "no plane face lies there; the nearest is end"),
        ({"output": 'plane = "x=="'}, 'expected a plane such as "z = max"'),
        ({"output": 'colour = "#00ff00"'}, "no face has this colour"),
        ({"output": 'point = ["90 mm", "0 mm", "0 mm"]\nnormal = [1, 0, 0]'}, "no face with this normal is near"),
        ({"output": ""}, "names no face"),
        ({"output": 'face = "end"\nplane = "x = max"'}, "name the faces in one way only"),
        ({"output": 'plane = "x = max"\naxis = [0, 0, 1]'}, "plane and axis: name the faces in one way only"),
        ({"output": 'plane = "x = max"\nradius = "2 mm"'}, "output.radius = 2 mm: give the axis of the cylinder, too"),
        ({"output": 'plane = "x = min"'}, "in common with ground"),
        ({"output": 'plane = "x = max"\nrole = "ground"'}, "exactly one port must have the role output"),
        ({"ground": 'plane = "x = min"\nrole = "input"'}, "the body is held nowhere"),
        ({"part": "prt.step"}, "no such file next to the design; did you mean part.step"),
    ],
)
def test_bad_ports_are_refused(tmp_path: Path, tables: dict[str, str], words: str) -> None:
    solid = cq.Workplane(block()).faces(">Z").edges("%CIRCLE").chamfer(0.5).val()
    named = {face.geomType(): face for face in solid.Faces()}
    named |= {"PLANE": max(solid.Faces(), key=lambda f: f.Center().x)}
    names = {"CYLINDER": "hole", "CONE": "cone", "PLANE": "end"}
    exported(solid, tmp_path / "part.step", {names[kind]: face for kind, face in named.items()})
    with pytest.raises(InputError, match=words):
        ports_of(tmp_path, **tables)


def test_an_actuator_needs_inputs(tmp_path: Path) -> None:
    exported(block(), tmp_path / "part.step", {})
    file = written(tmp_path)
    file.write_text(f'{file.read_text()}\n[actuator]\nfree_stroke = "10 um"\nstiffness = "10 N/um"\n')
    with pytest.raises(InputError, match="no port with the role input"):
        design.read(file)


def test_the_design_to_start_from_takes_the_same_solids(tmp_path: Path) -> None:
    found = read_ports(assembly(tmp_path / "stage.step"), solids=["further leaf"]).found
    file = tmp_path / "leaf.toml"
    file.write_text(found.design_for(tmp_path))
    assert 'solids = ["further leaf"]' in file.read_text()
    document = read_ports(tmp_path / "stage.step", solids=["further leaf"]).document
    assert document.sections[-1].code == found.design_for(tmp_path).rstrip()  # to copy as it is
    part = design.read(file).part()
    assert isinstance(part, StepPart)
    assert part.solid().BoundingBox().xmax == pytest.approx(10 + 1e3 * part.placed().moved[0])


def test_the_design_to_start_from_can_be_read(tmp_path: Path) -> None:
    from flexdesign.report import faces_report

    exported(block(), tmp_path / "part.step", {})
    listed = step_part.listed(step_file.read(tmp_path / "part.step"))
    (tmp_path / "start.toml").write_text(faces_report.design("part.step", listed))
    ports = design.read(tmp_path / "start.toml").part().ports()
    assert {port.role for port in ports} == {"ground", "output"}
    assert ports[0].normal == pytest.approx((-1, 0, 0))


def test_the_design_to_start_from_gives_points_where_all_faces_have_the_name_of_their_body(tmp_path: Path) -> None:
    """CATIA writes so."""
    solid = block()
    file = exported(solid, tmp_path / "part.step", {f"face {k}": face for k, face in enumerate(solid.Faces())})
    file.write_text(re.sub(r"'face \d'", "'PartBody'", file.read_text()))
    found = read_ports(file).found
    assert {face.name for face in found.faces} == {"PartBody"}
    (tmp_path / "start.toml").write_text(found.design_for(tmp_path))
    ground, output = design.read(tmp_path / "start.toml").part().ports()
    assert (ground.normal[0], output.normal[0]) == pytest.approx((-1, 1))


def test_the_design_to_start_from_has_the_hinge_between_its_ports(tmp_path: Path) -> None:
    """Two plates on a leaf, wider than they are far apart: the longest way ends twice on one plate."""
    solid = cq.Workplane().box(2, 10, 10).union(cq.Workplane().box(1.2, 0.1, 10).translate((1.5, 0, 0)))
    file = exported(solid.union(cq.Workplane().box(2, 10, 10).translate((3, 0, 0))).val(), tmp_path / "part.step", {})
    (tmp_path / "start.toml").write_text(read_ports(file).found.design_for(tmp_path))
    ground, output = design.read(tmp_path / "start.toml").part().ports()
    assert (ground.normal, output.normal) == (pytest.approx((-1, 0, 0)), pytest.approx((1, 0, 0)))
    assert output.point[0] - ground.point[0] == pytest.approx(5e-3)


@pytest.mark.parametrize("solid, ports", [(cq.Solid.makeSphere(10), 1), (cq.Solid.makeTorus(20, 4), 0)])
def test_a_design_to_start_from_names_no_face_twice_and_no_ball(solid: cq.Solid, ports: int, tmp_path: Path) -> None:
    """Half a ball has one plane."""
    text = read_ports(exported(solid, tmp_path / "part.step", {})).found.design_for(tmp_path)
    assert text.count("\n[ports.") == ports and "cut a plane" in text


def lug() -> cq.Shape:
    """A disc with a flat, about a bore in which the middle of its sides lies; one face alone is normal to y."""
    disc = cq.Workplane().circle(10).circle(7).extrude(4)
    return disc.cut(cq.Workplane(origin=(0, -14, 0)).box(20, 10, 10)).val()


def test_the_design_to_start_from_has_two_ports_where_one_face_alone_ends_the_longest_way(tmp_path: Path) -> None:
    file = exported(lug(), tmp_path / "part.step", {})
    (tmp_path / "start.toml").write_text(read_ports(file).found.design_for(tmp_path))
    ground, output = design.read(tmp_path / "start.toml").part().ports()
    assert ground.faces != output.faces
    assert ground.normal == pytest.approx((0, -1, 0))


def test_what_is_written_to_mean_a_face_finds_it_where_its_middle_lies_in_a_hole(tmp_path: Path) -> None:
    solid = lug()
    listed = faces.of_solid(solid, {}, {})
    side = max((face for face in listed if face.kind == "plane"), key=lambda face: face.area)
    middle = cq.Vertex.makeVertex(*(1e3 * np.array(side.centroid)))
    assert side.shape.distance(middle) > 5
    exported(solid, tmp_path / "part.step", {})
    how = "\n".join(faces.how_to_name(side, listed))
    (index,) = ports_of(tmp_path, ground='plane = "y = min"', output=how)["output"]
    assert step_part.listed(step_file.read(tmp_path / "part.step"))[index].normal == pytest.approx(side.normal)


@pytest.mark.parametrize("size", [(2000.0, 6000.0, 3000.0), (4.0, 40.0, 4.0)])
def test_the_picture_shows_all_of_a_solid_however_large_or_slender(
    tmp_path: Path, size: tuple[float, float, float]
) -> None:
    """Of a box three faces are seen, each as large as it looks along (0.45, 0.55, 1); numbers add a little."""
    cq.exporters.export(cq.Workplane().box(*size), str(tmp_path / "part.step"))
    drawn = read_ports(tmp_path / "part.step").document.figures[0].data
    ink = np.array(Image.open(io.BytesIO(drawn)).convert("L")) < 250
    assert not (ink[0].any() or ink[-1].any() or ink[:, 0].any() or ink[:, -1].any())
    toward = np.array([0.45, 0.55, 1.0]) / np.linalg.norm([0.45, 0.55, 1.0])
    up = np.array([0.0, 1.0, 0.0]) - toward[1] * toward
    scale = np.ptp(np.flatnonzero(ink.any(axis=1))) / (np.abs(up / np.linalg.norm(up)) @ size)
    assert ink.sum() == pytest.approx(scale**2 * (toward @ (np.prod(size) / np.array(size))), rel=0.05)


def test_a_ball_is_drawn_though_it_has_no_sharp_edges(tmp_path: Path) -> None:
    file = tmp_path / "part.step"
    cq.exporters.export(cq.Workplane().sphere(5), str(file))
    assert read_ports(file).document.figures


def test_a_cylinder_is_listed_with_radius_and_axis(tmp_path: Path) -> None:
    body = step_file.read(exported(block(), tmp_path / "part.step", {}))
    (hole,) = (face for face in faces.of_solid(body.solid, {}, {}) if face.kind == "cylinder")
    assert hole.radius == pytest.approx(2e-3)
    assert np.abs(hole.axis) == pytest.approx([0, 0, 1])


def test_a_design_that_exists_is_not_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command_line: Callable[..., Ended]
) -> None:
    monkeypatch.chdir(tmp_path)
    exported(block(), tmp_path / "part.step", {})
    assert command_line("ports", "part.step", "-o", "part.toml").code == 0
    (tmp_path / "part.toml").write_text("mine")
    ended = command_line("ports", "part.step", "-o", "part.toml")
    assert ended.code == 2
    assert "-o = part.toml: exists; choose another file" in ended.stderr
    assert (tmp_path / "part.toml").read_text() == "mine"


def test_solids_in_place_of_a_design_or_a_step_file_are_refused_with_the_remedy(tmp_path: Path) -> None:
    file = exported(block(), tmp_path / "part.step", {})
    with pytest.raises(InputError, match=r"is a STEP file.*`flexdesign ports .*part\.step -o .*part\.toml`"):
        design.read(file)
    (tmp_path / "design.toml").write_text('format = 1\npart = "Leaf.SLDPRT"\nmaterial = "Al 7075-T6"\n')
    with pytest.raises(InputError, match=r'part = Leaf\.SLDPRT: is no STEP file; export .*part = "Leaf\.step"'):
        design.read(tmp_path / "design.toml")


def test_the_report_lists_the_ports_where_the_file_has_them(tmp_path: Path) -> None:
    from flexdesign.fem.meshing import domain
    from flexdesign.report.validation import solid_section

    away = block().translate(cq.Vector(0, 7, 0))
    asked = design.read(
        written(exported(away, tmp_path / "part.step", {"foot": cq.Workplane(away).faces("<X").val()}).parent)
    )
    part = asked.part()
    assert any(part.moved())
    found: Any = SimpleNamespace(
        study=SimpleNamespace(design=asked), domain=domain.of_part(part, chord=domain.chord(part))
    )
    ports = solid_section.section(found).tables[0]
    assert ports.columns == ["port", "faces", "area", "centre", "normal", "interface"]
    assert [row[0] for row in ports.rows] == ["ground", "output"]
    assert ports.rows[0][1] == "foot"
    assert ports.rows[0][2:] == ["60 mm²", "-10, 7, 0 mm", "-1, 0, 0", "traction"]


def test_a_number_of_a_face_is_refused_with_what_to_give_instead() -> None:
    with pytest.raises(ValidationError, match="`flexdesign ports` with the STEP file lists names"):
        step_part.PortTable.model_validate({"face": 3})


# --- bores that are proposed as ports ------------------------------------------------------------------------------


def _eyes(tmp_path: Path, *holes: tuple[float, float, float]) -> str:
    """Return what is proposed for a bar of 80 x 16 x 6 mm with bores: place along it and beside it, radius [mm]."""
    import cadquery as cq

    bar = cq.Workplane("XY").box(80, 16, 6)
    for x, y, radius in holes:
        bar = bar.cut(cq.Workplane("XY").center(x, y).circle(radius).extrude(20, both=True))
    cq.exporters.export(bar, str(tmp_path / "bar.step"))
    return read_ports(tmp_path / "bar.step").found.design_for(tmp_path)


def test_the_two_bores_of_a_link_are_proposed_and_validate_reads_them(tmp_path: Path) -> None:
    """Also of different radii; the proposal is read as two rigid ports at the bores."""
    (tmp_path / "bar.toml").write_text(_eyes(tmp_path, (-30, 0, 4), (30, 0, 3)), encoding="utf-8")
    ports = {port.role: port for port in design.read(tmp_path / "bar.toml").part().ports()}
    assert np.subtract(ports["output"].point, ports["ground"].point) == pytest.approx([60e-3, 0, 0], abs=1e-9)
    assert all(port.rigid and port.is_round for port in ports.values())
    assert not any(port_stiffness.kind(motion, list(ports.values())) for motion in ("x", "z", "rz"))


def test_two_equal_bores_are_meant_among_others(tmp_path: Path) -> None:
    text = _eyes(tmp_path, (-30, 0, 4), (30, 0, 4), (0, 3, 2))
    assert text.count('radius = "4 mm"') == 2 and '# radius = "2 mm"' in text and "# Two bores" in text


@pytest.mark.parametrize(
    "holes",
    [
        [(-30, -4, 2), (30, -4, 2), (-30, 4, 2), (30, 4, 2)],  # for screws
        [(-15, 0, 4), (15, 0, 4)],  # too near
        [(0, 0, 4)],
    ],
)
def test_other_bores_are_comments_below_the_planes(holes: list[tuple[float, float, float]], tmp_path: Path) -> None:
    proposed, _, others = _eyes(tmp_path, *holes).partition("# Other faces")
    assert proposed.count('interface = "traction"') == 2 and "radius" not in proposed
    assert others.count("# radius = ") == len(holes)
