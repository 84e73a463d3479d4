"""The report and its numbers. Every number of ours is computed; the published ones stand in `PUBLISHED`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexdesign import __version__
from flexdesign.core.serialise import header
from flexdesign.diagnosis import Diagnosis
from flexdesign.report.document import Document, Section, Table
from studies.steering_mirror.findings import LINEAR, MODAL, Findings
from studies.steering_mirror.recordings import BAND, JUDGING, LEVELS, SHOWN, TEACHING

#: Percent of the outputs that published models leave of these recordings, per level, mean over channels: one linear
#: state-space model of order 28 and one with a neural network in feedback, both taught by other realisations at all
#: levels (M. Floren, Baseline models for the Fine Steering Mirror benchmark dataset, 2026,
#: doi:10.5281/zenodo.19591136).
PUBLISHED = {"published, linear": (18.61, 6.61, 16.28), "published, nonlinear": (6.37, 4.84, 4.19)}
#: How the tables call the stands.
TITLES = {
    "linear": "one linear response",
    "linear per level": "one for each level",
    "calibrated": "modes as calibrated",
    "found": "modes with effects",
}


def document(findings: Findings) -> Document:
    """Return the report."""
    return Document(
        "Fine steering mirror: single axes of a stage whose inputs all act at once",
        _summary(findings),
        [_outputs(findings), _modes(findings), _verdicts(findings)],
    )


def of(findings: Findings) -> dict[str, Any]:
    """Return result.json's content: every number with its unit."""
    modes = findings.decoupled.modes
    return {
        **header("study"),
        "left": {
            "unit": "1",
            **{
                fit: {f"{level} mV": [float(value) for value in left] for level, left in by_level.items()}
                for fit, by_level in findings.residuals.items()
            },
        },
        "published": {
            "unit": "%",
            **{name: dict(zip(_levels(), values, strict=True)) for name, values in PUBLISHED.items()},
        },
        "delay": {"value": modes.delay, "unit": "s"},
        "axes": {
            axis: {
                "natural_frequency": {"value": float(modes.frequencies[m]), "unit": "Hz"},
                "damping_ratio": float(modes.damping_ratios[m]),
                "gain": {"value": float(modes.gains[m]), "unit": "m/V"},
                "shape": modes.shapes[:, m].tolist(),
                "drive": modes.drives[:, m].tolist(),
                "purity": float(modes.purity[m]),
                "verdict": found.verdict,
                "effects": _names(found),
                "left": {
                    "unit": "1",
                    **{fit: [own[axis][level] for level in LEVELS] for fit, own in findings.own.items()},
                },
                "noise_floor": {"value": found.noise_floor, "unit": "m"},
                "seconds": round(found.seconds, 1),
            }
            for m, (axis, found) in enumerate(findings.diagnoses.items())
        },
        "made_by": {"study": "studies.steering_mirror", "flexdesign": __version__},
    }


def _summary(findings: Findings) -> list[str]:
    means = {fit: _percents([float(np.mean(left[level])) for level in LEVELS]) for fit, left in _lefts(findings)}
    published = {name: _percents([value / 100 for value in values]) for name, values in PUBLISHED.items()}
    verdicts = "; ".join(f"{axis} {found.verdict}" for axis, found in findings.diagnoses.items())
    return [
        f"Percent of the outputs left at {', '.join(_levels())}, mean over channels: one linear response "
        f"{means['linear']}, modal axes as calibrated {means['calibrated']}, with the effects tried last "
        f"{means['found']}. Published: one linear model {published['published, linear']}, one nonlinear "
        f"{published['published, nonlinear']}.",
        f"Verdicts: {verdicts}.",
        f"A linear response for each level by itself leaves {means['linear per level']}: so far does it reach to know "
        "how each level answers.",
    ]


def _outputs(findings: Findings) -> Section:
    rows = []
    for fit, left in _lefts(findings):
        for level in LEVELS:
            cells = _cells(left[level])
            rows.append([TITLES[fit], f"{level} mV", *cells, f"{100 * np.mean(left[level]):.1f}"])
    for name, values in PUBLISHED.items():
        rows += [[name, level, "–", "–", "–", f"{value:.1f}"] for level, value in zip(_levels(), values, strict=True)]
    text = [
        f"Of realisation {JUDGING + 1} at each level, for validation; the linear response is estimated from "
        f"realisations {' and '.join(str(r + 1) for r in TEACHING)} of all levels, the diagnoses are shown half a "
        f"period of realisation {SHOWN + 1}. All but the modes is this linear response, in all fits. The "
        "published models were taught by other realisations, which are not used here, and judged on all three of "
        "these.",
        "A linear response is estimated with equal weight for all levels; a calibration fits metres, so that the "
        "largest level weighs most. Offsets and what rings as a record begins are fitted, too, and removed from "
        "the residual.",
    ]
    caption = "Root mean square of the residual, in percent of the standard deviation of the output"
    head = ["stand", "level", "channel 1", "channel 2", "channel 3", "mean"]
    return Section("Residual of the outputs", text, [Table(head, rows, caption)])


def _modes(findings: Findings) -> Section:
    modes = findings.decoupled.modes
    rows = [
        [
            axis,
            f"{modes.frequencies[m]:.1f} Hz",
            f"{modes.damping_ratios[m]:.4f}",
            f"{1e6 * modes.gains[m]:.3f} um/V",
            ", ".join(f"{value:.2f}" for value in modes.shapes[:, m]),
            ", ".join(f"{value:.2f}" for value in modes.drives[:, m]),
            f"{modes.purity[m]:.5f}",
        ]
        for m, axis in enumerate(findings.diagnoses)
    ]
    text = [
        f"Fitted to the linear response from {BAND[0]:g} Hz to {BAND[1]:g} Hz, with a common delay of "
        f"{1e6 * modes.delay:.1f} us. A purity of one says that a residue has rank one: that the mode moves in one "
        "shape and is driven by one combination of the inputs.",
    ]
    head = ["axis", "natural frequency", "damping ratio", "gain", "shape", "drive", "purity"]
    return Section("The modal axes", text, [Table(head, rows)])


def _verdicts(findings: Findings) -> Section:
    rows = []
    for axis, found in findings.diagnoses.items():
        calibrated, with_effects = ([own[axis][level] for level in LEVELS] for own in findings.own.values())
        floor = f"{1e9 * found.noise_floor:.3g} nm"
        rows.append(
            [axis, found.verdict, _names(found), _percents(calibrated), _percents(with_effects), floor, found.remainder]
        )
    head = ["axis", "verdict", "effects", "calibrated, left %", "with effects, left %", "noise", "the residual"]
    caption = f"Modal coordinates at {', '.join(_levels())}; effects of an unknown verdict come near and are not named"
    return Section("What each axis' diagnosis says", (), [Table(head, rows, caption)])


def _lefts(findings: Findings) -> list[tuple[str, Any]]:
    return [(fit, findings.residuals[fit]) for fit in LINEAR + MODAL]


def _names(found: Diagnosis) -> str:
    return ", ".join(effect.name for effect in found.effects) or ", ".join(found.possible_effects) or "–"


def _levels() -> list[str]:
    return [f"{level} mV" for level in LEVELS]


def _cells(values: Any) -> list[str]:
    return [f"{100 * value:.1f}" for value in values]


def _percents(values: Sequence[float]) -> str:
    return " / ".join(_cells(values))
