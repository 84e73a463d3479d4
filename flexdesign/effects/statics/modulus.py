"""Another Young's modulus than the material file has."""

from __future__ import annotations

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Scale Young's modulus."""
    return {**base, "modulus": base["modulus"] * (1.0 + values["excess"])}


EFFECT = Effect(
    name="modulus",
    physics=(
        "Alloys of one name differ by a percent or two, rolled sheet along and across by some more, and a "
        "wrong entry by anything. All stiffnesses scale with it; the amplification stays."
    ),
    where="the material",
    reveal="K_in and lambda together: lambda does not change; hinges of two thicknesses distinguish it from over-cut",
    remedy="measure a strip of the same plate, and put the modulus into the design",
    reference="F. Cardarelli, Materials Handbook (2008)",
    parameters=(Parameter("excess", "1", "%", "Young's modulus above the design's, over it", 0.0, 0.02, (-0.6, 1.5)),),
    faces=(Adjust(apply, of="part"),),
    confused_with=("over_cut",),
)
