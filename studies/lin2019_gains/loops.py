"""The report's sections on closed loops: the printed gains, ours, and the rule by experiment."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

from flexdesign.core.units import to_text
from flexdesign.dynamics.control import PID, Plant, open_loop, rule, ultimate
from flexdesign.dynamics.control.sampled_loop import matrices
from flexdesign.report.diagnosis import frequency_charts as charts
from flexdesign.report.document import Figure, Section, Table
from studies.lin2019_gains.findings import BAND, Candidate, Findings, Step, damping_for, settling_on
from studies.lin2019_gains.words import axis_and_plant, hz, ms, n, settling

# --- (e) What the printed gains do


def printed_gains(findings: Sequence[Findings]) -> Section:
    xy, z = findings
    rows = []
    for found in findings:
        for c in found.candidates:
            printed = [ms(settling(c.printed)), _change_text(c, c.printed)] if c.printed else ["unstable", "–"]
            ours = [ms(settling(c.ours)), _change_text(c, c.ours)] if c.ours else ["–", "–"]
            rows.append([axis_and_plant(found, c), ms(c.alone.settling), *printed, *ours, ms(_worst(c))])
    head = ["plant", "open loop", "printed", "change", "ours", "change", "ours, ±3 %"]
    caption = (
        f"Settling to {100 * BAND:g} %; the last column with the natural frequency off by 3 % either way, at worst"
    )
    swings = []
    for found in findings:
        for c in found.stable:
            shares = [100 * step.overshoot for step in (c.alone, c.printed, c.ours) if step]
            peaks = (c.margins.ms, c.tuning.margins.ms if c.tuning else math.nan)
            overshoot = [f"{share:.1f} %" for share in shares]
            phase = [f"{n(c.margins.phase_margin, 3)} deg", f"{n(c.margins.gain_margin, 3)}"]
            swings.append([axis_and_plant(found, c), *overshoot, *phase, *(n(peak, 3) for peak in peaks)])
    more = ["plant", "open loop", "printed", "ours", "phase margin", "gain margin", "Ms", "Ms, ours"]
    first, delayed = xy.stable[:2]
    quoted = damping_for(xy.axis["settling"], first.plant.natural_frequency)
    slow = rule(ultimate(_with_damping(first.plant, quoted).discretise(xy.axis["period"])))
    text = [
        f"The paper says that PID shortens the settling by more than {100 * xy.axis['shorter']:g} %. Its gains do so "
        f"on none of these plants. X/Y without delay takes {ms(first.alone.settling)} before and "
        f"{ms(settling(first.printed))} after, Z {ms(z.candidates[0].alone.settling)} before and "
        f"{ms(settling(z.candidates[0].printed))} after.",
        f"They take damping away instead of adding any: {_damping(first)} in X/Y, {_damping(z.candidates[0])} in Z. "
        "The overshoot goes because the integral part carries the motion to its target slowly, in X/Y with a time "
        f"constant of {ms(_creep(xy, first))}. What the command hides from the resonance, a disturbance does not: it "
        "rings longer than without control.",
        f"With delay in the loop the phase margin deceives: {n(delayed.margins.phase_margin, 3)} deg for X/Y, "
        f"{delayed.label}, because the loop gain stays just below 1 at the resonance. The largest sensitivity Ms, "
        f"{n(delayed.margins.ms, 3)}, shows it.",
        f"Fig 13 and eq (34) disagree as well. Settling in {to_text(xy.axis['settling'], 's', 2)} means a damping "
        f"ratio of {n(quoted, 2)} at {hz(first.plant.natural_frequency)}; eq (34) asks for "
        f"{n(first.plant.damping_ratio, 3)}. With {n(quoted, 2)} the rule would have given "
        f"Kp = {n(slow.kp)}, not {n(xy.axis['kp'])}.",
        f"An overshoot of {100 * first.alone.overshoot:.0f} % makes Fig 13 a step of "
        f"{to_text(xy.axis['overshoot'] / first.alone.overshoot, 'um', 2, si='m')}; its height is not in the text.",
        "Gains of ours (smallest worst-case ITAE of a reference step under a limit on the sensitivity, natural "
        f"frequency off by 3 % either way) keep the claim {_claim_text(findings, xy.axis['shorter'])}.",
    ]
    tables = [
        Table(head, rows, caption),
        Table(more, swings, "Overshoot, and margins of the loop with the printed gains"),
    ]
    ends = [0.28, 0.1]
    figures = [_step_figure(found, end) for found, end in zip(findings, ends, strict=True)]
    return Section("What the printed gains do", text, tables, figures)


def _claim_text(findings: Sequence[Findings], share: float) -> str:
    """Return on which plants our gains shorten the settling by more than this share."""
    failed = [
        axis_and_plant(f, c) for f in findings for c in f.stable if settling(c.ours) > (1 - share) * c.alone.settling
    ]
    rest = "" if not failed else f" but {' and '.join(failed)}, which by its own damping settles fast already"
    return f"on every plant they were tuned for{rest}"


def _damping(candidate: Candidate) -> str:
    """Return what the loop makes of the damping ratio of the resonance."""
    oscillating = max((pole for pole in candidate.margins.closed_loop_poles if pole.imag > 0), key=abs)
    exponent = cmath.log(oscillating)
    return f"from {n(candidate.plant.damping_ratio, 2)} to {n(-exponent.real / abs(exponent), 2)}"


def _creep(found: Findings, candidate: Candidate) -> float:
    """Return the time constant of the slowest closed-loop pole that does not oscillate [s]."""
    slowest = max(pole.real for pole in candidate.margins.closed_loop_poles if pole.imag == 0)
    return -found.axis["period"] / math.log(slowest)


def _step_figure(found: Findings, end: float) -> Figure:
    candidate = found.candidates[0]
    steps = {"open loop": candidate.alone, "printed gains": candidate.printed, "our gains": candidate.ours}
    curves = []
    for name, step in steps.items():
        if step is not None:
            shown = step.response.time <= end
            curves.append(
                charts.Curve(name, (1e3 * step.response.time[shown]).tolist(), step.response.output[shown].tolist())
            )
    caption = f"{found.axis.name}, {candidate.label}: a step, and the band of {100 * BAND:g} %"
    return Figure(f"step_{found.axis.column}.svg", charts.steps(curves, BAND), caption)


# --- Our gains


def our_gains(findings: Sequence[Findings]) -> Section:
    rows = [_tuned_row(f, c, c.tuning.pid) for f in findings for c in f.stable if c.tuning is not None]
    xy = findings[0]
    first, period = xy.candidates[0], xy.axis["period"]
    ours = first.tuning.pid if first.tuning else xy.axis.pid
    zeros, damping = _zeros(ours)
    _, printed_phase = _at_resonance(first.plant, xy.axis.pid, period)
    size, phase = _at_resonance(first.plant, ours, period)
    text = [
        "Ti and Td come out negative together with Kp. Nothing is wrong with that: what acts are the integral part "
        "Kp/Ti and the derivative part Kp Td, and both are positive. Eq (33) writes them as ratios to Kp, and Kp is "
        "the part that a light resonance needs least.",
        f"Why Kp is negative: a resonance is damped if the loop, PID and plant together, answers it with a phase near "
        f"0 deg. The plant lags by 90 deg there and the hold by {180 * first.plant.natural_frequency * period:.0f} deg "
        f"more (X/Y, no delay). A derivative formed from samples is late by half a sample besides, and so carries "
        f"{n(_in_phase(first.plant, ours, period), 2)} in phase with the position; Kp = {n(ours.kp, 2)} takes that "
        f"away. The loop phase at the resonance is then {phase:.0f} deg at a loop gain of {n(size, 2)}. With the "
        f"printed gains it is {printed_phase:.0f} deg, where feedback shifts the resonance and does not damp it. In Z "
        "with delay the loop keeps away from the resonance instead: its gain there is small.",
        f"The zeros of the controller are a complex pair, as a PID in series form cannot have, here at {hz(zeros)} "
        f"with damping ratio {n(damping, 2)}. They do not cancel the resonance: a notch on it would hide it from the "
        "reference and leave it ringing under disturbances.",
        "Not knowing the plant costs something. Gains tuned for one candidate may be slow on another, or unstable: "
        "measure the phase first.",
    ]
    head = ["tuned for", "Kp", "Ti", "Td", "Kp/Ti [1/s]", "Kp Td", "loop phase at f0", "gain at f0"]
    own = Table(head, rows, "Our gains; the set point enters through the integral part alone")
    tables = [own, *(_cross_table(found) for found in findings)]
    return Section("Our gains", text, tables)


def _tuned_row(found: Findings, candidate: Candidate, pid: PID) -> list[str]:
    size, phase = _at_resonance(candidate.plant, pid, found.axis["period"])
    return [
        axis_and_plant(found, candidate),
        n(pid.kp),
        ms(pid.ti),
        ms(pid.td),
        n(pid.kp / pid.ti, 3),
        to_text(pid.kp * pid.td, "us", 3, si="s"),
        f"{phase:.0f} deg",
        n(size, 2),
    ]


def _cross_table(found: Findings) -> Table:
    """Return how gains tuned for one candidate settle on the others."""
    rows = []
    for tuned in found.stable:
        times = [settling_on(c.plant, tuned.tuning.pid, found.axis["period"]) for c in found.stable if tuned.tuning]
        rows.append([axis_and_plant(found, tuned), *("unstable" if math.isnan(time) else ms(time) for time in times)])
    return Table(
        ["tuned for", *(f"on {c.label}" for c in found.stable)],
        rows,
        f"{found.axis.name}: settling of each tuning on each plant",
    )


def _at_resonance(plant: Plant, pid: PID, period: float) -> tuple[float, float]:
    """Return magnitude and phase [deg] of the sampled loop at the plant's natural frequency."""
    loop = matrices(open_loop(plant, pid, period))
    value = complex(loop.response(2 * math.pi * plant.natural_frequency * period)[0])
    return abs(value), math.degrees(cmath.phase(value))


