"""The report: what was found, in words, tables and charts. Every number in it is computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexdesign.core.units import to_text
from flexdesign.dynamics.control import PID, Plant
from flexdesign.report.diagnosis import frequency_charts as charts
from flexdesign.report.document import Document, Figure, Section, Table
from studies.lin2019_gains import loops
from studies.lin2019_gains.findings import Candidate, Findings, fit_plant
from studies.lin2019_gains.printed import PRINTED, Axis, damping_bound, frequency_bound
from studies.lin2019_gains.words import axis_and_plant, hz, ms, n, settling

#: Averages of a frequency response, for the coherence it needs.
AVERAGES = 20


def document(findings: Sequence[Findings]) -> Document:
    """Return the report."""
    sections = [
        _model(findings),
        _rule(findings),
        _candidates(findings),
        _measurement(findings),
        loops.printed_gains(findings),
        loops.our_gains(findings),
        loops.by_experiment(findings),
        _conclusions(findings),
        _inputs(),
    ]
    return Document("Plants of the printed gains of Lin et al. (2019)", _summary(findings), sections)


def _summary(findings: Sequence[Findings]) -> list[str]:
    xy, z = findings
    return [
        f"Eq (31) of the paper prints a stage with damping ratio {xy.axis.model.damping_ratio:.3f}; eq (34) prints the "
        f"gains that Ziegler-Nichols tuning gave. On the printed stage the same rule gives Kp = {n(xy.recomputed.kp)} "
        f"in X/Y, not {n(xy.axis['kp'])}. The printed model is not the plant that was tuned.",
        f"In X/Y, whatever the loop delay, the printed gains belong to a lightly damped plant: damping ratio at most "
        f"{n(damping_bound(xy.axis), 2)}. Whether it carries another mass or stiffness than printed, or the "
        "loop a delay, the gains cannot say. The phase of a frequency response can.",
        f"On none of the plants found do the printed gains shorten the settling. Without delay it stays at "
        f"{ms(xy.candidates[0].alone.settling)} in X/Y and grows from {ms(z.candidates[0].alone.settling)} to "
        f"{ms(settling(z.candidates[0].printed))} in Z. Gains of ours take "
        f"{ms(settling(xy.candidates[0].ours))} and {ms(settling(z.candidates[0].ours))}.",
    ]


# --- (a) The printed model


def _model(findings: Sequence[Findings]) -> Section:
    axes = [found.axis for found in findings]
    lambdas = [list(axis.amplifications().values()) for axis in axes]
    rows = [
        ["natural frequency", *(hz(axis.model.natural_frequency) for axis in axes)],
        ["damping ratio", *(f"{axis.model.damping_ratio:.3f}" for axis in axes)],
        ["poles [1/s]", *(f"{-1 / axis['t1']:.1f}, {-1 / axis['t2']:.1f}" for axis in axes)],
        ["mass, K t1 t2 with the stiffness of Table 1", *(to_text(axis.mass, "g", si="kg") for axis in axes)],
    ]
    places = axes[0].amplifications()
    ratios = [[place, *(n(axis.amplifications()[place]) for axis in axes)] for place in places]
    text = [
        "Both poles of eq (31) are real. Such a stage creeps to its target and cannot swing beyond it.",
        "Part of the printed numbers closes. Eq (30) gives the static gain as k_in / (4 lambda k); with the "
        f"stiffness of Table 1 it is the gain of eq (31) if the amplification lambda is {lambdas[0][0]:.3f} in X/Y "
        f"and {lambdas[1][0]:.3f} in Z.",
        "The amplification itself does not close. Output over input motion has four values, depending on where one "
        "looks. The third takes the input of the coupling test for the motion of the actuator at 120 V, which the "
        "paper does not say.",
    ]
    tables = [Table(["eq (31)", "X/Y", "Z"], rows), Table(["amplification by", "X/Y", "Z"], ratios)]
    return Section("The printed model", text, tables)


# --- (b) Ziegler-Nichols on it


def _rule(findings: Sequence[Findings]) -> Section:
    xy, z = findings
    columns = ["gain"]
    for found in findings:
        columns += [f"{found.axis.name}, printed", f"{found.axis.name}, on eq (31)"]
    shown: list[tuple[str, Callable[[PID], str]]] = [
        ("Kp", lambda pid: n(pid.kp)),
        ("Ti", lambda pid: ms(pid.ti, 4)),
        ("Td", lambda pid: ms(pid.td, 4)),
        ("4 Td / Ti", lambda pid: f"{4 * pid.td / pid.ti:.3f}"),
    ]
    rows = [[name, *(of(pid) for f in findings for pid in (f.axis.pid, f.recomputed))] for name, of in shown]
    text = [
        f"The rule 0.6 Ku, Tu/2, Tu/8, applied to eq (31) behind a hold of {ms(xy.axis['period'], 1)}, gives a Kp "
        f"{n(xy.recomputed.kp / xy.axis['kp'], 3)} times the printed one in X/Y and "
        f"{n(z.recomputed.kp / z.axis['kp'], 3)} times in Z. The times differ by a factor of two. The printed gains do "
        "follow the rule, as 4 Td / Ti shows: they were found on another plant.",
        f"Nor would the rule have helped on eq (31). X/Y: {xy.recomputed_margins.says()} "
        f"Z: {z.recomputed_margins.says()}",
        f"Fig 13 says the same. The open loop overshoots by {to_text(xy.axis['overshoot'], 'um', 2, si='m')}, and a "
        f"plant of damping ratio {xy.axis.model.damping_ratio:.3f} cannot overshoot. The printed model fails.",
    ]
    return Section("Ziegler-Nichols on the printed model", text, [Table(columns, rows)])


# --- (c) The plants behind the gains


def _candidates(findings: Sequence[Findings]) -> Section:
    xy, z = findings
    rows = [_candidate_row(found, candidate) for found in findings for candidate in found.candidates]
    head = ["plant", "natural frequency", "damping ratio", "delay", "mass", "over printed", "printed gains"]
    caption = (
        "Plants of one mode that the printed gains belong to; ± is what the rounding of the printed gains leaves. "
        "Mass: stiffness of Table 1 over (2 pi f0)^2"
    )
    low, high = frequency_bound(xy.axis), max(p.natural_frequency for p in xy.credible)
    text = [
        "A Ziegler-Nichols tuning is two numbers written as three: the gain Ku at which the loop begins to oscillate, "
        "and the period Tu. They say that the sampled plant answers with -1/Ku at one frequency, which is two "
        "equations. A plant of one mode has three unknowns: natural frequency, damping ratio, delay of the loop. One "
        "of them must be assumed.",
        f"Light damping in X/Y is certain all the same. The loop begins to oscillate when its gain at rest is only "
        f"{n(xy.axis.loop_gain, 3)}: at the resonance the plant must answer about {n(1 / xy.axis.loop_gain, 2)} "
        f"times as strongly as at rest. For any delay that bounds the damping ratio by "
        f"{n(damping_bound(xy.axis), 3)} in X/Y. In Z the bound is {n(damping_bound(z.axis), 3)}: less "
        "light, but far from 1.",
        f"Added mass and loop delay are confounded. Stiffness over mass is in the natural frequency, and that "
        f"moves with the delay assumed. Z without delay carries {n(_mass_ratio(z, z.candidates[0]), 3)} times the "
        f"printed mass; Z with the printed mass has {ms(z.candidates[-1].plant.delay)} of delay.",
        f"X/Y at its printed {hz(xy.axis.model.natural_frequency)} has no solution. With so small a loop gain the "
        f"oscillation, at {hz(1 / xy.axis.target.period)}, lies at most {100 * _detuning(xy.axis):.1f} % above the "
        f"resonance, which therefore is at {hz(low)} or more, for any delay and damping. {_stiffer(xy)}",
        f"The paper's loop ran, and that bounds the delay: above {ms(xy.limit.delay)} in X/Y and "
        f"{ms(z.limit.delay)} in Z the printed gains are unstable on the plants they belong to. The remainder "
        f"reaches to {hz(high)} in X/Y. (A whole oscillation later, from about {ms(xy.axis.target.period, 2)} on, "
        "nearly the same plants come again; no loop of this rate is so late.)",
        _gain_in_doubt(xy),
    ]
    panels = [
        charts.Panel(
            "natural\nfrequency [Hz]", [_along(f, [p.natural_frequency for p in f.credible]) for f in findings]
        ),
        charts.Panel("damping ratio", [_along(f, [p.damping_ratio for p in f.credible]) for f in findings]),
        charts.Panel(
            "mass over\nprinted mass",
            [_along(f, [f.axis.mass_of(p) / f.axis.mass for p in f.credible]) for f in findings],
        ),
    ]
    drawing = charts.stack_panels(panels, "loop delay [ms]")
    figure = Figure("family.svg", drawing, "One row of gains, many plants; drawn where the printed gains are stable")
    return Section("Which plants the printed gains can belong to", text, [Table(head, rows, caption)], [figure])


def _candidate_row(found: Findings, candidate: Candidate) -> list[str]:
    plant, (frequency, damping) = candidate.plant, candidate.rounding
    return [
        axis_and_plant(found, candidate),
        f"{plant.natural_frequency:.2f} ± {frequency:.2f} Hz",
        f"{plant.damping_ratio:.5f} ± {damping:.5f}",
        ms(plant.delay),
        to_text(found.axis.mass_of(plant), "g", 3, si="kg"),
        f"{_mass_ratio(found, candidate):.2f}",
        "stable" if candidate.margins.stable else "unstable",
    ]


def _along(found: Findings, values: Sequence[float]) -> charts.Curve:
    return charts.Curve(found.axis.name, [1e3 * p.delay for p in found.credible], values)


def _stiffer(found: Findings) -> str:
    """Return what the other stiffness of Table 1 says, at the printed mass."""
    axis = found.axis
    frequency = axis.model.natural_frequency * math.sqrt(axis["fea_stiffness"] / axis["stiffness"])
    frequencies = [plant.natural_frequency for plant in found.family]
    delay, damping = (
        float(np.interp(frequency, frequencies, [getattr(p, name) for p in found.family]))
        for name in ("delay", "damping_ratio")
    )
    return (
        f"Table 1's stiffness by FEA would do: with the printed mass it gives {hz(frequency)}, which belongs to "
        f"{ms(delay, 2)} of delay and a damping ratio of {n(damping, 2)}. Stiffness is one more thing that the "
        "gains cannot distinguish from mass and delay."
    )


def _gain_in_doubt(found: Findings) -> str:
    axis, near = found.axis, found.candidates[0].plant
    ratios = list(axis.amplifications().values())
    plants = {}
    for ratio in (min(ratios), max(ratios)):
        moved = fit_plant(axis, axis.target, 0.0, _with_gain(near, ratio))
        plants[ratio] = f"{n(moved.damping_ratio, 3)}" if moved else "none"
    texts = " and ".join(f"{damping} with {n(ratio, 3)}" for ratio, damping in plants.items())
    return (
        f"All this takes the gain of eq (31), {axis['gain']}, at its word. The damping goes with it: without delay "
        f"the damping ratio in {axis.name} is {texts}: the smallest and the largest amplification above.."
    )


def _with_gain(plant: Plant, gain: float) -> Plant:
    return Plant(gain, plant.natural_frequency, plant.damping_ratio, plant.delay)


# --- (d) The measurement


class _PhaseSeparation(NamedTuple):
    """How the phase distinguishes the candidates of an axis; angles in deg, frequencies in Hz."""

    oscillation: float
    spread_at_oscillation: float
    nearest: float
    per_tenth: float


def _proposal(found: Findings) -> _PhaseSeparation:
    at = 1 / found.axis.target.period
    phases = [float(c.plant.phase(at)) for c in found.stable]
    widest = sorted(found.comparison.phase[:, int(np.argmax(np.ptp(found.comparison.phase, axis=0)))])
    along = np.array([float(plant.phase(at / 2)) for plant in found.credible[:-1]])
    return _PhaseSeparation(
        at, max(phases) - min(phases), float(np.min(np.diff(widest))), float(np.min(np.abs(np.diff(along))))
    )


def _coherence(deviation: float) -> float:
    """Return the coherence at which the phase has so large a standard deviation [deg] after `AVERAGES` averages."""
    return 1 / (1 + 2 * AVERAGES * math.radians(deviation) ** 2)


def _measurement(findings: Sequence[Findings]) -> Section:
    texts = [_proposal(found) for found in findings]
    rows, figures = [], []
    for found, one in zip(findings, texts, strict=True):
        comparison = found.comparison
        rows.append(
            [
                found.axis.name,
                f"{n(comparison.largest_phase_difference, 3)} deg at {n(comparison.best_frequency, 3)} Hz",
                f"{n(one.nearest, 2)} deg",
                f"{n(one.spread_at_oscillation, 2)} deg at {n(one.oscillation, 4)} Hz",
                f"{n(one.per_tenth, 2)} deg at {n(one.oscillation / 2, 3)} Hz",
                f"{_coherence(one.per_tenth):.2f}",
            ]
        )
        figures.append(_bode(found))
    head = ["axis", "farthest apart", "nearest two there", "closest", "a tenth of a sample", "coherence for that"]
    caption = "Phase of the candidates on which the printed gains are stable, up to where one answers less than at rest"
    smallest = min(one.per_tenth for one in texts)
    period = findings[0].axis["period"]
    text = [
        "The candidates agree where the gains were found: at the frequency of oscillation they have nearly one "
        "magnitude and one phase, by construction. A measurement there distinguishes none. Above and below they part.",
        f"Delay shows where a light resonance turns no phase. At half the frequency of oscillation a tenth of a sample "
        f"({ms(period / 10, 1)}) more delay, the rest of the plant going along, turns the phase by "
        f"{n(smallest, 2)} deg or more. A few degrees decide.",
        f"So large a standard deviation asks for little: after {AVERAGES} averages a coherence of "
        f"{max(_coherence(one.per_tenth) for one in texts):.2f} is enough "
        "(sigma^2 = (1 - coherence) / (2 n coherence), coherence as squared; Bendat and Piersol, Random Data, 4th ed. "
        "2010, chapter 9). What counts is the timing.",
        "Record the command that the controller computes and the reading that it uses. An instrument at the actuator's "
        "voltage sees the stage alone: it gives the mass, and leaves the delay of the loop out.",
    ]
    return Section("The discriminating measurement", text, [Table(head, rows, caption)], figures)


def _bode(found: Findings) -> Figure:
    grid = np.arange(10.0, 1.5 * found.comparison.frequencies[-1], 0.25)
    plants = [candidate.plant for candidate in found.stable]
    names = [candidate.label for candidate in found.stable]
    marks = [
        charts.Mark("oscillation", 1 / found.axis.target.period),
        charts.Mark("farthest apart", found.comparison.best_frequency),
    ]
    magnitude = [np.abs(plant.response(grid)).tolist() for plant in plants]
    drawing = charts.bode(names, grid.tolist(), magnitude, [plant.phase(grid).tolist() for plant in plants], marks)
    caption = f"{found.axis.name}: frequency response from command to reading, without the hold, of the candidates"
    return Figure(f"bode_{found.axis.column}.svg", drawing, caption)


# --- The end


def _conclusions(findings: Sequence[Findings]) -> Section:
    xy, z = findings
    lightest, heaviest = (of(p.damping_ratio for p in xy.credible) for of in (min, max))
    certain = (
        f"eqs (31) and (34) are not of one plant. X/Y is lightly damped, {n(lightest, 2)} to {n(heaviest, 2)} over "
        f"all delays at which the paper's loop could run, and its resonance lies at "
        f"{hz(frequency_bound(xy.axis))} or above, not at the printed {hz(xy.axis.model.natural_frequency)}. "
        "The printed gains do not halve the settling time."
    )
    light, heavy = (of(z.axis.mass_of(p) / z.axis.mass for p in z.credible) for of in (min, max))
    confusable = (
        f"mass, stiffness and loop delay. In Z anything from {n(light, 2)} to {n(heavy, 2)} times the printed mass "
        f"fits, with {ms(z.limit.delay)} of delay down to none."
    )
    half = [f"{n(0.5 / f.axis.target.period, 2)} Hz ({f.axis.name})" for f in findings]
    tell = (
        f"the phase from command to reading, to a few degrees, away from the frequency of oscillation: near "
        f"{' and '.join(half)}, where it shows mostly the delay, and across the resonance, where it shows stiffness "
        "over mass. A known payload then distinguishes them."
    )
    texts = [f"Certain: {certain}", f"Confusable: {confusable}", f"What would distinguish them: {tell}"]
    texts.append(
        "All of it presumes what the gains cannot check: one mode, the rule applied to the sampled loop, the printed "
        "static gain."
    )
    return Section("What is certain, what is confusable, what would distinguish them", texts)


def _inputs() -> Section:
    rows = [[s.meaning, s.xy, s.z or "–", s.place] for s in PRINTED.values()]
    source = (
        "Lin, Yu, Wu, Shen: Decoupling and control of micromotion stage based on hysteresis of piezoelectric actuation"
    )
    text = [f"All other numbers are computed from these ({source}, Microsystem Technologies, 2019)."]
    return Section(
        "Printed numbers and their places", text, [Table(["number", "X/Y", "Z", "place"], rows)], folded=True
    )


def _names(candidate: Candidate) -> str:
    return candidate.label


def _mass_ratio(found: Findings, candidate: Candidate) -> float:
    return found.axis.mass_of(candidate.plant) / found.axis.mass


def _detuning(axis: Axis) -> float:
    return math.sqrt(1 + axis.loop_gain) - 1
