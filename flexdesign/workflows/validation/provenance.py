"""What made a result: its inputs, and the versions of the libraries that answered."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from flexdesign.core import units, versions
from flexdesign.core.toml_files import as_text
from flexdesign.design import part as parts
from flexdesign.design.study import Study
from flexdesign.fem import mesh_refinement

#: Units in which dimensions are shown, by SI unit.
_SHOWN = {"m": "mm", "rad": "deg"}


def provenance(study: Study, methods: Collection[str], solvers: Collection[str] = ()) -> dict[str, Any]:
    """Return the inputs and versions that made a result, of the libraries that took part.

    Parameters
    ----------
    study
        What was asked.
    methods
        The names of those that made meshes.
    solvers
        What solved the equations, in words; of a stage the one at hand, as its parts may come from the cache.
    """
    design = study.design
    kind, source = design.part_class.__name__, parts.source_hash(design.part_class)
    si = {parameter.name: parameter.si for parameter in design.part_class.dimensions}
    return {
        "design": design.name,
        "title": design.title,
        "provenance": design.provenance,
        "stage" if design.is_stage else "part": f"{kind} ({source})",
        "dimensions": {
            name: f"{value / units.factor(_SHOWN[si[name]], si[name]):g} {_SHOWN[si[name]]}".rstrip()
            if si[name] in _SHOWN
            else f"{value:g}"
            for name, value in design.dimensions.items()
        },
        "material": design.material.as_text(),
        "actuator": as_text(design.actuator) if design.actuator else None,
        "mesh": as_text(study.mesh),
        **(_of_stage(study) if design.is_stage else {"modes": as_text(study.modes), "output": as_text(study.output)}),
        "versions": versions.installed(_took_part(study, methods, solvers)),
    }


def _took_part(study: Study, methods: Collection[str], solvers: Collection[str]) -> list[str]:
    """Return the libraries that took part: solids, elements and arrays always, a mesher or a solver where it did."""
    left_out = {"meshio"}  # export alone
    if "wild" not in methods:
        left_out.add("pytetwild")
    if study.design.is_stage or study.design.part().linkage().of_kind("hinge"):
        left_out.add("netgen-mesher")  # of solids whose hinges nobody names
    if solvers and not any("PARDISO" in name for name in solvers):
        left_out.add("pypardiso")
    return [name for name in mesh_refinement.LIBRARIES if name not in left_out]


def _of_stage(study: Study) -> dict[str, Any]:
    return {
        "inputs": {axis: units.to_text(value, "um", si="m") for axis, value in study.stage.inputs.items()},
        "variants": list(study.variants),
    }