def _in_phase(plant: Plant, pid: PID, period: float) -> float:
    """Return the part of the sampled derivative, Kp Td/T (1 - 1/z), in phase with the error at the resonance."""
    return pid.terms(period)[2] * (1 - math.cos(2 * math.pi * plant.natural_frequency * period))


def _zeros(pid: PID) -> tuple[float, float]:
    """Return natural frequency [Hz] and damping ratio of Kp Td s^2 + Kp s + Kp/Ti, a complex pair."""
    root = math.sqrt(1 / (pid.ti * pid.td))
    return root / (2 * math.pi), 1 / (2 * pid.td * root)


# --- (f) By experiment


def by_experiment(findings: Sequence[Findings]) -> Section:
    rows = []
    for found in findings:
        for one in found.experiments:
            gain, period = (a / b - 1 for a, b in zip(one.measured, one.exact, strict=True))
            values = [
                n(one.exact.gain),
                n(one.measured.gain),
                f"{gain:+.1e}",
                ms(one.exact.period, 4),
                f"{period:+.1e}",
            ]
            rows.append([f"{found.axis.name}, {one.label}", *values, f"{one.runs}", n(rule(one.measured).kp)])
    head = ["plant", "Ku", "by experiment", "off by", "Tu", "off by", "runs", "Kp by rule"]
    text = [
        "The experiment of Ziegler and Nichols, done on the simulated loop: raise the proportional gain until the "
        "oscillation neither grows nor decays. The gain is bracketed to one part in ten thousand, and growth is judged "
        "from the record alone. It is compared with the ultimate gain from the closed-loop poles of the same sampled "
        "plant. The candidates give the printed Kp back, as they must.",
    ]
    return Section("Ziegler-Nichols by experiment", text, [Table(head, rows)])


def _change_text(candidate: Candidate, step: Step | None) -> str:
    return f"{100 * (settling(step) / candidate.alone.settling - 1):+.0f} %"


def _worst(candidate: Candidate) -> float:
    return max(candidate.tuning.settling) if candidate.tuning else math.nan


def _with_damping(plant: Plant, damping: float) -> Plant:
    return Plant(plant.gain, plant.natural_frequency, damping, plant.delay)
