"""The compliant parts of a stage: strain energy by kind of part, and an amplifier alone and built in.

Under a unit force on the table, inputs free, element e holds the energy U_e, and the table moves by x. As 2 U_e / x^2
add up to the stiffness, each is a spring between table and frame, to be compared with those of a formula.

An amplifier alone, its ground held, is a compliance c between actuator (1) and output (2). Loaded by a spring L,

    1 / K_in = c11 - c12^2 L / (1 + c22 L),     lambda = c12 / (c11 (1 + c22 L) - c12^2 L).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.analytic.branched_stage import AMPLIFIERS
from flexdesign.core.model import Quantity, output_boundary
from flexdesign.design.assembly import Element, Stage
from flexdesign.design.materials import Material
from flexdesign.design.part import Piece
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from flexdesign.fem.superelements.superelement import Superelement

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Spring:
    """What elements of one kind add to the stiffness of an axis, inputs free [N/m]."""

    kind: str
    count: int
    stiffness: float


@dataclass(frozen=True)
class InputChain:
    """An axis' input stiffness from the formula to the stage, one cause at a time [N/m].

    Parameters
    ----------
    load
        What each amplifier pushes against by the springs that are counted.
    formula
        The amplifier's formula, so loaded.
    amplifier
        FEM of the amplifier alone, so loaded: what the formula leaves out of the amplifier.
    stage
        FEM of the stage on the same mesh: what else gives way between amplifier and table.
    output, amplification
        Of the amplifier alone, its output stiffness, input free [N/m], and its amplification, so loaded, as a number:
        by its formula and by FEM.
    """

    load: float
    formula: float
    amplifier: float
    stage: float
    output: tuple[float, float]
    amplification: tuple[float, float]


def kind_name(piece: Piece, elements: Sequence[Element]) -> str:
    """Return what equal elements are called: the words that their names share, and how thick their hinges are.

    Parameters
    ----------
    piece, elements
        As `Assembly.kinds` gives them.
    """
    first, *others = (element.name.split("_") for element in elements)
    words = [word for word in first if all(word in other for other in others) and not word.isdigit()]
    thickness = min((hinge.thickness for hinge in piece.linkage().of_kind("hinge")), default=0.0)
    return " ".join(words or [type(piece).__name__]) + (f", {1e3 * thickness:g} mm" if thickness else "")


def springs(stage: AssembledStage) -> dict[str, list[Spring]]:
    """Return by axis what each kind of part adds to its stiffness, the largest first."""
    found = {}
    for axis, along in stage.assembly.axes.items():
        load = np.asarray(np.array(along.direction) @ stage.table[:3])
        motion = np.asarray(np.linalg.solve(stage.stiffness, load))
        travel = float(load @ motion)
        shares = []
        for piece, elements in stage.assembly.kinds():
            held = sum((_energy(stage, element.name, motion) for element in elements), 0.0)
            shares.append(Spring(kind_name(piece, elements), len(elements), 2 * held / travel**2))
        found[axis] = sorted(shares, key=lambda spring: -spring.stiffness)
    return found


def _energy(stage: AssembledStage, name: str, motion: FloatArray) -> float:
    places, onto = stage.connection(name)
    amplitudes = onto @ motion[places]
    return float(amplitudes @ stage.parts[name].stiffness @ amplitudes) / 2


def input_chains(
    design: Stage, material: Material, stage: AssembledStage, found: Mapping[str, Quantity]
) -> dict[str, InputChain]:
    """Return by axis how its input stiffness comes about, where the stage counts its amplifiers among its springs.

    Parameters
    ----------
    design, material
        What counts springs.
    stage, found
        The assembled stage, and its quantities by key.
    """
    chains = {}
    for axis, rows in design.springs(material).items():
        amplifiers = sum(row[2].value for row in rows if row[0] == AMPLIFIERS)
        driven = [stage.assembly.element(name) for name in stage.assembly.axes[axis].drives]
        if not amplifiers or not driven:
            continue
        alone = _formula(driven[0], material, "K_out", 0.0, "input free")
        load = (sum(row[2].value for row in rows) - amplifiers) / (amplifiers / alone)
        ports = [two_port(stage.parts[element.name]) for element in driven]
        built = [_input_compliance(port, load) for port in ports]
        loaded = output_boundary(load)
        counted = [1 / _formula(element, material, "K_in", load, loaded) for element in driven]
        ratios = [abs(_formula(element, material, "lambda", load, loaded)) for element in driven]
        chains[axis] = InputChain(
            load=load,
            formula=float(1 / np.mean(counted)),
            amplifier=float(1 / np.mean(built)),
            stage=float(found[f"K_in_{axis}_table_free"].value),
            output=(alone, float(1 / np.mean([port[1, 1] for port in ports]))),
            amplification=(float(np.mean(ratios)), float(np.mean([_amplification(port, load) for port in ports]))),
        )
    return chains


def two_port(part: Superelement) -> FloatArray:
    """Return the compliance between actuator and output along its normal, ground held, shape (2, 2) [m/N]."""
    ground = [shapes.port.name for shapes in part.shapes if shapes.port.role == "ground"]
    output = next(shapes.port for shapes in part.shapes if shapes.port.role == "output")
    held = np.concatenate([np.arange(len(part.stiffness))[part.rows(name)] for name in ground])
    free = np.setdiff1d(np.arange(len(part.stiffness)), held)
    rows = np.stack([part.extension, np.array(output.normal) @ part.averages[output.name][:3]])[:, free]
    return np.asarray(rows @ np.linalg.solve(part.stiffness[np.ix_(free, free)], rows.T))


def _input_compliance(c: FloatArray, load: float) -> float:
    return float(c[0, 0] - c[0, 1] ** 2 * load / (1 + c[1, 1] * load))


def _amplification(c: FloatArray, load: float) -> float:
    return abs(float(c[0, 1] / (c[0, 0] * (1 + c[1, 1] * load) - c[0, 1] ** 2 * load)))


def _formula(element: Element, material: Material, name: str, load: float, boundary: str) -> float:
    """Return a stiffness by a part's first analytic model [N/m]."""
    models: Mapping[str, Sequence[Quantity]] = element.part.formulas(material, None, load)  # type: ignore[attr-defined]
    first = next(iter(models.values()))
    return next(quantity.value for quantity in first if (quantity.name, quantity.boundary) == (name, boundary))
