"""From port compliance, section forces and modes to the quantities a designer asks for, each with its boundary."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexdesign.design import Design
from flexdesign.fem import resultants, stress
from flexdesign.fem.analysis import ModeRecord, Solution
from flexdesign.fem.domain import Domain
from flexdesign.fem.statics import PortCompliance
from flexdesign.materials import Material
from flexdesign.model import Member, Quantity, output_boundary
from flexdesign.stage_model import ActuatorData, AxisModel, ControllerTiming, StageModel
from flexdesign.stage_model import Mode as StageMode
from flexdesign.study import Study

#: Samples of the proposed controller for a period of the fastest mode.
SAMPLES_PER_PERIOD = 20
#: A damping ratio to begin with, where nothing is known.
PLACEHOLDER_DAMPING = 0.01
#: A mode with less of the response to the actuator than this stays out of the stage model.
LEAST_SHARE = 0.02


def of_solution(study: Study, solution: Solution) -> list[Quantity]:
    """Return every quantity that one mesh gives and whose limit for vanishing element size is sought."""
    c, actuator = solution.compliance, study.design.actuator
    found = [
        Quantity("K_in", c.input_stiffness, "N/m", "N/mm", "output free"),
        Quantity("lambda", c.amplification, "1", "", "output free"),
        Quantity("K_out", c.output_stiffness(0.0), "N/m", "N/mm", "input free"),
        Quantity("K_out", c.output_stiffness(math.inf), "N/m", "N/mm", "input held"),
    ]
    if study.output.load is not None:
        stiffness, ratio = c.loaded(study.output.load)
        boundary = output_boundary(study.output.load)
        found.append(Quantity("K_in", stiffness, "N/m", "N/mm", boundary))
        found.append(Quantity("lambda", ratio, "1", "", boundary))
    if actuator is not None:
        k, s = actuator.installed_stiffness, actuator.free_stroke
        found += [
            Quantity("K_out", c.output_stiffness(k), "N/m", "N/mm", "actuator installed"),
            Quantity("stroke", c.stroke(s, k), "m", "um", "output free"),
            Quantity("blocked_force", c.blocked_force(s, k), "N", "N", "output held"),
            Quantity("actuator_force", c.actuator_force(s, k), "N", "N", "full stroke, output free"),
        ]
        if actuator.preload > 0:
            found += _preloaded(c, actuator.preload, k)
    found += stresses(study, solution)
    if solution.modes:
        found += _coupling(c, study.output.actuator_offset)
        found += _frequencies(solution, actuator.installed_stiffness if actuator else 0.0)
    return found


def _preloaded(c: PortCompliance, preload: float, k: float) -> list[Quantity]:
    """Return what the preload does: it shifts the output at rest, and an output force of one sign uses it up.

    An output force P extends the inputs by C12 P / (1 + k C11), and the stack's compression falls by k times that.
    """
    lost = preload * (1 + k * c.c11) / (k * c.c12)
    return [
        Quantity("preload_shift", preload * c.c12, "m", "um", "output free"),
        Quantity("output_force_that_unloads_the_stack", lost, "N", "N", "no voltage"),
    ]


def _coupling(c: PortCompliance, offset: float) -> list[Quantity]:
    """Parasitic motion of the output per output travel: on axis, and with the actuator off axis by `offset`."""
    pieces = []
    travel = c.c12
    rows = np.flatnonzero(c.output)
    base = 6 * (int(rows[0]) // 6)
    lateral = [i for i in range(3) if c.output[base + i] == 0]
    for label, place in _actuator_places(offset):
        force = c.extension.copy()
        for port in range(len(force) // 6):
            force[6 * port + 3 : 6 * port + 6] = np.cross(place, force[6 * port : 6 * port + 3])
        motion = (c.matrix @ force)[base : base + 6]
        boundary = f"actuator {label}"
        for i in lateral:
            pieces.append(Quantity(f"coupling_{'xyz'[i]}", motion[i] / travel, "1", "%", boundary))
        tilt = float(np.linalg.norm(motion[3:])) / abs(travel)
        pieces.append(Quantity("tilt", tilt, "rad/m", "urad/um", boundary))
    return pieces


def _actuator_places(offset: float) -> list[tuple[str, np.ndarray]]:
    places = [("on axis", np.zeros(3))]
    if offset > 0:
        for axis in (1, 2):
            places.append((f"{offset * 1e3:g} mm off axis in {'xyz'[axis]}", offset * np.eye(3)[axis]))
    return places


def output_share(mode: ModeRecord, compliance: PortCompliance, actuator: float) -> float:
    """Return what part of the output's compliance, 1/K_out, one mode carries: 1 / (m omega^2), m its output mass."""
    stiffness = compliance.output_stiffness(actuator if mode.installed else 0.0)
    return stiffness / (mode.output_mass * (2 * math.pi * mode.frequency) ** 2)


