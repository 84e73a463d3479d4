"""How a stage moves: coupling of first and second order, tilt of the table, and natural vibrations."""

from __future__ import annotations

from collections.abc import Sequence

from flexdesign.core import units
from flexdesign.core.errors import join_names
from flexdesign.core.model import Quantity
from flexdesign.fem import cross_axis_coupling
from flexdesign.fem.cross_axis_coupling import CrossMotion
from flexdesign.fem.quantities.stage_modes import ModeShares
from flexdesign.report.document import Figure, Section, Table
from flexdesign.report.validation.stage_text import Axes, measured_values, percent, share, written
from flexdesign.report.wording import format_quantity
from flexdesign.workflows.validation import Comparison
from flexdesign.workflows.validation.validate_stage import StageValidation

#: How the table's motions in a mode are called.
DIRECTIONS = {
    "x": "along x",
    "y": "along y",
    "z": "along z",
    "rx": "tilt about x",
    "ry": "tilt about y",
    "rz": "turn about z",
}
#: A mode that carries less of an axis' response than this is not named with it; one below the other is not shown.
NAMED, LEAST = 0.05, 0.005


def coupling(validation: StageValidation) -> Section:
    """Return the section on coupling: of first and of second order, compared with measurements."""
    axes = Axes(validation)
    text = [
        "First order, in proportion to the travel: what asymmetry does. A symmetric stage has none, so that a cause "
        "is assumed for each row, and what follows is in proportion to how much of it is there. A linear solution "
        "shows all of it, and a feedforward matrix removes it.",
        "Second order, with the square of the travel: arms that tilt draw the table aside by δ²/2L, the same whichever "
        "way the axis goes. It is there in a perfectly symmetric stage, and no linear solution shows it. FEM's is from "
        "large displacements, the axis driven both ways: half the sum of both ends is of even order, half the "
        "difference of odd. Where arms on both sides draw equally, symmetry leaves none.",
    ]
    tables = [_causes(validation, axes)]
    if validation.motions:
        tables.append(_second_order(validation, axes))
    else:
        text.append("Large displacements were not asked for: output.large_steps is 0.")
    text += [*_growth(validation, axes), *_coarse(validation)]
    return Section("Coupling", text, tables)


def _causes(validation: StageValidation, axes: Axes) -> Table:
    pairs = list(axes.pairs())
    rows = [
        [cause.name, cause.assumed, *(share(cause.coupling.get(driven, {}).get(other, 0.0)) for driven, other in pairs)]
        for cause in validation.causes
    ]
    heads = [axes.pair(driven, other) for driven, other in pairs]
    return Table(["cause", "assumed", *heads], rows, "First order: motion aside per travel, by cause")


def _second_order(validation: StageValidation, axes: Axes) -> Table:
    arms = validation.study.design.stage().arms()
    rows = []
    for motion in [*validation.motions, *validation.at_full_stroke]:
        estimated = cross_axis_coupling.coupling_by_arms(motion.travel, arms, motion.axis)
        for driven, other in axes.pairs():
            if driven == motion.axis:
                rows.append(_cross_motion(axes, motion, other, estimated.get(other)))
    columns = ["driven → drawn", "input", "travel", "even part", "odd part", "per travel", "δ²/2L", "per travel"]
    return Table(columns, rows, "Second order: large displacements, and the arms' δ²/2L")


def _cross_motion(axes: Axes, motion: CrossMotion, other: str, arm: float | None) -> list[str]:
    even, odd = (_motion(values[other], motion.travel) for values in (motion.even, motion.odd))
    return [
        axes.pair(motion.axis, other),
        units.to_text(motion.extension, "um", si="m"),
        units.to_text(motion.travel, "um", si="m"),
        even,
        odd,
        share(motion.even[other] / motion.travel),
        "–" if arm is None else units.to_text(arm, "um", 3, si="m"),
        "–" if arm is None else share(arm / motion.travel),
    ]


def _motion(value: float, travel: float) -> str:
    if abs(value) < cross_axis_coupling.ROUNDING * travel:
        return "0"
    return units.to_text(value, "um", 3, si="m")


def _growth(validation: StageValidation, axes: Axes) -> list[str]:
    """Say by how much more the ratio is at full stroke: as the travel, if it is of second order."""
    near = {motion.axis: motion for motion in validation.motions}
    texts = []
    for far in validation.at_full_stroke:
        for driven, other in axes.pairs():
            base = near[far.axis]
            if driven != far.axis or abs(base.even[other]) < cross_axis_coupling.ROUNDING * base.travel:
                continue
            grown = far.even[other] / far.travel / (base.even[other] / base.travel)
            texts.append(
                f"{axes.pair(driven, other)}: the ratio is {grown:.3f} times as large where the travel is "
                f"{far.travel / base.travel:.3f} times as large"
            )
    return [f"{'; '.join(texts)}. A ratio that grows as the travel is of second order."] if texts else []


