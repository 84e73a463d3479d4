"""Frequency responses in reports: how far a model misses their lines, in which band, and Bode pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from flexdesign.core import units
from flexdesign.core.serialise import with_unit
from flexdesign.diagnosis.comparison import Breakdown, ResponseComparison, by_band
from flexdesign.diagnosis.result import ModelResiduals, compare_model
from flexdesign.report import comparison_text as words
from flexdesign.report.comparison_text import axis_unit
from flexdesign.report.diagnosis.frequency_charts import Line, measured_bode
from flexdesign.report.document import Figure, Section, Table

#: A model by what it is called, and what it leaves of every frequency response.
FittedModel = tuple[str, Sequence[ResponseComparison]]


def table(stands: Sequence[FittedModel]) -> Table:
    """Return what models leave of every frequency response, relative to its lines."""
    rows = [
        [
            *([name] if len(stands) > 1 else []),
            each.name,
            words.percent(each.rms),
            f"{words.percent(float(each.left.max()))} at {words.limit(_worst(each), 'Hz')}",
            words.percent(each.noise_floor),
            units.significant(each.ratio, 3),
        ]
        for name, responses in stands
        for each in responses
    ]
    known = all(each.known for _, responses in stands for each in responses)
    heads = ["frequency response", "rms error", "largest", "noise" if known else "noise (guess)", "error / noise"]
    caption = "Of the measured line, rms over the lines that judge; the last column line by line over its noise"
    return Table(["model", *heads] if len(stands) > 1 else heads, rows, caption)


def sentences(responses: Sequence[ResponseComparison], natural_frequency: float) -> list[str]:
    """Return by how much a model misses frequency responses, and in which band."""
    text = [
        f"{each.name}: {words.percent(each.rms)} rms of the measured line, "
        f"{units.significant(each.ratio, 3)} times the {'noise' if each.known else 'guessed noise'}."
        for each in responses
    ]
    if all(each.is_noise for each in responses):
        return [*text, "Nothing is above the noise of the lines."]
    bands = by_band(responses)
    if band := bands.dominant():
        near = band[0].lower <= natural_frequency < band[-1].upper
        mode = f", where the main mode is ({units.hertz(natural_frequency)})" if near else ""
        share = words.percent(sum(p.share for p in band))
        text.append(f"The model fails mostly {words.place(bands, band)}{mode}: {share}.")
    return text


def section(stands: Sequence[FittedModel], response: str, natural_frequency: float) -> list[Section]:
    """Return the section on frequency responses; none if there are none.

    Parameters
    ----------
    stands
        Models, and what they leave of each response.
    response
        SI unit of the motion.
    natural_frequency
        Of the main mode [Hz].
    """
    if not stands or not stands[0][1]:
        return []
    named = [(name, sentences(responses, natural_frequency)) for name, responses in stands]
    text = [
        f"{name[:1].upper()}{name[1:]}: {' '.join(message)}" if len(stands) > 1 else " ".join(message)
        for name, message in named
    ]
    remarks = [f"{each.name}: {remark}." for each in stands[0][1] for remark in each.remarks]
    tables = [table(stands), *(_bands(name if len(stands) > 1 else "", by_band(r)) for name, r in stands)]
    return [Section("Frequency responses", [*text, *remarks], tables, figures(stands, response))]


def figures(stands: Sequence[FittedModel], response: str) -> list[Figure]:
    """Draw every frequency response with the prediction of each model."""
    made = []
    for number, each in enumerate(stands[0][1]):
        there = np.isfinite(each.measured)
        unit = axis_unit(response, np.abs(each.measured[there]))
        scale = units.factor(unit, response)
        f = each.frequencies[there]
        lines = [Line("measured", f, each.measured[there] / scale, dots=True)]
        lines += [Line(name, f, responses[number].predicted[there] / scale) for name, responses in stands]
        coherence = None if each.coherence is None else each.coherence[there]
        chart = measured_bode(lines, coherence, f"{words.sign(unit)}/V")
        errors = ", ".join(f"{name} {units.significant(r[number].ratio, 3)}" for name, r in stands)
        made.append(Figure(f"bode_{each.name}.svg", chart, f"{each.name}: error over the noise: {errors}"))
    return made


def result(responses: Sequence[ResponseComparison], response: str) -> list[dict[str, Any]]:
    """Return frequency responses as result.json has them."""
    return [
        {
            "name": each.name,
            "role": each.role,
            "lines": len(each.frequencies),
            "rms_error_of_line": each.rms,
            "largest_error_of_line": float(each.left.max()),
            "largest_error_at": with_unit(_worst(each), "Hz"),
            "noise_of_line": each.noise_floor,
            "noise_is_known": each.known,
            "error_over_noise": each.ratio,
            "unit": f"{response}/V",
            "bands": [
                {"lower": p.lower, "upper": p.upper, "share": p.share, "rms_error_of_line": p.rms}
                for p in by_band([each]).parts
            ],
            "remarks": list(each.remarks),
        }
        for each in responses
    ]


def line_size(residuals: ModelResiduals) -> float:
    """Return the size of the lines that judge, each weighted by its noise as in the error ladder [response/V].

    Errors of the ladder over this are shares of the line, and below one where the model explains anything. NaN where
    runs in time judge.
    """
    if residuals.runs:
        return math.nan
    validation = [each for each in residuals.responses if each.role == "validate"] or residuals.responses
    sizes = [
        each.measured() * residuals.noise.rms[each.name] / residuals.lines[each.name].of_values for each in validation
    ]
    return float(np.sqrt(np.nanmean(np.concatenate(sizes) ** 2)))


def before_and_after(residuals: ModelResiduals) -> dict[str, Any]:
    """Return what the calibrated and the final model leave of frequency responses; nothing if there are none."""
    if not residuals.responses:
        return {}
    si = residuals.before.axes[residuals.axis].response
    calibration, final = (compare_model(residuals, which).responses for which in ("calibrated", "found"))
    both = {"calibrated": result(calibration, si), "final": result(final, si)}
    return {"frequency_responses": both}


def _worst(each: ResponseComparison) -> float:
    return float(each.frequencies[np.argmax(each.left)])


def _bands(name: str, bands: Breakdown) -> Table:
    rows = [
        [words.label(bands, p), words.percent(p.share), words.percent(p.weight), words.percent(p.rms)]
        for p in bands.parts
    ]
    heads = ["band", "of the error", "of the lines", "rms in it"]
    return Table(heads, rows, f"Where the error above the noise lies{', ' + name if name else ''}")
