"""result.json of a diagnosis: the verdict and everything behind it, every number with its unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core import versions
from flexdesign.core.serialise import header, with_unit
from flexdesign.diagnosis import CandidateRecord, Diagnosis, ErrorStep, IdentifiedEffect, Value
from flexdesign.diagnosis.discriminating_experiments import Proposal
from flexdesign.diagnosis.residual_comparison import ModelResiduals, Which, compared
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report.diagnosis import comparison_report, response_pages
from flexdesign.report.diagnosis import diagnosis_text as prose

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def result(found: Diagnosis, proposals: Sequence[Proposal]) -> dict[str, Any]:
    """Return result.json's content: the verdict and everything behind it, every number with its unit."""
    si = prose.response(found)
    return {
        **header("diagnosis"),
        "axis": found.axis,
        "verdict": found.verdict,
        "effects": [_named(found, named) for named in found.effects],
        "candidates": [_tried(tried, si) for tried in found.candidates],
        "confusable": [list(group) for group in found.confusable],
        "tell_apart": [_proposal(proposal) for proposal in proposals],
        "near": list(found.possible_effects),
        "near_shares": found.possible_effects,
        "ladder": ladder_json(found.error_ladder, si),
        "noise_floor": noise_json(found.noise, found.noise_floor, si),
        "validation_error": _number(found.validation_error, si),
        **({"line_size": _number(response_pages.line_size(found), si)} if not found.runs else {}),
        "remainder": {
            "rms": _number(found.remainder_rms, si),
            "of_stroke": found.remainder_rms / found.stroke if found.stroke else None,
            "over_noise": found.remainder_rms / found.noise_floor if found.noise.known else None,
            "looks_like": found.remainder,
        },
        "tolerance": _number(found.tolerance, si),
        "undetermined": list(found.undetermined),
        "rival": {
            "gain": found.sparse_model.gain,
            "held_gain": found.sparse_model.held_gain,
            "moved": _number(found.sparse_model.validation_rms, si),
            "terms": [
                {"name": name, "amount": _number(coefficient, si), "share": found.sparse_model.shares[name]}
                for name, coefficient in found.sparse_model.terms.items()
            ],
        },
        "where": where_json(found, si),
        **response_pages.before_and_after(found),
        "calibration": [value_json(value) for value in found.calibration],
        "conflicts": list(found.conflicts),
        "confidence": found.confidence,
        "remarks": {each.name: list(each.remarks) for each in _every(found) if each.remarks},
        "made_by": provenance(found),
        "simulations": found.evaluations,
    }


def where_json(found: ModelResiduals, si: str) -> dict[str, Any]:
    """Return the shares of the unexplained error of the calibrated and of the final model."""
    both: tuple[Which, Which] = ("calibrated", "found")
    return {
        ("calibrated" if which == "calibrated" else "final"): [
            comparison_report.breakdown_json(b, si) for b in compared(found, which).where
        ]
        for which in both
    }


def ladder_json(rungs: Sequence[ErrorStep], si: str) -> list[dict[str, Any]]:
    """Return the ladder: label and error of every step."""
    return [{"label": step_of_ladder.label, "error": _number(step_of_ladder.error, si)} for step_of_ladder in rungs]


def noise_json(noise: NoiseFloor, noise_floor: float, si: str) -> dict[str, Any]:
    """Return the noise floor, and where it comes from."""
    return {
        **_number(noise_floor, si),
        "known": noise.known,
        "source": noise.source,
        "relative_error": noise.relative_error,
        "runs": {name: _number(rms, si) for name, rms in noise.rms.items()},
        "lines": [
            {"frequency": _number(line.frequency, "Hz"), "amplitude": _number(line.amplitude, si)}
            for line in noise.lines
        ],
        "remarks": list(noise.remarks),
    }


def value_json(value: Value) -> dict[str, Any]:
    """Return a fitted number with its unit and its 95 % interval."""
    name = value.parameter.name.rpartition(".")[2]
    return {
        "name": name,
        "number": value.parameter.name,
        "value": value.value,
        "unit": value.parameter.si,
        "interval": list(value.interval),
        "text": prose.quantity(value, short=True),
    }


def provenance(found: ModelResiduals) -> dict[str, Any]:
    """Return what made a result: the model, the runs with their roles, versions."""
    return {
        "model": found.before.name,
        "runs": [
            *({"name": run.name, "role": run.role, "samples": len(run.time)} for run in found.runs),
            *({"name": r.name, "role": r.role, "lines": int(r.present.sum())} for r in found.responses),
        ],
        "versions": versions.installed(),
    }


def _every(found: ModelResiduals) -> list[Run | FrequencyResponse]:
    return [*found.runs, *found.responses]


def _number(value: float, si: str) -> dict[str, Any]:
    return with_unit(value, si)


def by_run_json(by_run: Mapping[str, Value]) -> dict[str, Any]:
    """Return the values of a number that differs from run to run, by run."""
    return {run: value_json(value) for run, value in by_run.items()}


def _named(found: Diagnosis, named: IdentifiedEffect) -> dict[str, Any]:
    effect = effects.find(named.name)
    return {
        "name": effect.name if named.name.endswith(".py") else named.name,
        "parameters": [value_json(value) for value in named.values],
        "by_run": by_run_json(named.by_run),
        "share": named.share,
        "remedy": prose.remedy(found, named.name),
    }


def _tried(tried: CandidateRecord, si: str) -> dict[str, Any]:
    return {
        "effects": list(tried.names),
        "beside": list(tried.present),
        "error": _number(tried.error, si),
        "evidence": tried.evidence,
        "outcome": tried.outcome,
    }


def _proposal(proposal: Proposal) -> dict[str, Any]:
    return {
        "group": list(proposal.group),
        "pairs": [
            {
                "effects": [effect.name for effect in resolved.effects],
                "experiments": [
                    {"name": each.command.name, "by_hand": each.command.note or None, "over_noise": each.over_noise}
                    for each in resolved.proposed
                ],
            }
            for resolved in proposal.resolved
        ],
        "reason": proposal.reason or None,
    }
