"""The force method against the solution for all forces and motions at once (`frame.solve`), and its refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from flexdesign.analytic import frame, stage_compliance, static_model
from flexdesign.analytic.compliance import ComplianceModel
from flexdesign.analytic.force_method import ForceMethod
from flexdesign.core.model import Linkage, Member
from flexdesign.design import design
from tests.conftest import FOUR_SIDED

BRIDGE = design.read(design.find("bridge_amplifier"))
SIZES = {"thickness": 1e-3, "width": 1e-2}


def bar(name: str, nodes: tuple[str, str], start: tuple[float, float], end: tuple[float, float]) -> Member:
    return Member(name, "arm", nodes, (*start, 0.0), (*end, 0.0), **SIZES)


#: Two bars side by side from the ground to a body: three self-stresses.
FORK = Linkage(
    {"ground": (0.0, 0.0, 0.0), "body": (0.1, 0.02, 0.0), "tip": (0.15, 0.05, 0.0)},
    (
        bar("lower", ("ground", "body"), (0.0, 0.0), (0.09, 0.01)),
        bar("upper", ("ground", "body"), (0.01, 0.05), (0.1, 0.04)),
        bar("last", ("body", "tip"), (0.1, 0.02), (0.15, 0.05)),
    ),
)
LOADS = [{"body": np.array([1.0, 0.3, 0.0])}, {"tip": np.array([0.0, 1.0, 0.01]), "body": np.array([-1.0, 0.0, 0.0])}]


@pytest.mark.parametrize("out_of_plane", [False, True])
@pytest.mark.parametrize("is_symmetric", [False, True])
def test_it_is_the_solution_for_forces_and_motions(out_of_plane: bool, is_symmetric: bool) -> None:
    """Random compliances, of members that give way by as many powers of ten as leaves do."""
    rng = np.random.default_rng(3)
    method = ForceMethod(FORK, ["ground"], LOADS, out_of_plane=out_of_plane)
    for _ in range(5):
        roots = rng.standard_normal((3, 3, 3)) * np.array([1e-4, 1e-3, 1.0]) * 10.0 ** rng.uniform(-2, 0, (3, 1, 1))
        compliances = np.swapaxes(roots, 1, 2) @ roots
        if not is_symmetric:
            compliances[:, 1, 2] *= 1.5
        of = {member.name: c for member, c in zip(FORK.members, compliances, strict=True)}
        answers = frame.solve(FORK, of, ["ground"], LOADS, out_of_plane=out_of_plane)
        expected = [[sum(load[n] @ answer.motions[n] for n in load) for answer in answers] for load in LOADS]
        assert method.compliance(compliances) == pytest.approx(np.array(expected), rel=1e-9)


def test_what_is_held_twice_without_giving_way_is_refused() -> None:
    with pytest.raises(frame.Mechanism, match="twice"):
        ForceMethod(FORK, ["ground"], LOADS).compliance(np.array([np.zeros((3, 3)), np.diag([0.0, 0.0, 1.0])] * 2)[:3])


def test_what_moves_freely_is_refused() -> None:
    loose = replace(FORK, members=FORK.members[2:])
    with pytest.raises(frame.Mechanism, match="free to move"):
        ForceMethod(loose, ["ground"], LOADS)


def test_a_chain_without_loops_has_no_self_stress() -> None:
    """A cantilever: l^3 / 3EI."""
    linkage = Linkage(
        {"ground": (0.0, 0.0, 0.0), "tip": (0.1, 0.0, 0.0)}, (bar("beam", ("ground", "tip"), (0, 0), (0.1, 0)),)
    )
    bending = 70e9 * 1e-2 * 1e-9 / 12
    beam = np.diag([0.0, 0.1**3 / (12 * bending), 0.1 / bending])
    (found,) = ForceMethod(linkage, ["ground"], [{"tip": np.array([0.0, 1.0, 0.0])}]).compliance(beam[None])
    assert found == pytest.approx([0.1**3 / (3 * bending)], rel=1e-12)


@pytest.mark.parametrize("left", [1.0, 1e-2, 1e-4])
@pytest.mark.parametrize("bare", [False, True])
def test_a_hinge_that_is_nearly_cut_through_costs_no_accuracy(left: float, bare: bool) -> None:
    """It gives way 10^12 times as much as its twins; `frame.solve` keeps twelve digits, by arithmetic of sixty."""
    effects = static_model.of_design(BRIDGE, bare=bare).effects
    thinner = BRIDGE.dimensions["hinge_thickness"] * (1 - left)
    model = ComplianceModel.of_part(BRIDGE.part(), BRIDGE.material).having(
        {**effects, "one_member": {"thinner": thinner, "number": 2.0}}
    )
    of = {member.name: model.member_compliance(member) for member in model.members}
    linkage = replace(model.linkage, members=model.members)
    grounds = [model.linkage.ports[port.name] for port in model.ports if port.role == "ground"]
    loads = [model._pull(role) for role in ("input", "output")]
    answers = frame.solve(linkage, of, grounds, loads)
    expected = [[sum(load[n] @ answer.motions[n] for n in load) for answer in answers] for load in loads]
    assert model.port_compliance == pytest.approx(np.array(expected), rel=1e-9)


# --- what is kept from one set of effects to the next -------------------------------------------------------------


def test_a_model_that_had_other_effects_is_as_a_new_one() -> None:
    """Whatever was asked before: each value of each effect has its own answer."""
    drawn = static_model.of_design(BRIDGE).effects
    worn = ComplianceModel.of_part(BRIDGE.part(), BRIDGE.material, 5e7)
    for effects in (
        drawn,
        {**drawn, "over_cut": {"thinner": 5e-6}},
        {**drawn, "over_cut": {"thinner": 6e-6}},
        {**drawn, "modulus": {"excess": 0.1}},
        {**drawn, "geometric_stiffening": {"force": 20.0}},
        {**drawn, "geometric_stiffening": {"force": 30.0}},
        {**drawn, "output_load": {"stiffness": 1e3}},
        {**drawn, "base_compliance": {"compliance": 1e-6}},
        {},
        drawn,
    ):
        worn = worn.having(effects)
        new = ComplianceModel.of_part(BRIDGE.part(), BRIDGE.material, 5e7).having(effects)
        assert worn.quantities() == new.quantities()


def test_a_stage_that_had_other_effects_is_as_a_new_one() -> None:
    stage = design.read(FOUR_SIDED)
    assembly = stage.stage().assembly()
    drawn = stage_compliance.nominal_effects(assembly)

    def built() -> stage_compliance.StageCompliance:
        return stage_compliance.StageCompliance.of_assembly(assembly, stage.material, 5e7)

    worn = built()
    tied = {name: values for name, values in drawn.items() if name != "free_bodies"}
    for effects in (
        drawn,
        tied,
        {**drawn, "modulus": {"excess": 0.1}},
        {**drawn, "output_load": {"stiffness": 1e3}},
        {},
    ):
        worn = worn.having(effects)
        assert worn.quantities() == built().having(effects).quantities()
    assert math.isfinite(worn.input_stiffness("x"))
