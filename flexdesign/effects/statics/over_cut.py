"""The wire cut more than drawn: members are thinner."""

from __future__ import annotations

from dataclasses import replace

from flexdesign.core.model import Effect, Member, Parameter, Reshape
from flexdesign.core.model.effect import Values


def shape(member: Member, values: Values) -> Member:
    """Return the member as it was cut."""
    return replace(member, thickness=member.thickness - values["thinner"])


EFFECT = Effect(
    name="over_cut",
    physics=(
        "Wire EDM burns a gap wider than the wire, and leaves a recast layer that carries nothing: what is cut from "
        "both sides is thinner than drawn. The rotational stiffness of a hinge goes with the cube of its "
        "thickness, so that 10 um off a hinge of 0.5 mm take 6 % off K_out."
    ),
    where="every cut face; it shows in the hinges",
    reveal="hinges of two thicknesses cut alike: the thin one loses more; or a microscope",
    remedy="a larger wire offset; or measure a hinge, and put its true thickness into the design",
    reference=(
        "K. H. Ho and S. T. Newman, State of the art electrical discharge machining (EDM), Int. J. Mach. Tools Manuf. "
        "43 (2003)"
    ),
    parameters=(Parameter("thinner", "m", "um", "drawn less true thickness of hinges", 0.0, 5e-6, (-1e-4, 2e-4)),),
    faces=(Reshape(("hinge", "rod", "arm"), shape),),
    confused_with=("modulus", "root_flexibility"),
)