def drive_share(mode: ModeRecord, compliance: PortCompliance, actuator: float) -> float:
    """Return what part of the static response to a voltage one mode carries: e y / (omega^2 Y).

    By mode superposition, e and y are extension of the inputs and motion of the output for unit modal mass. Y is the
    static output motion per blocked force of the actuator, its spring k (`actuator` [N/m], where the mode has it) in
    place: C12 / (1 + k C11). Over all modes the shares add up to 1; a mode that moves the output against Y has a
    negative one, and others then carry more than 1 together.
    """
    static = compliance.c12 / (1 + (actuator if mode.installed else 0.0) * compliance.c11)
    return mode.extension / (math.sqrt(mode.output_mass) * (2 * math.pi * mode.frequency) ** 2 * static)


def _frequencies(solution: Solution, actuator: float) -> list[Quantity]:
    found = []
    for installed, boundary in ((False, "input free"), (True, "actuator installed")):
        modes = [mode for mode in solution.modes if mode.installed == installed]
        if not modes:
            continue
        shares = [output_share(mode, solution.compliance, actuator) for mode in modes]
        main = int(np.argmax(shares))
        found += [
            Quantity("first_frequency", modes[0].frequency, "Hz", "Hz", boundary),
            Quantity("output_frequency", modes[main].frequency, "Hz", "Hz", boundary),
            Quantity("output_share", shares[main], "1", "%", boundary),
        ]
        if installed:
            shares = [drive_share(mode, solution.compliance, actuator) for mode in modes]
            main = int(np.argmax(shares))
            found += [
                Quantity("drive_frequency", modes[main].frequency, "Hz", "Hz", boundary),
                Quantity("drive_share", shares[main], "1", "%", boundary),
            ]
    return found


def compliance_shares(material: Material, body: Domain, solution: Solution) -> dict[str, dict[str, float]]:
    """Split the compliances that the stiffnesses are the inverse of over the members, by the stiffness's key.

    With the input held, a unit output force comes with the input force -C12 / C11 that holds it: the load case is
    the one less that multiple of the other.
    """
    images = {section.member.name: _images(section, body) for section in solution.input_sections}
    c = solution.compliance
    inputs, outputs = solution.input_sections, solution.output_sections
    held = [o.minus(c.c12 / c.c11, i) for o, i in zip(outputs, inputs, strict=True)]
    cases = {
        "K_in_output_free": (inputs, c.c11),
        "K_out_input_free": (outputs, c.c22),
        "K_out_input_held": (held, c.c22 - c.c12**2 / c.c11),
    }
    return {
        key: resultants.shares((sections, sections), total, material, images)
        for key, (sections, total) in cases.items()
    }


def _images(section: resultants.Section, body: Domain) -> int:
    """How many members of the whole part a member of the domain stands for: one more for each plane it lies off."""
    return int(np.prod([1 if abs(section.member.centre[plane.index]) < 1e-12 else 2 for plane in body.planes]))