def _coarse(validation: StageValidation) -> list[str]:
    """Say on what meshes large displacements are, and how far the coarsest is from the limit."""
    off: dict[str, float] = {}
    for motion in [*validation.motions, *validation.at_full_stroke]:
        for quantity in motion.quantities():
            kind = "travel" if quantity.name == "travel" else "motion aside per travel"
            if quantity.value:
                gap = abs(quantity.value / validation.fem(quantity.key).value - 1)
                off[kind] = max(off.get(kind, 0.0), gap)
    if not off:
        return []
    most = join_names([f"{100 * ratio:.2g} % in {kind}" for kind, ratio in off.items()])
    return [
        "Large displacements are solved on the two coarsest meshes. The table below, rotations and pictures are of the "
        f"coarsest, which differs from the limit by up to {most}; travel and coupling elsewhere in this report are "
        "extrapolated, with their estimated errors."
    ]


def compare_with_measurements(validation: StageValidation) -> Section:
    """Return the section that compares FEM with numbers that have an uncertainty, and says what these can prove."""
    axes = Axes(validation)
    found = [c for c in validation.comparisons if measured_values(c) and axes.is_listed(c.fem)]
    if not found:
        return Section("Comparison with measurements")
    rows = []
    for comparison in found:
        fem = comparison.fem
        for label, theirs in measured_values(comparison).items():
            cells = [axes.what(fem), axes.where(fem), format_quantity(fem), written(validation, label, theirs)]
            known = abs(theirs.value) > (theirs.half_width or 0.0)
            off = percent(comparison.error(label)) if known else "–"
            rows.append([*cells, off, verdict(comparison, theirs)])
    columns = ["quantity", "boundary", "FEM", "measured ± uncertainty", "off by", "what it proves"]
    text = [
        "A measurement proves as much as its uncertainty lets it. A measured coupling also has the sensor's "
        "misalignment, which no uncertainty here covers: a degree off its axis reads 1.7 % of the travel. FEM's "
        "coupling is that of second order, the measured one of all orders.",
        *_implied_amplification(validation, axes, found),
        *_required_causes(validation, axes, found),
    ]
    return Section("Comparison with measurements", text, [Table(columns, rows)])


def verdict(comparison: Comparison, theirs: Quantity) -> str:
    """Say what a measured number proves of a quantity."""
    sigma = theirs.half_width or 0.0
    gap = abs(theirs.value - comparison.fem.value)
    within = gap <= sigma + (comparison.fem.half_width or 0.0)
    if abs(theirs.value) <= sigma:
        return "nothing: the number itself lies inside the uncertainty"
    return "agrees within the uncertainty" if within else "differs by more than the uncertainty: unexplained"


def _implied_amplification(validation: StageValidation, axes: Axes, found: Sequence[Comparison]) -> list[str]:
    """Say what amplification the measured travels mean, compared with that of the models."""
    texts = []
    for comparison in found:
        axis = comparison.fem.boundary.partition(", ")[0]
        motion = next((m for m in validation.at_full_stroke if m.axis == axis), None)
        if comparison.fem.name != "travel" or motion is None:
            continue
        models = next(c for c in validation.comparisons if c.fem.key == f"lambda_{axis}_table_free").analytic
        known = "".join(f", “{model}” {units.significant(abs(q.value), 3)}" for model, q in models.items())
        texts += [
            f"{axes.label(axis)} {units.significant(theirs.value / motion.extension, 3)} as measured, FEM "
            f"{units.significant(comparison.fem.value / motion.extension, 3)}{known}"
            for theirs in measured_values(comparison).values()
        ]
    if not texts:
        return []
    return [
        f"Travel over input: {'; '.join(texts)}. Where model and measurement disagree, a difference of FEM's is open."
    ]


def _required_causes(validation: StageValidation, axes: Axes, found: Sequence[Comparison]) -> list[str]:
    """Say how much of each cause of first order would make what was measured, each alone."""
    texts = []
    for comparison in found:
        _, coupled, other = comparison.fem.name.partition("coupling_")
        if not coupled:
            continue
        driven = comparison.fem.boundary.partition(", ")[0]
        value = next(iter(measured_values(comparison).values())).value
        times = {
            c.name: abs(value / c.coupling[driven][other])
            for c in validation.causes
            if _acts(c.coupling, driven, other)
        }
        listed = ", ".join(f"{units.significant(many, 2)} times the {name}" for name, many in times.items())
        texts.append(f"{axes.pair(driven, other)} as measured takes {listed}" if times else "")
    texts = [each for each in texts if each]
    return (
        [f"Were it first order, of what the table of causes assumes, each alone: {'; '.join(texts)}."] if texts else []
    )


