"""Variations of a model and of recordings that must not change the answer.

A user knows gain, frequency and damping roughly, and begins and ends a record at any sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flexdesign.diagnosis import Diagnosis
from flexdesign.dynamics.axis.axis_parameters import with_values
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report import comparison_text as words
from flexdesign.report.diagnosis import diagnosis_text as said

Recordings = Sequence[Run | FrequencyResponse]
HEADS = ("recording", "variation", "verdict", "named", "not distinguished", "error")


@dataclass(frozen=True)
class Variation:
    """A change of a number of the model, or of the length of the runs.

    Parameters
    ----------
    number, factor
        Number of each axis, and what it is multiplied by; empty if none is changed.
    first, last
        Samples that are cut off at the beginning and at the end of each run.
    """

    number: str = ""
    factor: float = 1.0
    first: int = 0
    last: int = 0

    def __str__(self) -> str:
        """Say what is changed."""
        if self.number:
            return f"{self.number.replace('_', ' ')} x {self.factor:g}"
        if self.first or self.last:
            return f"without the {'first' if self.first else 'last'} {self.first or self.last} samples"
        return "none"

    def of_model(self, model: StageModel) -> StageModel:
        """Return the model with the change."""
        if not self.number:
            return model
        axes = {n: with_values(a, {self.number: self.factor * a.numbers[self.number]}) for n, a in model.axes.items()}
        return replace(model, axes=axes)

    def of_recordings(self, recorded: Recordings) -> Recordings:
        """Return the recordings with the change; frequency responses stay."""
        return [self._of_run(each) if isinstance(each, Run) else each for each in recorded]

    def _of_run(self, run: Run) -> Run:
        part = slice(self.first, len(run.time) - self.last)
        return replace(run, time=run.time[part], columns={name: values[part] for name, values in run.columns.items()})


#: The first is none.
VARIATIONS = (
    Variation(),
    *(Variation("gain", factor) for factor in (0.9, 1.1)),
    *(Variation("natural_frequency", factor) for factor in (0.95, 1.05)),
    *(Variation("damping_ratio", factor) for factor in (0.5, 2.0)),
    *(Variation(first=samples) for samples in (3, 10, 25)),
    Variation(last=10),
)


def row(title: str, variation: Variation, found: Diagnosis) -> tuple[str, ...]:
    """Return what was said of a recording with a variation, and the error on validation runs, rms."""
    named = ", ".join(said.effect_name(each.name) for each in found.effects) or "–"
    alike = "; ".join(", ".join(said.effect_name(name) for name in group) for group in found.confusable) or "–"
    error = words.error(said.response(found), found.error_ladder[-1].error)
    return title, str(variation), found.verdict, named, alike, error
