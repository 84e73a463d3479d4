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
from flexdesign.diagnosis.experiment_design.discrimination import Proposal
from flexdesign.diagnosis.result import ModelResiduals, Which, compare_model
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report.diagnosis import comparison_report, response_pages
from flexdesign.report.diagnosis import diagnosis_text as prose

Flags = NDArray[np.bool_]


def result(diagnosis: Diagnosis, proposals: Sequence[Proposal]) -> dict[str, Any]:
    """Return result.json's content: the verdict and everything behind it, every number with its unit."""
    si = prose.response(diagnosis)
    return {
        **header("diagnosis"),
        "axis": diagnosis.axis,
        "verdict": diagnosis.verdict,
        "effects": [_identified_effect(diagnosis, named) for named in diagnosis.effects],
        "candidates": [_candidate(tried, si) for tried in diagnosis.candidates],
        "confusable": [list(group) for group in diagnosis.confusable],
        "tell_apart": [_proposal(proposal) for proposal in proposals],
        "near": list(diagnosis.possible_effects),
        "near_shares": diagnosis.possible_effects,
        "ladder": ladder_json(diagnosis.error_ladder, si),
        "noise_floor": noise_json(diagnosis.noise, diagnosis.noise_floor, si),
        "validation_error": _number(diagnosis.error, si),
        **({"line_size": _number(response_pages.line_size(diagnosis), si)} if not diagnosis.runs else {}),
        "remainder": {
            "rms": _number(diagnosis.remainder_rms, si),
            "of_stroke": diagnosis.remainder_rms / diagnosis.stroke if diagnosis.stroke else None,
            "over_noise": diagnosis.remainder_rms / diagnosis.noise_floor if diagnosis.noise.known else None,
            "looks_like": diagnosis.remainder,
        },
        "tolerance": _number(diagnosis.tolerance, si),
        "undetermined": list(diagnosis.undetermined),
        "rival": {
            "gain": diagnosis.sparse_model.gain,
            "held_gain": diagnosis.sparse_model.held_gain,
            "moved": _number(diagnosis.sparse_model.validation_rms, si),
            "terms": [
                {"name": name, "amount": _number(coefficient, si), "share": diagnosis.sparse_model.shares[name]}
                for name, coefficient in diagnosis.sparse_model.terms.items()
            ],
        },
        "where": where_json(diagnosis, si),
        **response_pages.before_and_after(diagnosis),
        "calibration": [value_json(value) for value in diagnosis.calibration],
        "conflicts": list(diagnosis.conflicts),
        "confidence": diagnosis.confidence,
        "remarks": {each.name: list(each.remarks) for each in _every(diagnosis) if each.remarks},
        "made_by": provenance(diagnosis),
        "simulations": diagnosis.evaluations,
    }


def where_json(residuals: ModelResiduals, si: str) -> dict[str, Any]:
    """Return the shares of the unexplained error of the calibrated and of the final model."""
    both: tuple[Which, Which] = ("calibrated", "found")
    return {
        ("calibrated" if which == "calibrated" else "final"): [
            comparison_report.breakdown_json(b, si) for b in compare_model(residuals, which).where
        ]
        for which in both
    }


def ladder_json(steps: Sequence[ErrorStep], si: str) -> list[dict[str, Any]]:
    """Return the ladder: label and error of every step."""
    return [{"label": step_of_ladder.label, "error": _number(step_of_ladder.error, si)} for step_of_ladder in steps]


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


def provenance(residuals: ModelResiduals) -> dict[str, Any]:
    """Return what made a result: the model, the runs with their roles, versions."""
    return {
        "model": residuals.before.name,
        "runs": [
            *({"name": run.name, "role": run.role, "samples": len(run.time)} for run in residuals.runs),
            *({"name": r.name, "role": r.role, "lines": int(r.present.sum())} for r in residuals.responses),
        ],
        "versions": versions.installed(),
    }


def _every(residuals: ModelResiduals) -> list[Run | FrequencyResponse]:
    return [*residuals.runs, *residuals.responses]


def _number(value: float, si: str) -> dict[str, Any]:
    return with_unit(value, si)


def by_run_json(by_run: Mapping[str, Value]) -> dict[str, Any]:
    """Return the values of a number that differs from run to run, by run."""
    return {run: value_json(value) for run, value in by_run.items()}


def _identified_effect(diagnosis: Diagnosis, named: IdentifiedEffect) -> dict[str, Any]:
    effect = effects.find(named.name)
    return {
        "name": effect.name if named.name.endswith(".py") else named.name,
        "parameters": [value_json(value) for value in named.values],
        "by_run": by_run_json(named.by_run),
        "share": named.share,
        "remedy": prose.remedy(diagnosis, named.name),
    }


def _candidate(tried: CandidateRecord, si: str) -> dict[str, Any]:
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
