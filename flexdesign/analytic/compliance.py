"""The compliance model: a mechanism as hinges, arms and rods that give way, effect by effect.

Without effects it is the paper's pseudo-rigid-body model: hinges that rotate, rigid arms and blocks, and rods that the
hinge's moment bends. Each static effect of the catalogue (`flexdesign.effects.statics`) adds what it knows: compliance
of members, a truer shape, another modulus, a spring at a port. With all effects that follow from the drawing, it is a
fast substitute for finite elements; other effects model what a test bench may hide.

Between input and output the mechanism is a compliance of 2 by 2: the actuator's force and its extension, the output's
force and its travel along its normal. Stiffness is a matter of what holds the other port, and follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from flexdesign.analytic import frame
from flexdesign.analytic.force_method import ForceMethod
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.memo import Memo
from flexdesign.core.model import Adjust, Elastic, Linkage, Member, Quantity, Reshape, Term, by_key
from flexdesign.core.model.linkage import Vector
from flexdesign.design.materials import Material
from flexdesign.design.part import Piece, Port
from flexdesign.effects import statics
from flexdesign.effects.hinge_compliance import beam

Effects = Mapping[str, Mapping[str, float]]
ItsValues = tuple[tuple[str, float], ...]
TermWithValues = tuple[Term, ItsValues]
SOURCE, PIVOTS = "compliance model", "compliance model, hinges only rotate"

#: What effects may change besides the members: factor on E; share of the constraint by the width; springs [N/m] and
#: compliances [m/N] at the ports, added to those that a quantity's boundary states, a contact's in series with whatever
#: holds the inputs or with the actuator alone; force of the actuator [N] under which stiffnesses are taken; whether the
#: bodies of a stage move as they like.
BASE: Mapping[str, float] = {
    "modulus": 1.0,
    "constraint": 0.0,
    "output_load": 0.0,
    "input_restraint": 0.0,
    "contact_compliance": 0.0,
    "actuator_compliance": 0.0,
    "base_compliance": 0.0,
    "force": 0.0,
    "free_bodies": 0.0,
}
#: Steps in which an actuator's force is put on.
STEPS = 4


@dataclass(frozen=True, eq=False)
class ComplianceModel:
    """A mechanism with effects.

    Parameters
    ----------
    linkage, ports
        Of the part.
    youngs_modulus, poissons_ratio
        E [Pa] and nu.
    actuator_stiffness
        Of the actuator with its seats [N/m]; None without one.
    effects
        Values of their parameters, SI, by effect and parameter.

    Raises
    ------
    frame.Mechanism
        When asked for a compliance, if the linkage can move freely.
    """

    linkage: Linkage
    ports: tuple[Port, ...]
    youngs_modulus: float
    poissons_ratio: float
    actuator_stiffness: float | None = None
    effects: Effects = field(default_factory=dict)

    @classmethod
    def of_part(cls, part: Piece, material: Material, actuator_stiffness: float | None = None) -> ComplianceModel:
        """Return the model of a part without effects; fillets that are drawn are one of them."""
        linkage = part.linkage()
        for port in part.ports():
            if port.name not in linkage.ports:
                raise frame.Mechanism(f"the port {port.name} stands on no node: ports = {{'{port.name}': NODE}}")
        sharp = tuple(replace(member, root_radius=0.0) for member in linkage.members)
        bare = replace(linkage, members=sharp)
        return cls(bare, part.ports(), material.youngs_modulus, material.poissons_ratio, actuator_stiffness)

    def having(self, effects: Effects) -> ComplianceModel:
        """Return the model with these effects in the place of its own."""
        other = replace(self, effects=effects)
        vars(other)["_memo"] = self._memo
        return other

    @cached_property
    def _memo(self) -> Memo:
        """What was found of linkage and ports, with whatever effects."""
        return Memo()

    # --- members ----------------------------------------------------------------------------------------------

    @cached_property
    def base(self) -> Mapping[str, float]:
        """Springs in addition to the members: `BASE` as changed by the effects."""
        values: Mapping[str, float] = BASE
        for name in sorted(self.effects):
            for face in statics.find(name).faces:
                if isinstance(face, Adjust) and face.of == "part":
                    values = face.apply(values, self.effects[name])
        return values

    @cached_property
    def members(self) -> tuple[Member, ...]:
        """The members in their true shape."""
        return self._shaped.members

    @cached_property
    def _reshapes(self) -> tuple[tuple[Reshape, ItsValues], ...]:
        """What changes the shape of members."""
        return tuple((face, values) for face, values in self._faces if isinstance(face, Reshape))

    @cached_property
    def _shaped(self) -> _Shaped:
        """The members in their true shape, and which are alike."""
        return self._memo.once(("shaped", self._reshapes), lambda: _shaped(self.linkage.members, self._reshapes))

    @cached_property
    def _elastic(self) -> Elastic:
        """What material and width make of all members."""
        return Elastic(self.base["modulus"] * self.youngs_modulus, self.poissons_ratio, self.base["constraint"])

    @cached_property
    def _terms(self) -> tuple[TermWithValues, ...]:
        """The compliances that effects add to members."""
        return tuple((face, values) for face, values in self._faces if isinstance(face, Term))

    @cached_property
    def _faces(self) -> list[tuple[object, ItsValues]]:
        """The faces of all effects, with the values of their parameters."""
        return [
            (face, tuple(self.effects[name].items()))
            for name in sorted(self.effects)
            for face in statics.find(name).faces
        ]

    @cached_property
    def state(self) -> Hashable:
        """What its members depend on: models of the same linkage that share it differ in springs at the ports alone."""
        return self._reshapes, self._terms, self._elastic

    def member_compliance(self, member: Member, *, out_of_plane: bool = False) -> Array:
        """Return what a member of true shape gives way, 3 by 3; out of its plane nothing does without effects."""
        terms = self._terms_of(member, out_of_plane=out_of_plane)
        return _member_compliance(_at_origin(member), self._elastic, terms, out_of_plane)

    def _terms_of(self, member: Member, *, out_of_plane: bool) -> tuple[TermWithValues, ...]:
        mine = (member.kind, out_of_plane)
        return tuple(each for each in self._terms if (each[0].member_kind, each[0].out_of_plane) == mine)

    def _compliances(self, *, out_of_plane: bool = False) -> Array:
        """Return what every member gives way, shape (members, 3, 3)."""
        found = [
            _member_compliance(each, self._elastic, self._terms_of(each, out_of_plane=out_of_plane), out_of_plane)
            for each in self._shaped.kinds
        ]
        return np.array(found)[self._shaped.kind_of]

    # --- ports ------------------------------------------------------------------------------------------------

    @cached_property
    def port_compliance(self) -> Array:
        """Compliance between the ports, 2 by 2 [m/N]: row and column 0 the actuator's, 1 the output's."""
        force = self.base["force"]
        found = self._memo.once(("ports", self.state, force), self._loaded_compliance if force else self._compliance)
        return found + np.diag([0.0, self.base["base_compliance"]])

    def _compliance(self) -> Array:
        """Return the compliance between the ports at rest."""
        loads = [self._pull("input"), self._pull("output")]
        return self._between_loads("ports", self._grounds, loads, self._compliances())

    def _between_loads(
        self,
        name: Hashable,
        held: Sequence[str],
        loads: Sequence[Mapping[str, Array]],
        compliances: Array,
        *,
        out_of_plane: bool = False,
    ) -> Array:
        """Return the compliance between loads; `name` stands for them and for what is held."""
        key = ("forces", name, out_of_plane, self._shaped.places)
        linkage = replace(self.linkage, members=self.members)
        forces = self._memo.once(key, lambda: ForceMethod(linkage, held, loads, out_of_plane=out_of_plane))
        return forces.compliance(compliances)

    @property
    def _grounds(self) -> list[str]:
        return [self.linkage.ports[port.name] for port in self.ports if port.role == "ground"]

    def _loaded_compliance(self) -> Array:
        """Return the compliance between the ports as the actuator's force has moved and loaded the members."""
        compliances = {m.name: c for m, c in zip(self.members, self._compliances(), strict=True)}
        loads, grounds = [self._pull(role) for role in ("input", "output")], self._grounds
        linkage, tensions = self._deform(replace(self.linkage, members=self.members), compliances, grounds, loads[0])
        solutions = frame.solve(linkage, compliances, grounds, loads, tensions)
        return np.array([[sum(float(pull[n] @ s.motions[n]) for n in pull) for s in solutions] for pull in loads])

    def _deform(
        self, linkage: Linkage, compliances: Mapping[str, Array], grounds: Sequence[str], pull: Mapping[str, Array]
    ) -> tuple[Linkage, dict[str, float]]:
        """Return the linkage as the actuator's force has moved it, and the tensions then, by steps of the midpoint."""
        tensions = dict.fromkeys(compliances, 0.0)
        step = {node: self.base["force"] / STEPS * force for node, force in pull.items()}
        half = {node: force / 2 for node, force in step.items()}

        def pulled(more: Mapping[str, Array]) -> dict[str, float]:
            return {name: tensions[name] + float(forces[0]) for name, forces in more.items()}

        for _ in range(STEPS):
            first = frame.solve(linkage, compliances, grounds, [half], tensions)[0]
            middle = frame.displace(linkage, first.motions)
            second = frame.solve(middle, compliances, grounds, [step], pulled(first.forces))[0]
            linkage, tensions = frame.displace(linkage, second.motions), pulled(second.forces)
        return linkage, tensions

    def _pull(self, role: str) -> dict[str, Array]:
        """Return a unit load: an actuator pushes its ports apart, an output force acts along its normal."""
        pull: dict[str, Array] = {}
        for port in self.ports:
            if port.role == role:
                node = self.linkage.ports[port.name]
                way = -1.0 if role == "input" else 1.0
                force = (way * port.normal[0], way * port.normal[1])
                at_node = frame.transfer_force(self.linkage.nodes[node], port.point, force)
                pull[node] = pull.get(node, np.zeros(3)) + at_node
        return pull

    def compliance_between(self, first: Port, second: Port) -> Array:
        """Return what the piece gives way between two ports, the first held, 7 by 7, SI.

        Rows: motions of the second port's point along x, y and z and about them, and the actuator's extension; columns:
        the forces and moments there, and the actuator's force. Ports face each other in the piece's plane.
        """
        key = ("between", first.name, second.name)
        return self._memo.once((*key, self.state), lambda: self._compliance_between(key, first, second))

    def _compliance_between(self, key: Hashable, first: Port, second: Port) -> Array:
        held, node = [self.linkage.ports[first.name]], self.linkage.ports[second.name]
        place, found = self.linkage.nodes[node], np.zeros((7, 7))
        in_plane, out_of_plane = [0, 1, 5, 6], [2, 3, 4]
        dx, dy = second.point[0] - place[0], second.point[1] - place[1]
        to_point = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        loads = [{node: force} for force in to_point] + [self._pull("input")]
        found[np.ix_(in_plane, in_plane)] = self._between_loads(key, held, loads, self._compliances())
        compliances = self._compliances(out_of_plane=True)
        if compliances.any():
            to_point = np.array([[1.0, dy, -dx], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
            loads = [{node: force} for force in to_point]
            between = self._between_loads(key, held, loads, compliances, out_of_plane=True)
            found[np.ix_(out_of_plane, out_of_plane)] = between
        return found

    # --- quantities -------------------------------------------------------------------------------------------

    def input_stiffness(self, output_load: float = 0.0) -> float:
        """K_in with a spring at the output [N/m]; an infinite one holds it. Infinite where nothing gives way."""
        extension = self._drive(output_load)[0]
        return 1 / extension if extension > 0 else math.inf

    def amplification(self, output_load: float = 0.0) -> float:
        """Amplification with a spring at the output, signed along the output's normal; NaN where nothing gives way."""
        extension, travel = self._drive(output_load)
        return travel / extension if extension > 0 else math.nan

    def output_stiffness(self, input_stiffness: float = 0.0) -> float:
        """K_out with a spring between the inputs [N/m]: 0 leaves them free, infinite holds them."""
        (c11, c12), (c21, c22) = self.port_compliance
        hold = input_stiffness + self.base["input_restraint"] if input_stiffness == 0 else input_stiffness
        if hold == 0:
            return float(1 / c22) if c22 > 0 else math.inf
        series = c11 + 1 / hold + seats(self.base, input_stiffness)
        left = c22 - c12 * c21 / series if series > 0 else c22
        return float(1 / left) if left > 1e-12 * abs(c22) else math.inf

    def _drive(self, output_load: float) -> tuple[float, float]:
        """Return extension and travel per force of the actuator, with a spring at the output."""
        (c11, c12), (c21, c22) = self.port_compliance
        load = output_load + self.base["output_load"]
        per_travel = 1 / c22 if math.isinf(load) else load / (1 + load * c22)  # force of the spring per free travel
        return float(c11 - c12 * c21 * per_travel), float(c21 - c22 * c21 * per_travel)

    def quantities(self) -> dict[str, Quantity]:
        """Return stiffnesses and amplification, as FEM states them, by `Quantity.key`, if they are finite."""
        holds = {"input free": 0.0, "input held": math.inf}
        if self.actuator_stiffness is not None:
            holds["actuator installed"] = self.actuator_stiffness
        source = SOURCE if self.effects else PIVOTS
        found = [
            Quantity("K_in", self.input_stiffness(), "N/m", "N/mm", "output free", source),
            Quantity("lambda", self.amplification(), "1", "", "output free", source),
        ]
        for boundary, stiffness in holds.items():
            found.append(Quantity("K_out", self.output_stiffness(stiffness), "N/m", "N/mm", boundary, source))
        return by_key(quantity for quantity in found if math.isfinite(quantity.value))


def seats(base: Mapping[str, float], stiffness: float) -> float:
    """Return what gives way in series with what holds the inputs [m/N]: nothing, a clamp (infinite) or an actuator."""
    if stiffness == 0:
        return 0.0
    return base["contact_compliance"] + (base["actuator_compliance"] if math.isfinite(stiffness) else 0.0)


@dataclass(frozen=True, eq=False)
class _Shaped:
    """Members in their true shape: those that differ, each at the origin, and which of them each member is."""

    members: tuple[Member, ...]
    kinds: tuple[Member, ...]
    kind_of: list[int]

    @cached_property
    def places(self) -> tuple[tuple[Vector, Vector], ...]:
        """Where the members begin and end."""
        return tuple((member.start, member.end) for member in self.members)


def _shaped(members: Sequence[Member], reshapes: Sequence[tuple[Reshape, ItsValues]]) -> _Shaped:
    """Return members in their true shape.

    Raises
    ------
    InputError
        If nothing is left of one.
    """
    shaped = {member.name: member for member in members}
    for face, items in reshapes:
        values = dict(items)
        for member in face.changed(members, values):
            shaped[member.name] = face.shape(shaped[member.name], values)
    if cut := [member.name for member in shaped.values() if member.thickness <= 0]:
        raise InputError("design", "effects", None, f"nothing is left of {cut[0]}: it is cut through")
    kinds: dict[Member, int] = {}
    kind_of = [kinds.setdefault(_at_origin(member), len(kinds)) for member in shaped.values()]
    return _Shaped(tuple(shaped.values()), tuple(kinds), kind_of)


def _at_origin(member: Member) -> Member:
    """Return a member without its name and its place, by which what it gives way does not change."""
    end = (round(member.length, 12), 0.0, 0.0)
    return replace(member, name="", nodes=("", ""), start=(0.0, 0.0, 0.0), end=end)


@lru_cache(maxsize=10_000)
def _member_compliance(shape: Member, elastic: Elastic, terms: tuple[TermWithValues, ...], out_of_plane: bool) -> Array:
    """Return what a member gives way, with the compliances that effects add, and the values of their parameters.

    A fit asks for the same again and again: most effects change few members.
    """
    total = np.zeros((3, 3)) if out_of_plane else _pseudo_rigid(shape, elastic)
    for term, values in terms:
        total = total + term.compliance(shape, elastic, dict(values))
    total.flags.writeable = False
    return total


def _pseudo_rigid(member: Member, elastic: Elastic) -> Array:
    """Return what a member gives way in the paper's model: hinges rotate (2), rods bend as cantilevers (14).

    The rod's tip moves under force and moment, and does not turn. By (11) the moment is the hinge's, at the hinge's own
    centre, a lever e to the left of the rod: with N, V and M_c at the rod's centre M = M_c + V l / 2 + N e, so that
    l^3 V / 3EI - l^2 M / 2EI is l^3 V / 12EI - l^2 (M_c + N e) / 2EI. A rod's start is its tip.
    """
    compliance = np.zeros((3, 3))
    if member.kind == "hinge":
        compliance[2, 2] = beam.rotation(member, elastic)
    if member.kind == "rod":
        compliance[1, 1] = beam.sway(member, elastic)
        compliance[1, 2] = -member.length / 2 * beam.rotation(member, elastic)
        compliance[1, 0] = member.lever * compliance[1, 2]
    return compliance


def nominal_effects(part: Piece) -> dict[str, dict[str, float]]:
    """Return the effects that a part has by its drawing, in full strength."""
    effects = {name: {"share": 1.0} for name in statics.BY_DRAWING}
    radius = max((member.root_radius for member in part.linkage().of_kind("hinge")), default=0.0)
    return effects | ({"fillet": {"radius": radius}} if radius > 0 else {})
