"""Readers of binary formats: MATLAB, HDF5, LabVIEW's TDMS, universal files, NumPy. Each returns variables by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from flexdesign.measurements.importing.apart import apart
from flexdesign.measurements.importing.contents import Variable, from_memory, is_numeric, library

#: Attributes under which programs keep a unit, in small letters.
UNITS = ("unit", "units", "unit_string", "ni_unitdescription")
#: Fields of a structure, in small letters: the numbers of a signal, what it is called, and where it comes from.
DATA = ("data", "value", "values")
LABELS = ("name", "label", "title")
PLACES = ("description", "path", "blockname")
#: Functions of a data set 58: a response in time, and a frequency response.
TIME_RESPONSE, FREQUENCY_RESPONSE = 1, 4
#: How MATLAB names both parts of a complex number in an HDF5 file.
PARTS = ("real", "imag")


def matlab(path: Path) -> dict[str, Variable]:
    """Read a .mat file: versions 4 to 7 with SciPy, 7.3 as the HDF5 file that it is; structures as ``outer.inner``.

    A single structure that is named as the file is left out of the names.
    """
    from scipy.io import loadmat

    try:
        content = loadmat(path, struct_as_record=False, chars_as_strings=True)
    except NotImplementedError:  # version 7.3
        return _matlab_73(path)
    found: dict[str, Variable] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            found |= dict(_fields(name, value))
    prefix = f"{path.stem}."
    if all(name.startswith(prefix) for name in found):  # one structure, named as its file: one map serves many files
        found = {name.removeprefix(prefix): variable for name, variable in found.items()}
    return found


def _fields(name: str, value: Any) -> Iterator[tuple[str, Variable]]:
    """Yield the numeric arrays in a value, named as in MATLAB: ``log.Y(2).Data`` of a structure array."""
    if hasattr(value, "_fieldnames"):
        yield from _structure(name, value)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        elements = value.ravel(order="F")
        is_cell = not all(hasattr(element, "_fieldnames") for element in elements)
        for number, element in enumerate(elements, start=1):
            index = "" if len(elements) == 1 else f"{{{number}}}" if is_cell else f"({number})"
            yield from _fields(f"{name}{index}", element)
    elif isinstance(value, Variable):
        yield name, value
    elif isinstance(value, np.ndarray) and is_numeric(value.dtype) and value.size:
        yield name, from_memory(value)


def _matlab_73(path: Path) -> dict[str, Variable]:
    """Read a .mat file of version 7.3; its arrays are read when they are asked for."""
    h5py = library("h5py", path)
    found: dict[str, Variable] = {}
    with h5py.File(path, "r") as file:
        for name, item in file.items():
            if not name.startswith("#"):
                found |= dict(_fields(name, _of_matlab(h5py, path, item)))
    return found


def _of_matlab(h5py: Any, path: Path, item: Any) -> Any:
    """Return what an object of MATLAB's HDF5 holds, as SciPy returns it of older versions; arrays as variables.

    Texts are numbers of their letters. Cells are references to their elements; a structure array has such references in
    each of its fields. Objects of classes are left out: they are kept in a form of MATLAB's own.
    """
    kind = bytes(item.attrs.get("MATLAB_class", b""))
    if "MATLAB_empty" in item.attrs or "MATLAB_object_decode" in item.attrs:
        return None
    if isinstance(item, h5py.Group):
        fields = {name: _of_matlab(h5py, path, child) for name, child in item.items()}
        is_array = any(
            isinstance(child, h5py.Dataset) and _is_reference(h5py, child) and "MATLAB_class" not in child.attrs
            for child in item.values()
        )
        if not is_array:
            return SimpleNamespace(_fieldnames=list(fields), **fields)
        count = min(len(field) for field in fields.values())
        return _list(
            [SimpleNamespace(_fieldnames=list(fields), **{n: v[k] for n, v in fields.items()}) for k in range(count)]
        )
    if _is_reference(h5py, item):
        return _list([_of_matlab(h5py, path, item.file[reference]) for reference in item[()].ravel()])
    if kind == b"char":
        return np.array(["".join(map(chr, item[()].ravel()))])
    in_parts = item.dtype.names == PARTS and all(is_numeric(item.dtype[part]) for part in PARTS)
    if not item.size or not (in_parts or is_numeric(item.dtype)):
        return None
    read = partial(apart, path, _numbers, path, item.name, None, True)
    return Variable(item.shape[::-1], read, is_complex=in_parts or item.dtype.kind == "c")


def _is_reference(h5py: Any, item: Any) -> bool:
    return h5py.check_ref_dtype(item.dtype) is not None


def _list(elements: Sequence[Any]) -> Any:
    """Return elements of any kind as an array."""
    found = np.empty(len(elements), dtype=object)
    found[:] = elements
    return found


def _structure(name: str, structure: Any) -> Iterator[tuple[str, Variable]]:
    """Yield the arrays of a structure; those of a signal have its name and its unit."""
    fields = {field: getattr(structure, field) for field in structure._fieldnames}
    texts = {field.lower(): str(value.item()).strip() for field, value in fields.items() if _is_text(value)}
    unit = next((texts[key] for key in UNITS if key in texts), "")
    label = next((texts[key] for key in LABELS if key in texts), "")
    note = "; ".join(dict.fromkeys(texts[key] for key in (*LABELS, *PLACES) if texts.get(key)))
    is_control_desk = {"X", "Y"} <= fields.keys()  # time and signals, as dSPACE's ControlDesk writes them
    for field, value in fields.items():
        for path, variable in _fields(f"{name}.{field}", value):
            if path == f"{name}.{field}" and field.lower() in DATA:
                variable = replace(variable, unit=unit, label=label, note=note)
            if is_control_desk and field == "X" and path.endswith(".Data"):
                variable = replace(variable, unit=variable.unit or "s", label="time", note="time")
            yield path, variable


def _is_text(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind == "U" and value.size == 1


def hdf5(path: Path) -> dict[str, Variable]:
    """Read an HDF5 file: data sets as ``group/name``, columns of tables as ``table/column``; numbers may be complex."""
    h5py = library("h5py", path)
    found: dict[str, Variable] = {}

    def read(name: str, column: str | None) -> Any:
        return partial(apart, path, _numbers, path, name, column, False)

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#") or not item.size or item.dtype is None:
            return
        unit = _unit({key: item.attrs[key] for key in item.attrs})
        in_parts = item.dtype.names == PARTS and all(is_numeric(item.dtype[part]) for part in PARTS)
        for column in () if in_parts else item.dtype.names or ():
            if is_numeric(item.dtype[column]):
                is_complex = item.dtype[column].kind == "c"
                found[f"{name}/{column}"] = Variable(item.shape, read(name, column), unit, is_complex=is_complex)
        if in_parts or (not item.dtype.names and is_numeric(item.dtype)):
            is_complex = in_parts or item.dtype.kind == "c"
            found[name] = Variable(item.shape, read(name, None), unit, is_complex=is_complex)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return found


def _numbers(path: Path, name: str, column: str | None, of_matlab: bool) -> Any:
    """Return the numbers of a data set or of a column of it.

    MATLAB stores arrays by columns, HDF5 by rows: of a .mat file axes come back in MATLAB's order.
    """
    with library("h5py", path).File(path, "r") as file:
        values = file[name][()] if column is None else file[name][column]
    if column is None and values.dtype.names == PARTS:
        values = values["real"] + 1j * values["imag"]
    return values.T if of_matlab else values


def tdms(path: Path) -> dict[str, Variable]:
    """Read a .tdms file: channels as ``group/channel``; time stamps become seconds since the first."""
    content = library("nptdms", path).TdmsFile.read(path)
    found = {}
    for group in content.groups():
        for channel in group.channels():
            values, step = channel[:], channel.properties.get("wf_increment")
            name, unit = f"{group.name}/{channel.name}", _unit(channel.properties)
            if values.dtype.kind == "M":
                values, unit = (values - values[:1]) / np.timedelta64(1, "s"), "s"
            if is_numeric(values.dtype) and values.size:
                found[name] = from_memory(values, unit, float(step) if step else None)
    return found


def universal(path: Path) -> dict[str, Variable]:
    """Read a universal file: data sets 58 as ``set1``, ``set2``, ...

    Responses in time and frequency responses are read, others are passed over. The abscissa of a set is
    ``set1.frequency`` or, where times are not even, ``set1.time``.
    """
    file = library("pyuff", path).UFF(str(path))
    found = {}
    for number, kind in enumerate(file.get_set_types()):
        if kind != 58:
            continue
        data = file.read_sets(number)
        values = np.asarray(data["data"])
        function = data["func_type"]
        known = function in (TIME_RESPONSE, FREQUENCY_RESPONSE)
        if not known or not is_numeric(values.dtype) or not values.size:
            continue
        place = f"node {data['rsp_node']}, direction {data['rsp_dir']}"
        note = "; ".join(text for text in (str(data.get("id1", "")).strip(), place) if text and text != "NONE")
        unit, name = _label(data, "ordinate_axis_units_lab"), f"set{number + 1}"
        if function == FREQUENCY_RESPONSE:
            per = _label(data, "orddenom_axis_units_lab")
            found[name] = from_memory(values, f"{unit}/({per})" if unit and per else "", note=note)
            found[f"{name}.frequency"] = from_memory(np.asarray(data["x"]), "Hz", note="abscissa of the set")
            continue
        is_even = data.get("abscissa_spacing") == 1
        step = float(data["abscissa_inc"]) if is_even else None
        found[name] = from_memory(values, unit, step, note)
        if not is_even:
            found[f"{name}.time"] = from_memory(np.asarray(data["x"]), "s", note="abscissa of the set")
    return found


def _label(data: Mapping[str, Any], key: str) -> str:
    text = str(data.get(key, "")).strip()
    return "" if text == "NONE" else text


def numpy_array(path: Path) -> dict[str, Variable]:
    """Read a .npy file: one variable, named as the file."""
    values = np.load(path, mmap_mode="r")
    return {path.stem: from_memory(values)} if is_numeric(values.dtype) and values.size else {}


def numpy_archive(path: Path) -> dict[str, Variable]:
    """Read a .npz file: its arrays by their names."""
    with path.open("rb") as file, np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return {name: from_memory(values) for name, values in arrays.items() if is_numeric(values.dtype) and values.size}


def _unit(attributes: Mapping[str, Any]) -> str:
    """Return the unit among the attributes of a variable."""
    for key, value in attributes.items():
        if key.lower() in UNITS:
            text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
            return text.strip()
    return ""