def stage_model(
    design: Design,
    found: Mapping[str, Quantity],
    solution: Solution,
    effects: Mapping[str, Mapping[str, float]] | None = None,
) -> StageModel | None:
    """Return the stage model that the quantities, by key, and a solution with modes give; None without an actuator.

    What large displacements do comes as `effects`, with their values.

    The main mode is the one that carries most of the response to the actuator. The mass is lumped: with all of the
    stiffness it gives that mode its frequency. A second mode that carries a fair part of the response goes in beside
    it; what other modes carry follows with the main one, whose share is what is left.
    """
    actuator = design.actuator
    if actuator is None:
        return None
    stiffness, frequency = found["K_out_actuator_installed"], found["drive_frequency_actuator_installed"]
    stroke, k_in, ratio = found["stroke_output_free"], found["K_in_output_free"], found["lambda_output_free"]
    voltage = actuator.voltage_range
    share, modes = _main_and_further(solution, actuator.installed_stiffness)
    known = {"stiffness": stiffness, "gain": stroke, "input_stiffness": k_in, "amplification": ratio}
    relative = {name: (q.sigma or 0.0) / abs(q.value) for name, q in known.items()}
    relative["mass"] = math.hypot(relative["stiffness"], 2 * (frequency.sigma or 0.0) / frequency.value)
    axis = AxisModel(
        natural_frequency=frequency.value,
        damping_ratio=PLACEHOLDER_DAMPING,
        gain=stroke.value / (voltage[1] - voltage[0]) if voltage else math.nan,
        mass=stiffness.value / (2 * math.pi * frequency.value) ** 2,
        stiffness=stiffness.value,
        modes=modes,
        actuator=ActuatorData(
            free_stroke=actuator.free_stroke,
            voltage_range=voltage,
            stiffness=actuator.stiffness,
            preload=actuator.preload,
            contact_stiffness=actuator.contact_stiffness if math.isfinite(actuator.contact_stiffness) else None,
        ),
        input_stiffness=k_in.value,
        amplification=ratio.value,
        effects=dict(effects or {}),
        uncertainty={name: float(f"{value:.2g}") for name, value in relative.items()} | {"damping_ratio": 1.0},
        assumed=("damping_ratio", *(f"modes.{i}.damping_ratio" for i in range(1, len(modes) + 1))),
        sources=_sources(stroke, share, modes, voltage),
    )
    source = (
        "FEM of the design; uncertainties are those of the discretisation alone, half-widths taken as 1 sigma. The "
        f"controller's rate is a proposal, at least {SAMPLES_PER_PERIOD} samples for a period of the fastest mode"
    )
    fastest = max(frequency.value, *(mode.frequency for mode in modes), 0.0)
    timing = ControllerTiming(rate=1000.0 * math.ceil(SAMPLES_PER_PERIOD * fastest / 1000.0))
    return StageModel({"y": axis}, timing, title=design.title, source=source, name="stage_model")


def _main_and_further(solution: Solution, actuator: float) -> tuple[float, tuple[StageMode, ...]]:
    """Return the share of the main mode, and the next one if it counts: of the others the largest of either sign."""
    installed = [mode for mode in solution.modes if mode.installed]
    shares = [(drive_share(mode, solution.compliance, actuator), mode.frequency) for mode in installed]
    main = max(shares)
    others = sorted((each for each in shares if each != main), key=lambda each: abs(each[0]), reverse=True)
    further = (StageMode(f, PLACEHOLDER_DAMPING, share) for share, f in others[:1] if abs(share) > LEAST_SHARE)
    return main[0], tuple(further)


def _sources(
    stroke: Quantity, share: float, modes: Sequence[StageMode], voltage: tuple[float, float] | None
) -> dict[str, str]:
    """Return where the numbers of a stage model come from, and what they leave out."""
    left = 1 - share - sum(mode.share for mode in modes)
    sources = {
        "damping_ratio": "placeholder, typical of monolithic metal flexures: geometry does not tell; identify it",
        "mass": f"stiffness / (2 pi f)^2; the main mode itself carries {100 * share:.3g} % of the static response to "
        f"the actuator, and the {100 * left:.2g} % of modes that are not listed here go with it",
    }
    if modes:
        sources["modes.1"] = (
            "FEM on the finest mesh with modes, not extrapolated; the share is that of the static response to the "
            "actuator, its stiffness in place"
        )
    if voltage is None:
        sources["gain"] = (
            f"unknown: the free stroke moves the output by {stroke.shown()}, but the design does not say at which "
            "voltage; give actuator.voltage_range there, or the gain here"
        )
    return sources


def energy_shares(solution: Solution) -> dict[str, dict[str, float]]:
    """Return which part of the strain energy each region holds, for the load cases of `compliance_shares`.

    With the input held, a unit output force comes with the input force -C12 / C11.
    """
    c = solution.compliance
    cases = {
        "K_in_output_free": (1.0, 0.0),
        "K_out_input_free": (0.0, 1.0),
        "K_out_input_held": (-c.c12 / c.c11, 1.0),
    }
    shares = {}
    for key, (a, b) in cases.items():
        held = {region: a * a * u + 2 * a * b * v + b * b * w for region, (u, v, w) in solution.energies.items()}
        shares[key] = {region: energy / sum(held.values()) for region, energy in held.items()}
    return shares


def stated_force(study: Study, solution: Solution) -> tuple[float, str]:
    """Return the actuator force at which stress is stated [N], preload included, and how it comes about."""
    actuator, stroke, compliance = study.design.actuator, study.output.stroke, solution.compliance
    preload = actuator.preload if actuator else 0.0
    also = " and preload" if preload else ""
    if stroke is not None:
        return stroke / abs(compliance.c12) + preload, f"{stroke * 1e6:g} um at the output{also}"
    if actuator is not None:
        force = compliance.actuator_force(actuator.free_stroke, actuator.installed_stiffness)
        return force + preload, f"full voltage{also}"
    return 1.0, "1 N of actuator force"


