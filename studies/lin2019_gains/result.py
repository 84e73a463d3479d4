"""The study's result.json: every number with its unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from flexdesign import __version__
from flexdesign.core.serialise import header
from flexdesign.dynamics.control import PID
from studies.lin2019_gains.findings import Candidate, Findings
from studies.lin2019_gains.printed import PRINTED, Axis, damping_bound, frequency_bound


def of(findings: Sequence[Findings]) -> dict[str, Any]:
    """Return result.json's content: every number with its unit."""
    return {
        **header("study"),
        "printed": {key: sourced._asdict() for key, sourced in PRINTED.items()},
        "axes": {found.axis.name: _axis_result(found) for found in findings},
        "made_by": {"study": "studies.lin2019_gains", "flexdesign": __version__},
    }


def _axis_result(found: Findings) -> dict[str, Any]:
    axis = found.axis
    return {
        "natural_frequency": _value(axis.model.natural_frequency, "Hz"),
        "damping_ratio": axis.model.damping_ratio,
        "mass": _value(axis.mass, "kg"),
        "amplification": axis.amplifications(),
        "ziegler_nichols_on_eq_31": _gains(found.recomputed) | {"stable": found.recomputed_margins.stable},
        "lowest_natural_frequency": _value(frequency_bound(axis), "Hz"),
        "largest_damping_ratio": damping_bound(axis),
        "longest_stable_delay": _value(found.limit.delay, "s"),
        "telling_phase": _value(found.comparison.largest_phase_difference, "deg")
        | {"frequency": _value(found.comparison.best_frequency, "Hz")},
        "candidates": [_candidate_result(axis, candidate) for candidate in found.candidates],
        "family": [
            {
                "delay": _value(p.delay, "s"),
                "natural_frequency": _value(p.natural_frequency, "Hz"),
                "damping_ratio": p.damping_ratio,
            }
            for p in found.family
        ],
        "experiments": [
            {
                "plant": one.label,
                "ultimate_gain": {"experiment": one.measured.gain, "analytic": one.exact.gain},
                "ultimate_period": {"experiment": one.measured.period, "analytic": one.exact.period, "unit": "s"},
            }
            for one in found.experiments
        ],
    }


def _candidate_result(axis: Axis, candidate: Candidate) -> dict[str, Any]:
    plant, (frequency, damping) = candidate.plant, candidate.rounding
    steps = {"open_loop": candidate.alone, "printed_gains": candidate.printed, "our_gains": candidate.ours}
    return {
        "label": candidate.label,
        "natural_frequency": _value(plant.natural_frequency, "Hz") | {"rounding": frequency},
        "damping_ratio": {"value": plant.damping_ratio, "rounding": damping},
        "delay": _value(plant.delay, "s"),
        "mass": _value(axis.mass_of(plant), "kg"),
        "printed_gains_stable": candidate.margins.stable,
        "settling": {name: _value(step.settling, "s") for name, step in steps.items() if step},
        "overshoot": {name: step.overshoot for name, step in steps.items() if step},
        "our_gains": _gains(candidate.tuning.pid) if candidate.tuning else None,
    }


def _value(value: float, unit: str) -> dict[str, Any]:
    return {"value": value if math.isfinite(value) else None, "unit": unit}


def _gains(pid: PID) -> dict[str, Any]:
    return {"kp": pid.kp, "ti": _value(pid.ti, "s"), "td": _value(pid.td, "s")}
