"""What analytic models say of a part, whether its author wrote formulas or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flexdesign.analytic import frame
from flexdesign.analytic.compliance import ComplianceModel, nominal_effects
from flexdesign.core.model import Formulas, Quantity
from flexdesign.design.materials import Material
from flexdesign.design.part import Part, states


def formulas(
    part: Part, material: Material, actuator_stiffness: float | None, output_load: float | None
) -> Mapping[str, Sequence[Quantity]]:
    """Return the quantities of each analytic model by the model's name, as `Part.formulas` does.

    Of a part that states none there is the compliance model, if its linkage is a frame.
    """
    if states(part, "formulas"):
        return part.formulas(material, actuator_stiffness, output_load)
    try:
        model = ComplianceModel.of_part(part, material, actuator_stiffness).having(nominal_effects(part))
        found = tuple(model.quantities().values())
    except frame.Mechanism:
        return {}
    return Formulas({"compliance": lambda: found})
