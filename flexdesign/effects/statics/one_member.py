"""One hinge of several that were drawn alike differs from its twins."""

from __future__ import annotations

from dataclasses import replace

from flexdesign.core.model import Effect, Member, Parameter, Reshape
from flexdesign.core.model.effect import Values


def shape(member: Member, values: Values) -> Member:
    """Return the hinge as it was cut."""
    return replace(member, thickness=member.thickness - values["thinner"])


EFFECT = Effect(
    name="one_member",
    physics=(
        "One hinge is thinner or thicker than its twins: the wire was threaded anew there, lagged in a corner, or the "
        "plate moved as it was released. All stiffnesses fall a little, by less than a tenth where one hinge of eight "
        "has 0.7 of its thickness, and the output block tilts as it moves."
    ),
    where="a single hinge; a table identifies it up to symmetric copies",
    reveal="a microscope on every hinge; the tilt of the output block, which is none while all hinges are alike",
    remedy="measure every hinge; a part with one that is too thin has its largest stress there, so make it anew",
    reference="S. T. Smith, Flexures: Elements of Elastic Mechanisms (2000)",
    parameters=(
        Parameter("thinner", "m", "um", "drawn less true thickness of that hinge", 0.0, 2e-5, (-2e-4, 1e-3)),
        Parameter(
            "number",
            "1",
            "",
            "which hinge, as the linkage counts them",
            None,
            1.0,
            (1.0, 24.0),
            screen=tuple(range(1, 25)),
        ),
    ),
    faces=(Reshape(("hinge",), shape, "number"),),
    confused_with=("over_cut", "modulus"),
)
