"""What FEM hands over to dynamics: the stage model of a design."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from flexdesign.core.model import Quantity
from flexdesign.design.design import Actuator, Design
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, ControllerTiming, StageModel
from flexdesign.dynamics.stage_model import Mode as StageMode
from flexdesign.fem.analysis import Solution
from flexdesign.fem.quantities.vibration import drive_share

#: Samples of the proposed controller for a period of the fastest mode.
SAMPLES_PER_PERIOD = 20
#: A damping ratio to begin with, where nothing is known.
PLACEHOLDER_DAMPING = 0.01
#: The axis of a stage model that one part gives: that of its output.
AXIS = "y"
#: A mode with less of the response to the actuator than this stays out of the stage model.
LEAST_SHARE = 0.02


def stage_model(
    design: Design,
    found: Mapping[str, Quantity],
    solution: Solution,
    effects: Mapping[str, Mapping[str, float]] | None = None,
) -> StageModel | None:
    """Return the stage model that the quantities, by key, and a solution with modes give; None without an actuator.

    What large displacements do comes as `effects`, with their values.

    The main mode is the one that carries most of the response to the actuator. The mass is lumped: with all of the
    stiffness it gives that mode its frequency. A second mode that carries a fair part of the response is added;
    what other modes carry follows with the main one, whose share is the remainder.
    """
    actuator = design.actuator
    if actuator is None:
        return None
    stiffness, frequency = found["K_out_actuator_installed"], found["drive_frequency_actuator_installed"]
    stroke, k_in, ratio = found["stroke_output_free"], found["K_in_output_free"], found["lambda_output_free"]
    voltage = actuator.voltage_range
    share, modes = _two_largest_modes(solution, actuator.installed_stiffness)
    known = {"stiffness": stiffness, "gain": stroke, "input_stiffness": k_in, "amplification": ratio}
    relative = {name: (q.half_width or 0.0) / abs(q.value) for name, q in known.items()}
    relative["mass"] = math.hypot(relative["stiffness"], 2 * (frequency.half_width or 0.0) / frequency.value)
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
    axis = with_hysteresis(axis, actuator, stroke.value)
    return StageModel({AXIS: axis}, timing, title=design.title, source=source, name="stage_model")


def with_hysteresis(axis: AxisModel, actuator: Actuator, stroke: float) -> AxisModel:
    """Return an axis with the hysteresis of the stacks that move it by a stroke [m], its gain k_v raised by as much.

    What a free stack extends by reaches the output times stroke over free stroke, and so does its hysteresis. The
    stroke stays what it is: the steady loop over the whole range of voltage spans it.
    """
    stack = actuator.hysteresis
    if stack is None:
        return axis
    reached = abs(stroke) / actuator.free_stroke
    values = {"a": stack.a * reached, "b": stack.b, "c": stack.c, "n": 1.0, "rest": 0.0}
    axis = replace(axis, effects={**axis.effects, "bouc_wen": values})
    source = f"of the free stack, times travel per free stroke, {reached:.4g}"
    source_of = {"bouc_wen": f"{source}; {stack.source}" if stack.source else source}
    if actuator.voltage_range is not None:
        given = axis.sources.get("gain", "travel over range of voltage")
        source_of["gain"] = f"{given}, and what hysteresis holds back of it: the steady loop spans the travel"
    return replace(
        axis,
        gain=math.copysign(abs(axis.gain) + stages.held_back(axis), axis.gain),
        assumed=(*axis.assumed, "bouc_wen") if stack.assumed else axis.assumed,
        sources={**axis.sources, **source_of},
    )


def _two_largest_modes(solution: Solution, actuator: float) -> tuple[float, tuple[StageMode, ...]]:
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
        "damping_ratio": "placeholder, typical of monolithic metal flexures; identify it",
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
            f"unknown: the free stroke moves the output by {stroke.formatted()}, but the design does not say at which "
            "voltage; give actuator.voltage_range there, or the gain here"
        )
    return sources
