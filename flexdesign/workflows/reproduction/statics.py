"""Equations (1) to (25) and Table 1: the stage by formulas and by finite elements, compared with what is printed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from flexdesign.analytic.lagrange import static_gain
from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.core.printed_numbers import Publication
from flexdesign.workflows.reproduction.items import Item, compare, contradiction, in_unit_of, row_without_number
from flexdesign.workflows.validation.validate_stage import StageValidation

MODEL, FEA = "Table 1, model", "Table 1, FEA"
SIZED = "the stage was sized to it: flexdesign size lin2019_stage_targets"
#: Names of columns by quantity.
ROWS = (("K_out", "x", "inputs_free"), ("K_out", "z", "inputs_free"), ("K_in", "x", "table_free"),
        ("K_in", "z", "table_free"))  # fmt: skip


def items(paper: Publication, found: StageValidation) -> Iterator[Item]:
    """Yield every row of the statics."""
    yield from _amplifier(paper, found)
    yield from _gains(paper)
    yield from _masses(paper, found)
    yield from _table_1(paper, found)
    yield from _couplings(paper, found)


def formula(found: StageValidation, key: str, model: str = "paper (21)") -> Quantity:
    """Return what an analytic model says of a quantity."""
    return next(c.analytic[model] for c in found.comparisons if c.fem.key == key)


def _suffix(axis: str) -> str:
    return "xy" if axis == "x" else "z"


def _label(axis: str) -> str:
    return "X/Y" if axis == "x" else "Z"


def _amplifier(paper: Publication, found: StageValidation) -> Iterator[Item]:
    design = found.study.design
    bridge = design.stage().xy_amplifier.formulas(design.material, None, None)["PRB"]  # type: ignore[attr-defined]
    by_name = {q.key: q for q in bridge}
    yield compare(
        "P1", "2 K_b = K_out in Z, K_b = 2 K_r / l_x² by (5)", paper(MODEL, "K_out_z"),
        replace(by_name["K_out_input_free"], value=2 * by_name["K_out_input_free"].value), built=SIZED,
    )  # fmt: skip
    yield row_without_number(
        "P2", "bending of the input rods", "eqs (10) to (15)", "flexdesign validate lin2019_amplifier_xy"
    )
    yield compare(
        "P3", "λ of X/Y by (17)", paper("eq (31)", "gain_xy"), formula(found, "lambda_x_table_free"), built=SIZED
    )
    yield row_without_number("P4", "M_b of (18), (19)", "eq (19)", by_name["output_mass_input_free"].formatted())
    yield row_without_number(
        "P7", "eight printed numbers against eight unknowns", "Table 1; eq (31)",
        "K_out, K_in, coupling and gain of two axes; K_r, l_x, two l_y, two rod compliances, L_1, L_2",
        "that a geometry meets them proves nothing: it is one realisation of many",
    )  # fmt: skip


def _gains(paper: Publication) -> Iterator[Item]:
    for axis in "xz":
        k_in, k = (paper(MODEL, f"{name}_{_suffix(axis)}") for name in ("K_in", "K_out"))
        gain = paper("eq (31)", f"gain_{_suffix(axis)}")
        back = static_gain(k_in.value("N/m"), gain.value("1"), k.value("N/m"))
        yield contradiction(
            "P12", f"gain of {_label(axis)} by (31) and by (30) with λ equal to it",
            [(k_in, "N/m"), (k, "N/m"), (gain, "1")], gain.value("1"), back, "",
            f"k_in / (4 λ k) of (30) is no amplification: λ = {back:.3g} makes it {gain.text}, and λ = {gain.text} "
            f"makes it {back:.3g}",
        )  # fmt: skip
    fig7, fig9 = "section 4.2, Fig 7", "section 4.2, Figs 9 to 11"
    ratios = []
    for axis in "xz":
        travel, span = paper(fig9, f"travel_{axis}"), paper(fig7, f"span_{_suffix(axis)}")
        ratios.append((travel, span, travel.value("m") / span.value("m")))
    (x_moved, x_span, x_ratio), (z_moved, z_span, z_ratio) = ratios
    strokes = " and ".join(f"{1e6 * paper(fig9, 'input').value('m') / ratio:.2f} um" for ratio in (x_ratio, z_ratio))
    row = contradiction(
        "P11", "travel at 40 um over travel at 120 V: X and Z",
        [(n, "m") for n in (x_moved, x_span, z_moved, z_span)], x_ratio, z_ratio, "",
        "Figs 7 and 9 to 11 show two amplifications",
    )  # fmt: skip
    why = f"Figs 7 and 9 to 11 show one amplification, with 120 V as {strokes} of the actuator's 40 um"
    uses = (*row.uses, (fig7, "voltage"), (fig9, "input"))
    yield replace(row, why=why if row.verdict == "agrees" else row.why, uses=uses)
    for axis, travel in (("x", x_moved), ("z", z_moved)):
        gain = paper("eq (31)", f"gain_{_suffix(axis)}")
        measured = travel.value("m") / paper(fig9, "input").value("m")
        yield contradiction(
            "P13", f"gain of {_label(axis)}: (31), and Figs 9 to 11", [(gain, "1"), (travel, "m")],
            gain.value("1"), measured, "", "the printed model and the bench have two amplifications",
        )  # fmt: skip


def _masses(paper: Publication, found: StageValidation) -> Iterator[Item]:
    masses = {}
    for axis in "xz":
        t1, t2 = (paper("eq (31)", f"{t}_{_suffix(axis)}") for t in ("t1", "t2"))
        k = paper(MODEL, f"K_out_{_suffix(axis)}")
        product = t1.value("s") * t2.value("s")
        masses[axis] = k.value("N/m") * product
        fem = found.fem(f"output_mass_{axis}_inputs_free")
        counted = formula(found, fem.key)
        frequency = found.fem(f"output_frequency_{axis}_inputs_free")
        yield Item(
            "P5", f"mass and frequency of {_label(axis)}: (31), and (20) to (22)", "eq (31); Table 1, model",
            f"{1e3 * masses[axis]:.3g} g, {1 / (2 * math.pi * math.sqrt(product)):.4g} Hz",
            f"(21) {counted.formatted(3)}; FEM {fem.formatted()}, {frequency.formatted()}", "not printed",
            "m = K t1 t2; the paper prints the size of no body, and M_s and M_p of ours are choices",
            tuple((n.place, n.name) for n in (t1, t2, k)),
        )  # fmt: skip
    yield row_without_number(
        "P5", "M_x less M_z by (21), 2 M_b - 2 M_p", "eq (21)", f"(31): {1e3 * (masses['x'] - masses['z']):.3g} g",
        "an amplifier's M_b is larger than a guide's M_p by half of this, if (31) holds",
    )  # fmt: skip


def _table_1(paper: Publication, found: StageValidation) -> Iterator[Item]:
    for name, axis, boundary in ROWS:
        key, column = f"{name}_{axis}_{boundary}", f"{name}_{_suffix(axis)}"
        what = f"{name} of {_label(axis)}"
        yield compare("P7", f"{what}, model row", paper(MODEL, column), formula(found, key), built=SIZED)
        why = _ceiling(paper, found) if (name, axis) == ("K_in", "x") else ""
        built = SIZED if name == "K_out" else ""
        yield compare("P7", f"{what}, FEA row", paper(FEA, column), found.fem(key), built=built, why=why)
        model, fea, error = (paper(f"Table 1, {row}", column) for row in ("model", "FEA", "error"))
        off = abs(model.value("N/m") / fea.value("N/m") - 1)
        yield compare("P7", f"{what}, error", error, Quantity("error", off, "1", "%"), also=(model, fea))


def _ceiling(paper: Publication, found: StageValidation) -> str:
    """Say why no stage of this kind has K_in in X/Y of the FEA row."""
    design = found.study.design
    bridge = design.stage().xy_amplifier  # type: ignore[attr-defined]
    own = next(q for q in bridge.formulas(design.material, None, None)["PRB"] if q.key == "K_out_input_free").value
    load = paper(FEA, "K_out_xy").value("N/m") - own
    at = {
        name: next(
            q for q in bridge.formulas(design.material, None, k)["PRB"]
            if q.name == "K_in" and q.boundary not in ("output free",)
        ).value
        for name, k in (("own", own), ("left", load))
    }  # fmt: skip
    k_out, k_in = paper(FEA, "K_out_xy"), paper(FEA, "K_in_xy")
    body, rest = (units.to_text(k, k_out.unit, digits, si="N/m") for k, digits in ((own, 3), (load, 2)))
    at_body, at_rest = (units.to_text(k, k_in.unit, 4, si="N/m") for k in (at["own"], at["left"]))
    return (
        f"K_in rises with the stiffness that the output pushes against. By (17) it is {at_body} against K_b = {body}. "
        f"In a stage of K_out = {k_out.text} an amplifier pushes against {rest}, and by (17) K_in is {at_rest}; the "
        f"elasticity that (17) neglects only lowers it. No stage of this kind has {k_in.text}"
    )


def _couplings(paper: Publication, found: StageValidation) -> Iterator[Item]:
    stage, ratio = found.study.design.stage(), formula(found, "lambda_x_table_free").value
    arms, stroke = stage.arms(), paper("Figs 4 and 5", "input_xy")
    for to in "yz":
        length = arms[to, "x"]
        by_arms = Quantity("coupling", stroke.value("m") * ratio / (2 * length), "1", "%")
        what = f"coupling X–{to.upper()}"
        printed = paper(MODEL, f"coupling_{to}_x")
        yield compare("P6", f"{what} by (25), model row", printed, by_arms, built=SIZED, also=[stroke])
        fem = found.fem(f"coupling_{to}_x_input_of_20_um")
        fea = paper(FEA, f"coupling_{to}_x")
        yield compare("P6", f"{what}, FEA row", fea, fem)
        off = printed.value("1") / fea.value("1") - 1
        yield row_without_number(
            "P6", f"{what}, error of Table 1", "Table 1, error", f"{100 * off:.0f} %", "a dash is printed there",
            [printed, fea],
        )  # fmt: skip
    stack, k_in = paper("section 4.1", "actuator_stiffness"), found.fem("K_in_x_table_free")
    yield Item(
        "P7", "K_in below the stiffness of the actuator", "section 3; section 4.1", f"less than {stack.text}",
        in_unit_of(k_in, stack).formatted(), "agrees" if k_in.value < stack.value("N/m") else "differs", "",
        ((stack.place, stack.name),),
    )  # fmt: skip
    z = paper("Figs 4 and 5", "input_z")
    yield row_without_number(
        "P7", "input in Z of Fig 5", z.place, units.to_text(found.inputs["z"], "um", si="m"), "", [z]
    )
    fig9 = "section 4.2, Figs 9 to 11"
    for axis in "xz":
        travel = paper(fig9, f"travel_{axis}")
        known = motion_uncertainty(paper, travel.value("m"))
        fem = found.fem(f"stroke_{axis}_table_free")
        yield compare("P11", f"travel of {_label(axis)} at 40 um, FEM", travel, fem, built=SIZED, known=known)
    for to, axis in ("yx", "zx", "xz"):
        aside, printed = (paper(fig9, f"{name}_{to}_{axis}") for name in ("moved", "coupling"))
        along = paper(fig9, f"travel_{axis}")
        known = motion_uncertainty(paper, aside.value("m")) / along.value("m")
        fem = found.fem(f"coupling_{to}_{axis}_input_of_40_um")
        turned = math.degrees(math.atan(printed.value("1") - fem.value))
        why = (
            f"the stage as drawn couples only in second order; a sensor {turned:.1f}° off its axis, or a table mounted "
            "at that angle, would read the printed coupling"
        )
        what = f"coupling {axis.upper()}–{to.upper()} at 40 um, FEM"
        yield compare("P11", what, printed, fem, known=known, why=why, also=(aside, along))


def motion_uncertainty(paper: Publication, motion: float) -> float:
    """Return how well a measured motion is known [m]: the sensor's resolution, and the slope of its nonlinearity.

    A parabola through both ends of the range that is as high as the linearity has gradients up to 4 linearity / range.
    """
    span = paper("section 4.1", "sensor_range").value("m")
    resolution = paper("section 4.1", "sensor_resolution").value("1") * span
    return resolution + 4 * paper("section 4.1", "sensor_linearity").value("1") * motion
