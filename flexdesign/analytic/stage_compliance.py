"""The compliance model of a whole stage: its parts' compliance models between rigid bodies, effect by effect.

It is put together as the condensed stage of finite elements is (`fem.superelements`), each part giving way between its
two bonded ports by the 7 by 7 compliance of its own frame (`ComplianceModel.compliance_between`): with f the six forces
that part e passes on, a its actuator's force, p its parting and x its actuator's extension,

    p = C f + c a,     x = c' f + d a,     p = B u,     sum_e B^T f = F,

u the motions of the bodies. Without effects parts do not give way but where their hinges rotate and their rods bend, C
is singular, and what it leaves rigid ties the bodies: N^T B u = 0, N the directions in which nothing parts. With Z a
basis of the motions that these ties leave, u = Z y and

    Z^T K Z y = Z^T (F + sum_e B^T C^+ c a),     K = sum_e B^T C^+ B.

Two effects are of stages alone. Without ``free_bodies`` the table, and what carries amplifiers, do not turn, and where
two amplifiers are in series each makes as much of the travel as the other; without ``out_of_plane`` parts do not leave
their planes. Without any effect the stage is the paper's: springs of amplifiers and hinges side by side, each amplifier
pushing against what the others hold (`flexdesign.analytic.branched_stage`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg

from flexdesign.analytic import compliance, frame
from flexdesign.analytic.compliance import SOURCE, ComplianceModel, Effects
from flexdesign.analytic.stage_joints import ARM, Joint, Joints, ends
from flexdesign.core.arrays import Array
from flexdesign.core.memo import Memo
from flexdesign.core.model import Quantity, by_key
from flexdesign.design.assembly import Assembly, Element
from flexdesign.design.materials import Material
from flexdesign.effects import statics

#: A compliance below this fraction of the largest one is rigid.
RIGID = 1e-11
#: What of a tie is so small follows from other ties.
DOUBLE = 1e-9


@dataclass(frozen=True, eq=False)
class StageCompliance:
    """A stage with effects.

    Parameters
    ----------
    assembly
        What is bonded to what.
    models
        The compliance model of each kind of part, without effects, by the element's name.
    actuator_stiffness
        Of each actuator with its seats [N/m]; None without actuators.
    effects
        Values of their parameters, SI, by effect and parameter; of all parts alike.

    Raises
    ------
    frame.Mechanism
        When asked for a compliance, if something can move freely.
    """

    assembly: Assembly
    models: Mapping[str, ComplianceModel]
    actuator_stiffness: float | None = None
    effects: Effects = field(default_factory=dict)

    @classmethod
    def of_assembly(
        cls, assembly: Assembly, material: Material, actuator_stiffness: float | None = None
    ) -> StageCompliance:
        """Return the model of a stage without effects.

        Raises
        ------
        frame.Mechanism
            If a part is not bonded at exactly two of its ports.
        """
        models: dict[str, ComplianceModel] = {}
        for piece, elements in assembly.kinds():
            model = ComplianceModel.of_part(piece, material)
            for element in elements:
                if len(element.bonds) != 2:
                    raise frame.Mechanism(f"{element.name} is bonded at {len(element.bonds)} ports, and not at two")
                models[element.name] = model
        return cls(assembly, models, actuator_stiffness)

    def having(self, effects: Effects) -> StageCompliance:
        """Return the model with these effects in the place of its own."""
        other = replace(self, effects=effects)
        vars(other)["_memo"] = self._memo
        return other

    @cached_property
    def _memo(self) -> Memo:
        """What was found of assembly and models, with whatever effects."""
        return Memo()

    @cached_property
    def _any_part(self) -> ComplianceModel:
        return next(iter(self.models.values())).having(self.effects)

    @cached_property
    def base(self) -> Mapping[str, float]:
        """Springs in addition to the members, as changed by the effects."""
        return self._any_part.base

    # --- between the bodies -----------------------------------------------------------------------------------

    @property
    def _places(self) -> dict[str, list[int]]:
        """The unknowns of each body that moves: three motions of its centre and, if it turns, three rotations."""
        return self._joints.places

    @property
    def _size(self) -> int:
        return self._joints.size

    @cached_property
    def _joints(self) -> Joints:
        """Where each part is, between which bodies."""
        turns = bool(self.base["free_bodies"])
        return self._memo.once(("joints", turns), lambda: Joints.of(self.assembly, turns=turns))

    @cached_property
    def _drivers(self) -> tuple[str, ...]:
        """Names of the elements with an actuator."""
        return self.assembly.driven

    @cached_property
    def _elements(self) -> list[_Built]:
        """Every part at its place."""
        found_once: dict[int, tuple[Array, _Split]] = {}
        built = []
        for joint in self._joints.each:
            model = self.models[joint.element.name]
            if id(model) not in found_once:
                found_once[id(model)] = _condense(model.having(self.effects), joint.element)
            built.append(_Built(joint, *found_once[id(model)]))
        return built

    @cached_property
    def free(self) -> Array:
        """Compliance between all actuators, then the table's three motions, inputs free [m/N], (e + 3, e + 3)."""
        return self._memo.once(("free", self._any_part.state, self.base["free_bodies"]), self._free)

    def _free(self) -> Array:
        """Return the same, solved."""
        driven = [built for built in self._elements if built.joint.is_driven]
        count, table = len(driven), self._joints.table
        loads = np.zeros((self._size, count + 3))
        loads[:, count:] = table.T
        for column, built in enumerate(driven):
            loads[built.places, column] = built.parting.T @ built.split.stiffness @ built.whole[:6, 6]
        stiffness = self._joints.assemble([built.split.stiffness for built in self._elements])
        left = self._free_motions()
        if left is None:
            displacements = _solve(stiffness, loads)
        else:
            displacements = left @ _solve(left.T @ stiffness @ left, left.T @ loads)
        found = np.zeros((count + 3, count + 3))
        found[count:] = table @ displacements
        for row, built in enumerate(driven):
            parted = built.parting @ displacements[built.places]
            parted[:, row] -= built.whole[:6, 6]
            found[row] = built.whole[6, :6] @ built.split.stiffness @ parted
            found[row, row] += built.whole[6, 6]
        return found

    def _free_motions(self) -> Array | None:
        """Return Z, a basis of the motions that rigid parts leave, shape (size, m); None if nothing is tied."""
        ties = [(built.places, built.split.rigid.T @ built.parting) for built in self._elements]
        whole = np.zeros((sum(len(tie) for _, tie in ties), self._size))
        row = 0
        for places, tie in ties:
            whole[row : row + len(tie), places] = tie
            row += len(tie)
        whole = np.vstack([whole, *self._halves()])
        if not len(whole):
            return None
        q, r, _ = scipy.linalg.qr(whole.T, pivoting=True)
        sizes = np.abs(np.diag(r))
        return np.asarray(q[:, int((sizes > DOUBLE * sizes[0]).sum()) :])

    def _halves(self) -> list[Array]:
        """Return what ties amplifiers in series, the output of one on the ground of the other: equal travel."""
        driven = [joint for joint in self._joints.each if joint.is_driven]
        ties = []
        for one, other in itertools.permutations([] if self.base["free_bodies"] else driven, 2):
            if one.bodies[1] == other.bodies[0]:
                tie = np.zeros(self._size)
                tie[one.places] += one.outwards @ one.parting[:3]
                along = (one.element.placement.matrix @ one.outwards) @ other.element.placement.matrix
                tie[other.places] -= along @ other.parting[:3]
                ties.append(tie)
        return ties

    # --- quantities -------------------------------------------------------------------------------------------

    def with_input_springs(self, stiffness: float) -> Array:
        """Return that compliance with a spring [N/m] between the inputs of every actuated part; infinite holds them."""
        hold = stiffness + self.base["input_restraint"] if stiffness == 0 else stiffness
        if hold == 0:
            return self.free
        count = len(self._drivers)
        series = 1 / hold + compliance.seats(self.base, stiffness)
        gap = self.free[:count, :count] + np.eye(count) * series
        return np.asarray(self.free - self.free[:, :count] @ np.linalg.solve(gap, self.free[:count]))

    def input_stiffness(self, axis: str) -> float:
        """K_in of one actuator as all of an axis push or draw at once, the table free [N/m]."""
        return float(np.abs(self._signs(axis)).sum()) / self._drive(axis)[0]

    def amplification(self, axis: str) -> float:
        """Travel of the table along an axis over the extension of one of its actuators."""
        extension, travel = self._drive(axis)
        return float(np.abs(self._signs(axis)).sum()) * travel / extension

    def output_stiffness(self, axis: str, input_stiffness: float = 0.0) -> float:
        """K_out along an axis with springs between all inputs [N/m]: 0 leaves them free, infinite holds them."""
        along = self._along(axis)
        free = float(along @ self.free @ along)
        given = float(along @ self.with_input_springs(input_stiffness) @ along) + self.base["base_compliance"]
        return 1 / given if given > 1e-12 * free else math.inf

    def stroke(self, axis: str, free_stroke: float) -> float:
        """Travel of a free table [m] as all actuators of an axis extend by their free stroke [m], the others in place.

        Each pushes with its stiffness times its free stroke, and its stiffness stands between the inputs.
        """
        stiffness = self.actuator_stiffness or 0.0
        return float(
            self._along(axis) @ self.with_input_springs(stiffness) @ (stiffness * free_stroke * self._signs(axis))
        )

    def _drive(self, axis: str) -> tuple[float, float]:
        """Return extensions, added up, and travel per force of each actuator, against what loads the table."""
        signs, along, load = self._signs(axis), self._along(axis), self.base["output_load"]
        c11, c12 = signs @ self.free @ signs, signs @ self.free @ along
        c21, c22 = along @ self.free @ signs, along @ self.free @ along + self.base["base_compliance"]
        per_travel = load / (1 + load * c22)
        return float(c11 - c12 * c21 * per_travel), float(c21 - c22 * c21 * per_travel)

    def _signs(self, axis: str) -> Array:
        drives = self.assembly.axes[axis].drives
        return np.array([*(drives.get(name, 0.0) for name in self._drivers), 0.0, 0.0, 0.0])

    def _along(self, axis: str) -> Array:
        return np.array([*np.zeros(len(self._drivers)), *self.assembly.axes[axis].direction])

    def quantities(self) -> dict[str, Quantity]:
        """Return stiffnesses and amplifications as FEM of a stage states them, by `Quantity.key`, infinite ones not."""
        holds = {"inputs free": 0.0, "inputs held": math.inf}
        if self.actuator_stiffness is not None:
            holds["actuators installed"] = self.actuator_stiffness
        found = []
        for axis in self.assembly.axes:
            table_free = f"{axis}, table free"
            found.append(Quantity("K_in", self.input_stiffness(axis), "N/m", "N/mm", table_free, SOURCE))
            found.append(Quantity("lambda", self.amplification(axis), "1", "", table_free, SOURCE))
            for boundary, stiffness in holds.items():
                value = self.output_stiffness(axis, stiffness)
                if math.isfinite(value):
                    found.append(Quantity("K_out", value, "N/m", "N/mm", f"{axis}, {boundary}", SOURCE))
        return by_key(found)


