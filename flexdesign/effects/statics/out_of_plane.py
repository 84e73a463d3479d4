"""Members bend and twist out of the plane they were cut from."""

from __future__ import annotations

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam, roots


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return the compliance along z, twisting, and turning about the line across the member."""
    at_roots, yielding = roots.out_of_plane(member, elastic)
    return values["share"] * (beam.out_of_plane(member, elastic, yielding) + at_roots)


EFFECT = Effect(
    name="out_of_plane",
    physics=(
        "A part guides in its plane, and is stiff against what leaves it, but not rigid: leaves bend over their width "
        "and twist. In a stage each part's plane is another, and what one axis moves, the parts of the others have to "
        "follow out of theirs."
    ),
    where="all hinges, arms and rods of a stage",
    reveal="K_out of a stage compared with that of its amplifiers alone; a push out of an amplifier's plane",
    remedy="wider or shorter leaves; the compliance model of a stage reckons with it",
    reference=(
        "S. P. Timoshenko and J. N. Goodier, Theory of Elasticity (1970); V. Z. Vlasov, Thin-Walled Elastic Beams "
        "(1961)"
    ),
    parameters=(Parameter("share", "1", "", "how much of it the members have", 0.0, 1.0, (0.0, 1.5)),),
    faces=tuple(Term(kind, compliance, out_of_plane=True) for kind in ("hinge", "arm", "rod", "block", "stub")),
    confused_with=("free_bodies",),
)
