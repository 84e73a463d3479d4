"""What made a result: its inputs, and the versions of the libraries that answered."""

from __future__ import annotations

from typing import Any

from flexdesign import part as parts
from flexdesign import refinement, units, versions
from flexdesign.files import as_text
from flexdesign.study import Study


def provenance(study: Study) -> dict[str, Any]:
    """Return the inputs and versions that made a result."""
    design = study.design
    kind, source = design.part_class.__name__, parts.source_hash(design.part_class)
    si = {parameter.name: parameter.si for parameter in design.part_class.dimensions}
    return {
        "design": design.name,
        "title": design.title,
        "provenance": design.provenance,
        "stage" if design.is_stage else "part": f"{kind} ({source})",
        "dimensions": {
            name: f"{value * 1e3:g} mm" if si[name] == "m" else f"{value:g}"
            for name, value in design.dimensions.items()
        },
        "material": design.material.as_text(),
        "actuator": as_text(design.actuator) if design.actuator else None,
        "mesh": as_text(study.mesh),
        **(_of_stage(study) if design.is_stage else {"modes": as_text(study.modes), "output": as_text(study.output)}),
        "versions": versions.installed(refinement.LIBRARIES),
    }


def _of_stage(study: Study) -> dict[str, Any]:
    return {
        "inputs": {axis: units.to_text(value, "um", si="m") for axis, value in study.stage.inputs.items()},
        "variants": list(study.variants),
    }
