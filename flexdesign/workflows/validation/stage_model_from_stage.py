"""What FEM hands over to dynamics of a whole stage: one axis for each that is driven, and how they couple."""

from __future__ import annotations

import math
from collections.abc import Mapping

from flexdesign.core.model import Quantity
from flexdesign.design.design import Design
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, ControllerTiming, Coupling, StageModel
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from flexdesign.workflows.validation.stage_model_from_part import (
    PLACEHOLDER_DAMPING,
    SAMPLES_PER_PERIOD,
    with_hysteresis,
)


def stage_model_of(
    design: Design,
    stage: AssembledStage,
    found: Mapping[str, Quantity],
    quadratic: Mapping[tuple[str, str], float],
) -> StageModel | None:
    """Return the stage model that the quantities, by key, give; None without an actuator.

    Parameters
    ----------
    design
        Of the stage.
    stage
        Put together on the finest mesh.
    found
        Its quantities by key.
    quadratic
        Couplings of second order by (to, from) [1/m].
    """
    if design.actuator is None:
        return None
    axes = {axis: _axis(design, axis, len(stage.assembly.axes[axis].drives), found) for axis in stage.assembly.axes}
    fastest = max(axis.natural_frequency for axis in axes.values())
    timing = ControllerTiming(rate=1000.0 * math.ceil(SAMPLES_PER_PERIOD * fastest / 1000.0))
    source = (
        "FEM of the stage, parts condensed to their ports; uncertainties are those of the discretisation alone, "
        f"half-widths taken as 1 sigma. The controller's rate is a proposal, {SAMPLES_PER_PERIOD} samples or more for "
        "a period of the fastest axis; couplings are of second order, those of first order being zero by symmetry"
    )
    coupling = Coupling(quadratic=dict(quadratic))
    return StageModel(axes, timing, coupling, title=design.title, source=source, name="stage_model")


def _axis(design: Design, axis: str, count: int, found: Mapping[str, Quantity]) -> AxisModel:
    actuator = design.actuator
    assert actuator is not None
    stiffness, frequency = (
        found[f"K_out_{axis}_actuators_installed"],
        found[f"drive_frequency_{axis}_actuators_installed"],
    )
    stroke, k_in, ratio = (found[f"{name}_{axis}_table_free"] for name in ("stroke", "K_in", "lambda"))
    share, voltage = found[f"drive_share_{axis}_actuators_installed"].value, actuator.voltage_range
    known = {"stiffness": stiffness, "gain": stroke, "input_stiffness": k_in, "amplification": ratio}
    relative = {name: (q.half_width or 0.0) / abs(q.value) for name, q in known.items()}
    relative["mass"] = math.hypot(relative["stiffness"], 2 * (frequency.half_width or 0.0) / frequency.value)
    axis_model = AxisModel(
        natural_frequency=frequency.value,
        damping_ratio=PLACEHOLDER_DAMPING,
        gain=stroke.value / (voltage[1] - voltage[0]) if voltage else math.nan,
        mass=stiffness.value / (2 * math.pi * frequency.value) ** 2,
        stiffness=stiffness.value,
        actuator=ActuatorData(
            free_stroke=actuator.free_stroke,
            voltage_range=voltage,
            stiffness=actuator.stiffness,
            preload=actuator.preload,
            contact_stiffness=actuator.contact_stiffness if math.isfinite(actuator.contact_stiffness) else None,
            count=count,
        ),
        input_stiffness=k_in.value,
        amplification=ratio.value,
        uncertainty={name: float(f"{value:.2g}") for name, value in relative.items()} | {"damping_ratio": 1.0},
        assumed=("damping_ratio",),
        sources={
            "damping_ratio": "placeholder, typical of monolithic metal flexures; identify it",
            "mass": f"stiffness / (2 pi f)^2; the mode carries {100 * share:.3g} % of the static response to the "
            "actuators, and what others carry goes with it",
            "gain": "all actuators of the axis over the whole voltage range, opposite ones against each other",
        },
    )
    return with_hysteresis(axis_model, actuator, stroke.value)