def stresses(study: Study, solution: Solution) -> list[Quantity]:
    """Return the nominal stress of the hinges at the stated force, and how far it is from yield and fatigue."""
    force, boundary = stated_force(study, solution)
    nominal = max(section.nominal_stress for section in solution.input_sections if section.member.kind == "hinge")
    found = [Quantity("hinge_stress", force * nominal, "Pa", "MPa", boundary)]
    return found + _margins(study, solution, nominal, f"hinge stress, {boundary}")


def peak_stresses(study: Study, solutions: Sequence[Solution], sizes: Sequence[float]) -> list[Quantity]:
    """Return the peak stress at the hinges at the stated force, and what it leaves to yield and fatigue.

    Where a root is sharp there is no peak but a number that grows as the mesh is refined, and no margin can be had from
    it. Elsewhere the margins carry the peak's relative error. Of a crystal, which breaks before it yields, the largest
    tension is sought, too.

    Parameters
    ----------
    study
        What was asked.
    solutions, sizes
        Of meshes coarse to fine, with their element sizes at the roots [m].
    """
    force, boundary = stated_force(study, solutions[-1])
    hinges = [section.member for section in solutions[-1].input_sections if section.member.kind == "hinge"]
    sharp = any(stress.is_sharp(hinge) for hinge in hinges)
    unknowns = f"FEM, {len(sizes)} meshes to {solutions[-1].facts['unknowns']} unknowns"

    def peak(name: str, values: Sequence[float]) -> Quantity:
        found = stress.peak(values, sizes, sharp=sharp)
        if found.error is not None:
            source, sigma = f"{unknowns}, value of the finest", force * found.error
            return Quantity(name, force * found.value, "Pa", "MPa", boundary, source, sigma)
        seen = f"grows as h^{-found.exponent:.2f} here, in the end as h^{-stress.SINGULAR:.2f}"
        source = f"{unknowns}; singular: grows with refinement, use a fillet ({seen})"
        return Quantity(name, force * found.value, "Pa", "MPa", boundary, source)

    largest = peak("peak_stress", [hinge_peak(solution) for solution in solutions])
    peaks = [largest]
    if study.design.material.crystal is not None:
        peaks.append(peak("peak_tension", [hinge_peak(solution, solution.tension) for solution in solutions]))
    if largest.sigma is None:
        return peaks
    error = largest.sigma / largest.value
    margins = _margins(study, solutions[-1], largest.value / force, f"peak stress, {boundary}")
    return [*peaks, *(replace(m, sigma=m.value * error, source=largest.source) for m in margins)]


def hinge_peak(solution: Solution, field: np.ndarray | None = None) -> float:
    """Return the largest von Mises stress, or other field (n,), within one thickness of the hinges [Pa/N].

    Other edges of the solid and the rim of the held face have singularities of their own, which say nothing of the
    design.
    """
    hinges = [section.member for section in solution.input_sections if section.member.kind == "hinge"]
    near = np.any([_distance(solution.positions, hinge) <= hinge.thickness for hinge in hinges], axis=0)
    return float((solution.von_mises if field is None else field)[near].max())


def _margins(study: Study, solution: Solution, per_force: float, where: str) -> list[Quantity]:
    """Return what a stress per actuator force [Pa/N] leaves to yield and to fatigue, as far as data are known.

    In operation the actuator swings between no drive and the stated one, about a preload that stays: the amplitude is
    half the drive's stress, the mean is that and the preload's, taken as tension, as it is on one side of a bent leaf.
    """
    material = study.design.material
    force, _ = stated_force(study, solution)
    found = []
    if material.yield_strength is not None:
        found.append(Quantity("safety_against_yield", material.yield_strength / (force * per_force), "1", "", where))
    preload = study.design.actuator.preload if study.design.actuator else 0.0
    driven = study.design.actuator is not None or study.output.stroke is not None
    swing = (force - preload) / 2
    if driven and material.fatigue is not None:
        margin = material.fatigue_margin(swing * per_force, (preload + swing) * per_force)
        found.append(Quantity("safety_against_fatigue", margin or 0.0, "1", "", where))
    return found


def _distance(points: np.ndarray, member: Member) -> np.ndarray:
    """Return the distance of points (n, 3) from a member's axis, seen along the width."""
    start, axis = np.array(member.start)[:2], np.array(member.axis)[:2]
    along = np.clip((points[:, :2] - start) @ axis, 0.0, member.length)
    return np.asarray(np.linalg.norm(points[:, :2] - start - along[:, None] * axis, axis=1))