def _acts(coupling: object, driven: str, other: str) -> bool:
    value = coupling.get(driven, {}).get(other, 0.0) if isinstance(coupling, dict) else 0.0
    return abs(value) > cross_axis_coupling.ROUNDING


def tilt(validation: StageValidation) -> Section:
    """Return the section on the table's rotations."""
    if not validation.motions:
        return Section("Tilt of the table")
    axes, rows = Axes(validation), []
    for motion in validation.motions:
        if axes.head[motion.axis] == motion.axis:
            per = [value / motion.travel for value in motion.turned]
            angles = ["0" if abs(each) < 1e-6 else f"{each:.3g}" for each in per]
            largest = max(abs(value) for value in motion.turned)
            rows.append(
                [
                    axes.label(motion.axis),
                    units.to_text(motion.travel, "um", si="m"),
                    *angles,
                    f"{1e6 * largest:.3g} urad",
                ]
            )
    columns = ["driven", "travel", "about x", "about y", "about z", "largest, at that travel"]
    text = (
        "Rotations of the table per travel, in urad/um, large displacements at the stated input. A sensor that looks "
        "at another point than the table's sees them as Abbe's error: the arm times the rotation."
    )
    return Section("Tilt of the table", [text], [Table(columns, rows)])


def modes(validation: StageValidation, figures: Sequence[Figure]) -> Section:
    """Return the section on natural vibrations, with pictures of modes where there are any."""
    axes = Axes(validation)
    text = [
        "Parts by their condensed mass, bodies rigid, frame at rest. An actuator is a spring between its inputs and "
        "has no mass here, so that frequencies with actuators are upper bounds. A mode's share of an axis' "
        "static stroke is its part of the table's motion under a constant voltage; all modes together make 100 %. The "
        "table's motion is stated by its part of the kinetic energy; the rest is in blocks, bridges, limbs and "
        "amplifiers.",
        *_weak_modes(validation, axes),
    ]
    if figures:
        text.append(
            "Colours run from rest (dark) to the largest motion (bright); the drawn size of a mode has no meaning."
        )
    states = zip(("no", "yes"), validation.modes, strict=True)
    rows = [_mode(validation, mode, state) for state, found in states for mode in found]
    heads = [f"share of static stroke {axis.upper()}" for axis in axes.names]
    table = Table(["frequency", "actuators", *heads, "what the table does"], rows, "Lowest modes on the finest mesh")
    limits = [
        [q.name.replace("_", " "), axes.where(q), format_quantity(q)]
        for q in validation.further
        if q.name.startswith("drive_") and axes.is_listed(q)
    ]
    tables = [
        Table(["quantity", "boundary", "FEM"], limits, "The mode with the largest share of an axis' static stroke")
    ]
    return Section("Natural frequencies", text, [*(tables if limits else []), table], figures, gallery=True)


def _weak_modes(validation: StageValidation, axes: Axes) -> list[str]:
    """Name modes that move the table along an axis and have a small share of its static stroke."""
    texts = []
    for axis in axes.listed:
        for mode in validation.modes[1]:
            energy, driven = mode.table[axis], mode.participation[axis]
            if energy >= NAMED and driven < NAMED:
                texts.append(
                    f"the mode at {units.significant(mode.mode.frequency, 4)} Hz moves the table along {axis} "
                    f"({100 * energy:.0f} % of its energy) but has {100 * driven:.1f} % of the static stroke of "
                    f"{axes.label(axis)} only: a load on the table excites it, the drive hardly does"
                )
    return [f"Note {'; '.join(texts)}."] if texts else []


def _mode(validation: StageValidation, mode: ModeShares, state: str) -> list[str]:
    driven = [f"{100 * value:.1f} %" if abs(value) >= LEAST else "–" for value in mode.participation.values()]
    return [f"{units.significant(mode.mode.frequency, 4)} Hz", state, *driven, describe_mode(mode)]


def describe_mode(mode: ModeShares) -> str:
    """Say how the table moves in a mode."""
    directions = sorted(((value, name) for name, value in mode.table.items() if value >= LEAST), reverse=True)
    listed = ", ".join(f"{DIRECTIONS[name]} {100 * value:.0f} %" for value, name in directions)
    return listed or "rests"
