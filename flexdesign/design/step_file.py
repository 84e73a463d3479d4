"""A STEP file as one closed solid, with what the file says of its solids and faces: names and colours.

CadQuery keeps names of faces for assemblies alone, in a private attribute. Here the document is read once, with the
kernel's own reader, so that single parts of any CAD program do as well. Lengths are in millimetres, whatever the unit
of the file: the reader converts.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.design import step_solids
from flexdesign.design.step_solids import NamedSolid

#: What programs write where a face has no name.
NO_NAMES = ("", "NONE", "None", "SOLID", "SHELL", "FACE")
#: A face is taken for one of before healing if centre and area differ by less than this, relative.
SAME_FACE = 1e-3


@dataclass(frozen=True)
class StepBody:
    """One solid and what its file says of it.

    Parameters
    ----------
    solid
        CadQuery solid [mm].
    names, colours
        By the index of a face in ``solid.Faces()``; colours as ``#rrggbb``.
    unit
        The unit of length in the file; empty if it states none.
    notes
        What was done to make one closed solid of it, one sentence each.
    solids
        Names or numbers of the solids that were asked for; none if all are taken.
    """

    solid: Any
    names: Mapping[int, str]
    colours: Mapping[int, str]
    unit: str
    notes: tuple[str, ...] = ()
    solids: tuple[str, ...] = ()


@dataclass
class _Labels:
    """Shapes and solids of a document, and names and colours by face, before faces have an index."""

    shapes: list[Any] = field(default_factory=list)
    solids: list[NamedSolid] = field(default_factory=list)
    names: list[tuple[Any, str]] = field(default_factory=list)
    colours: list[tuple[Any, str]] = field(default_factory=list)
    in_order: list[tuple[str, str]] = field(default_factory=list)


def read(path: Path, solids: tuple[str, ...] = ()) -> StepBody:
    """Read a STEP file.

    Parameters
    ----------
    path
        The file.
    solids
        Names or numbers of those that are meant, where it holds several; by default all.

    Raises
    ------
    InputError
        If it cannot be read, holds no closed solid, none of a name, or several that cannot be taken as one.
    """
    try:
        stat = path.stat()
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    if stat.st_size == 0:
        raise InputError(path, "", None, "is empty; export it anew, or copy it again")
    return _read(path.resolve(), solids, stat.st_mtime_ns, stat.st_size)


@functools.lru_cache(maxsize=8)
def _read(path: Path, solids: tuple[str, ...], _changed: int, _size: int) -> StepBody:
    labels, unit = _document(path)
    notes = [] if unit else ["The file states no unit of length; millimetres are assumed."]
    solid, further = step_solids.one_solid(labels.solids, labels.shapes, solids, path)
    solid, healed = step_solids.valid(solid, path)
    faces = solid.Faces()
    names = _by_index(faces, labels.names)
    names = _with_order(names, faces, labels.in_order) | names
    return StepBody(solid, names, _by_index(faces, labels.colours), unit, (*notes, *further, *healed), solids)


def _with_order(names: Mapping[int, str], faces: Sequence[Any], named: Sequence[tuple[str, str]]) -> dict[int, str]:
    """Return names by the order of faces in the file, if it is that of the solid's; none if a name or kind differs."""
    kinds = [face.geomType() for face in faces]
    same = len(named) == len(faces) and all(
        kind == known or (kind == "" and known not in ("PLANE", "CYLINDER"))
        for (_, kind), known in zip(named, kinds, strict=True)
    )
    if not same or any(named[index][0] != name for index, name in names.items()):
        return {}
    return {index: name for index, (name, _) in enumerate(named) if name not in NO_NAMES}


# --- the document -----------------------------------------------------------------------------------------------


def _document(path: Path) -> tuple[_Labels, str]:
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TColStd import TColStd_SequenceOfAsciiString
    from OCP.TDocStd import TDocStd_Document

    _silence()
    reader = STEPCAFControl_Reader()
    reader.SetColorMode(True)
    reader.SetNameMode(True)
    Interface_Static.SetIVal_s("read.stepcaf.subshapes.name", 1)
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    if reader.ReadFile(str(path)) != IFSelect_RetDone:
        raise InputError(path, "", None, "is no STEP file that can be read; export it anew, as AP214 or AP242")
    lengths, angles, solid_angles = (TColStd_SequenceOfAsciiString() for _ in range(3))
    reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
    unit = lengths.Value(1).ToCString() if lengths.Length() else ""
    document = TDocStd_Document(TCollection_ExtendedString("XmXCAF"))
    if not reader.Transfer(document):
        raise InputError(path, "", None, "holds no shape that can be read; export the part as a solid body")
    labels = _labels(document)
    labels.in_order = _in_order(reader)
    return labels, unit


def _silence() -> None:
    """Keep the kernel from writing to standard output what it thinks of a file: results are written there."""
    from OCP.Message import Message, Message_PrinterOStream

    Message.DefaultMessenger_s().RemovePrinters(Message_PrinterOStream.get_type_descriptor_s())