def nominal_effects(assembly: Assembly) -> dict[str, dict[str, float]]:
    """Return the effects that a stage has by its drawing, in full strength."""
    effects: dict[str, dict[str, float]] = {}
    for piece, _ in assembly.kinds():
        for name, values in compliance.nominal_effects(piece).items():
            effects[name] = {key: max(value, effects.get(name, {}).get(key, 0.0)) for key, value in values.items()}
    return effects | {name: {"share": 1.0} for name in statics.OF_STAGES}


@dataclass(frozen=True, eq=False)
class _Split:
    """What gives way in a compliance, inverted, C^+, (6, 6); and the directions in which nothing parts, (6, k)."""

    stiffness: Array
    rigid: Array


@dataclass(frozen=True, eq=False)
class _Built:
    """A part at its place, its compliance 7 by 7, and that between its ports split."""

    joint: Joint
    whole: Array
    split: _Split

    @property
    def places(self) -> list[int]:
        """The unknowns it is of."""
        return self.joint.places

    @property
    def parting(self) -> Array:
        """How it parts by them, (6, k)."""
        return self.joint.parting


def _condense(model: ComplianceModel, element: Element) -> tuple[Array, _Split]:
    """Return a part's compliance between its ports, in units of `ARM`, and split.

    Raises
    ------
    frame.Mechanism
        If its actuator moves what does not give way.
    """
    scale = np.array([1.0, 1.0, 1.0, ARM, ARM, ARM, 1.0])
    whole = scale[:, None] * model.compliance_between(*ends(element, model.ports)) * scale
    left, sizes, right = np.linalg.svd(whole[:6, :6])
    gives = sizes > RIGID * sizes[0]
    rigid = left[:, ~gives]
    if np.abs(rigid.T @ whole[:6, 6]).max(initial=0.0) > 1e-6 * np.abs(whole[:6, 6]).max(initial=0.0):
        raise frame.Mechanism(f"the actuator of {element.name} moves an output that does not give way")
    stiffness = (right[gives].T / sizes[gives]) @ left[:, gives].T
    return whole, _Split(stiffness, rigid)


def _solve(stiffness: Array, loads: Array) -> Array:
    """Return the motions under loads."""
    try:
        found = np.linalg.solve(stiffness, loads)
    except np.linalg.LinAlgError as error:
        raise frame.Mechanism("the parts leave something of the stage free to move") from error
    if not np.isfinite(found).all():
        raise frame.Mechanism("the parts leave something of the stage free to move")
    return np.asarray(found)
