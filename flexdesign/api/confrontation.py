"""A model and recordings from Python: effects are added and taken out again, numbers are set by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from flexdesign import effects as catalogue
from flexdesign.api.models import read_model
from flexdesign.api.recordings import Recordings, read_recordings
from flexdesign.api.result import Result
from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.diagnosis import add_effect as additions
from flexdesign.diagnosis import confrontation
from flexdesign.diagnosis.add_effect import InTheLoop
from flexdesign.diagnosis.confrontation import Confronted
from flexdesign.diagnosis.result import Value
from flexdesign.dynamics.stage_model import StageModel, edit
from flexdesign.dynamics.stage_model.effect_names import own_effects
from flexdesign.report import comparison_text
from flexdesign.report.diagnosis import addition_report, confrontation_report, diagnosis_text
from flexdesign.report.document import Document

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Traces:
    """Measured against modelled in one run, in the units in which they are read.

    Parameters
    ----------
    run, role
        Of the run.
    time, command, measured, modelled
        n values each [s], [V], [unit], [unit]; NaN where it was not compared.
    residual
        Measured less modelled, n values [fine].
    floor
        Standard deviation of the noise [fine].
    ratio
        Rms residual over that.
    unit, fine
        Units of motion and of residual.
    """

    run: str
    role: str
    time: Array
    command: Array
    measured: Array
    modelled: Array
    residual: Array
    floor: float
    ratio: float
    unit: str
    fine: str


@dataclass(frozen=True)
class EffectOffer:
    """An effect that may be added.

    Parameters
    ----------
    name, called
        Its name, and what it is called in a sentence.
    share
        Of the unexplained misfit that it removes, 0 to 1, before it is fitted to the end; None before that is known.
    physics, remedy
        What it is, and what to do about it.
    """

    name: str
    called: str
    share: float | None
    physics: str
    remedy: str


class Confrontation:
    """A stage model and recordings; `confront` makes one.

    Fits are kept: an effect that was fitted once comes back at once. One method runs at a time, from whatever thread.

    Parameters
    ----------
    model
        The stage model, or what it was read from.
    engine
        What fits.
    """

    def __init__(self, model: str | Path | StageModel, engine: confrontation.Confrontation) -> None:
        self.model, self.engine = model, engine

    def designed(self) -> Confronted:
        """Compare the model as designed with the runs; only their initial conditions are fitted."""
        return self.engine.designed()

    def fit(
        self, effects: Sequence[str] = (), *, roughly: bool = False, progress: Progress = lambda _: None
    ) -> Confronted:
        """Return the model with its own numbers fitted, and with some effects.

        Parameters
        ----------
        effects
            Names of the effects, in the order in which they are added; without any, the model is recalibrated alone.
        roughly
            Whether a rough fit of the last effect will do: a third of the time. What is there already is returned.
        progress
            Receives the progress; what it raises ends the fit.

        Raises
        ------
        InputError
            If an effect cannot be added.
        """
        return self.engine.with_effects(effects, progress, roughly=roughly)

    def offers(self, effects: Sequence[str] = ()) -> tuple[EffectOffer, ...]:
        """Return what may be added in addition to some others, before anything is known of what each explains."""
        return tuple(_offer(name, None) for name in sorted(self.engine.offered(effects)))

    def evidence(self, effects: Sequence[str] = (), *, progress: Progress = lambda _: None) -> tuple[EffectOffer, ...]:
        """Return the effects that may be added to some others, the largest explained share first.

        Parameters
        ----------
        effects
            Names of the effects that the model has.
        progress
            Receives the progress; what it raises ends the search.
        """
        return tuple(_offer(name, share) for name, share in self.engine.evidence(effects, progress).items())

    def simulate(self, effects: Sequence[str], values: Mapping[str, float]) -> Confronted:
        """Return a fitted model with numbers set by hand; nothing is fitted anew.

        Parameters
        ----------
        effects
            Its effects, fitted before.
        values
            Numbers by name, SI: those of `settings`.

        Raises
        ------
        InputError
            If a number is unknown or not finite, or the model grows without bound.
        """
        for name, value in values.items():
            if not np.isfinite(value):
                raise InputError("command line", name, value, "is not finite; give a number")
        return self.engine.simulate(effects, values)

    def traces(self, found: Confronted, run: str) -> Traces:
        """Return measured against modelled in one run; raise KeyError if there is none of this name."""
        runs = {each.name: each for each in found.compared_runs}
        if run not in runs:
            raise KeyError(f"{run}{suggest(run, list(runs))}")
        response = diagnosis_text.response(found)
        its = runs[run]
        # The unit of residuals does not depend on the model, which moves under the axis.
        large, small = (comparison_text.axis_unit(response, each) for each in (its.measured, 10 * its.noise_floor))
        scale, fine = (units.factor(unit, response) for unit in (large, small))
        there = np.where(np.isfinite(its.measured), 1.0, np.nan)
        return Traces(
            run, its.role, its.time, its.command, its.measured / scale, its.predicted * there / scale,
            its.residual / fine, its.noise_floor / fine, its.ratio,
            comparison_text.sign(large), comparison_text.sign(small),
        )  # fmt: skip

    def where(self, found: Confronted) -> list[str]:
        """Return by how much a model misses the runs and where it fails, in sentences."""
        return [*confrontation_report.summary(found), *confrontation_report.where(found)]

    def loop(self, effects: Sequence[str], *, progress: Progress = lambda _: None) -> Result[InTheLoop]:
        """Simulate a closed loop on the stage without effects and with them; the controllers are tuned without.

        Parameters
        ----------
        effects
            Their names.
        progress
            Receives the progress; what it raises ends the simulation.
        """
        without, found = self.fit(progress=progress), self.fit(effects, progress=progress)
        loop = additions.in_the_loop(effects, found.axis, without.model, found.model, progress)
        section = addition_report.loop_section(found.before, found.axis, loop)
        title = f"{found.before.title or found.before.name}: closed loop without and with the effects"
        table = addition_report.loop_table(loop.simulation, found.axis) if loop.simulation else None
        return Result(
            loop,
            Document(title, section.paragraphs, [section]),
            table or confrontation_report.ladder_table(found),
            lambda: {"kind": "loop", "loop": addition_report.loop_json(loop)},
        )

    def result(self, found: Confronted) -> Result[Confronted]:
        """Return a comparison as a result, which prints itself and writes its report and its model.

        A rough fit is carried to its end.
        """
        found = self.fit(found.effects) if found.is_rough else found
        values = self.engine.values(found.effects)
        return Result(
            found,
            confrontation_report.document(found, values),
            confrontation_report.ladder_table(found),
            partial(confrontation_report.result, found, values),
            lambda folder: {"stage_model.toml": self._file(found, values, folder)},
            {run.name: run.rms for run in found.comparison.runs},
        )

    def model_file(self, found: Confronted, folder: Path) -> str:
        """Return the TOML of a model with the uncertainty of its fitted numbers, for a file in a folder.

        A rough fit is carried to its end.
        """
        found = self.fit(found.effects) if found.is_rough else found
        return self._file(found, self.engine.values(found.effects), folder)

    def _file(self, found: Confronted, values: Sequence[Value], folder: Path) -> str:
        better = additions.with_knowledge(found.model, found.axis, values, (*found.runs, *found.responses))
        return edit(self.model, better, folder)

    def ladder(self, found: Confronted) -> list[tuple[str, str, float]]:
        """Return the steps of the error ladder: what it is called, the error as text, and over the noise floor."""
        rows = confrontation_report.ladder_table(found).rows
        ratios = [step.error / found.noise_floor for step in found.error_ladder] + [1.0]
        return [(str(row[0]), str(row[1]), ratio) for row, ratio in zip(rows, ratios, strict=False)]


def _offer(name: str, share: float | None) -> EffectOffer:
    effect = catalogue.find(name)
    return EffectOffer(name, diagnosis_text.effect_name(name), share, effect.physics, effect.remedy)


def confront(
    model: str | Path | StageModel,
    recordings: Recordings,
    changes: Sequence[str] = (),
    *,
    axis: str | None = None,
    effects: Sequence[str] = (),
    noise: str | None = None,
    progress: Progress = lambda _: None,
) -> Confrontation:
    """Confront a stage model with recordings, ready for effects to be added and taken out, and for numbers set by hand.

    Parameters
    ----------
    model
        A stage model, its path or bare name.
    recordings
        Recordings, as `read_recordings` takes them.
    changes
        ``key=value`` of the model.
    axis
        Which axis, where several could be meant.
    effects
        Files with effects of your own, offered with those of the catalogue.
    noise
        Standard deviation of the noise, ``"3 nm"``; estimated without it.
    progress
        Receives the progress; what it raises ends the preparation.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    stage, runs = read_model(model, changes), read_recordings(recordings)
    more = own_effects(effects)
    stated = additions.size(stage, runs, axis, "--noise", noise)
    engine = confrontation.Confrontation(stage, runs, axis=axis, more=more, noise=stated, progress=progress)
    return Confrontation(model, engine)