def _in_order(reader: Any) -> list[tuple[str, str]]:
    """Return name and kind of surface of each face of the file's only solid, in its order; empty if there are several.

    The document forgets the names of faces inside cavities; their order stays.
    """
    from OCP.StepShape import StepShape_BrepWithVoids, StepShape_ManifoldSolidBrep

    model = reader.ChangeReader().StepModel()
    entities = [model.Value(number) for number in range(1, model.NbEntities() + 1)]
    solids = [entity for entity in entities if isinstance(entity, StepShape_ManifoldSolidBrep)]
    if len(solids) != 1:
        return []
    (solid,) = solids
    shells = [solid.Outer()]
    if isinstance(solid, StepShape_BrepWithVoids):
        shells += [solid.VoidsValue(i + 1).ClosedShellElement() for i in range(solid.NbVoids())]
    listed = [shell.CfsFacesValue(i + 1) for shell in shells for i in range(shell.NbCfsFaces())]
    kinds = {"StepGeom_Plane": "PLANE", "StepGeom_CylindricalSurface": "CYLINDER"}
    return [
        (
            face.Name().ToCString().strip() if face.Name() is not None else "",
            kinds.get(face.FaceGeometry().DynamicType().Name(), ""),
        )
        for face in listed
    ]


def _labels(document: Any) -> _Labels:
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    found, free = _Labels(), TDF_LabelSequence()
    tool.GetFreeShapes(free)
    for label in free:
        found.shapes.append(_cast(tool.GetShape_s(label)))
        _collect(tool, label, None, found, document)
    return found


def _collect(
    tool: Any, label: Any, place: Any, found: _Labels, document: Any, above: str = "", names: tuple[str, ...] = ()
) -> None:
    """Go down from a label to its parts, and note what is said of them and of their faces where they stand.

    A face has its own colour, or that of its body, or the one `above`, of what the body is a part of. A solid has the
    names of its body, as such and where it stands in an assembly, and those of the assemblies that it is in.
    """
    from OCP.TDF import TDF_Label, TDF_LabelSequence
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    place = place or TopLoc_Location()
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    whole, names = _colour(colours, label) or above, (_name(label), *names)
    if tool.IsReference_s(label):
        own, referred = tool.GetLocation_s(label), TDF_Label()
        tool.GetReferredShape_s(label, referred)
        place, label = place.Multiplied(own), referred
        whole, names = whole or _colour(colours, label), (_name(label), *names)
    parts = TDF_LabelSequence()
    tool.GetComponents_s(label, parts)
    for part in parts:
        _collect(tool, part, place, found, document, whole, names)
    if parts.Length():
        return
    body = tool.GetShape_s(label)
    body = body if place.IsIdentity() else body.Moved(place)
    known = len(found.solids)
    found.solids += [NamedSolid(solid, _named(names)) for solid in _cast(body).Solids()]
    if whole:
        found.colours += [(face, whole) for face in _faces(body)]
    below = TDF_LabelSequence()
    tool.GetSubShapes_s(label, below)
    for child in below:
        shape = tool.GetShape_s(child)
        shape = shape if place.IsIdentity() else shape.Moved(place)
        found.solids[known:] = [
            NamedSolid(each.solid, _named((_name(child), *names))) if each.solid.wrapped.IsSame(shape) else each
            for each in found.solids[known:]
        ]
        for face in _faces(shape):
            if (name := _name(child)) not in NO_NAMES and face.wrapped.ShapeType() == shape.ShapeType():
                found.names.append((face, name))
            if colour := _colour(colours, child):
                found.colours.append((face, colour))


def _faces(shape: Any) -> list[Any]:
    return list(_cast(shape).Faces())


def _cast(shape: Any) -> Any:
    import cadquery as cq

    return cq.Shape.cast(shape)


def _name(label: Any) -> str:
    from OCP.TDataStd import TDataStd_Name

    attribute = TDataStd_Name()
    if not label.IsAttribute(TDataStd_Name.GetID_s()):
        return ""
    label.FindAttribute(TDataStd_Name.GetID_s(), attribute)
    return str(attribute.Get().ToExtString()).strip()


def _named(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for name in names if name not in NO_NAMES))


def _colour(tool: Any, label: Any) -> str:
    from OCP.Quantity import Quantity_ColorRGBA, Quantity_TOC_sRGB
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf

    colour = Quantity_ColorRGBA()
    for kind in (XCAFDoc_ColorSurf, XCAFDoc_ColorGen):
        if tool.GetColor_s(label, kind, colour):
            return "#" + "".join(f"{round(255 * part):02x}" for part in colour.GetRGB().Values(Quantity_TOC_sRGB))
    return ""


def _by_index(faces: Sequence[Any], named: Sequence[tuple[Any, str]]) -> dict[int, str]:
    """Return the names of faces by their index; of healed or bonded ones by their centre and area."""
    found: dict[int, str] = {}
    places = functools.cache(lambda: np.array([(*face.Center().toTuple(), face.Area()) for face in faces]))
    for face, text in named:
        same = [i for i, each in enumerate(faces) if each.isSame(face)] or _alike(face, places())
        if same:
            found[same[0]] = text
    return found


def _alike(face: Any, places: NDArray[np.float64]) -> list[int]:
    """Return the indices of the faces with centre and area of one, of `places` (n, 4), within `SAME_FACE`."""
    area = face.Area()
    away = np.linalg.norm(places[:, :3] - face.Center().toTuple(), axis=1)
    alike = (away < SAME_FACE * area**0.5) & (np.abs(places[:, 3] / area - 1) < SAME_FACE)
    return [int(index) for index in np.flatnonzero(alike)]
