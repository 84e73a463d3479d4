"""Identification: free parameters of one axis of a stage model, fitted to recorded runs, and their identifiability.

A stated uncertainty is a prior; an assumed number has none. Parameters that the runs do not determine are held at their
old values, one by one from the last in the list, and the others are fitted again, so that the written model matches the
runs with the values in it. If an old value contradicts the runs, the parameter is held at its best fit and marked as
assumed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign import effects, estimation
from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.core.model import parameter_of
from flexdesign.diagnosis.comparison.compare import RunComparison, compare_run
from flexdesign.dynamics.axis.axis_choice import choose_axis, require_parameters
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import DELAY, HYSTERESIS_PARAMETERS, LINEAR_PARAMETERS
from flexdesign.dynamics.axis.axis_run import doubts, noise_of_axis, of_axis
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation import Estimate, Fit, Starts
from flexdesign.estimation.criterion import is_worse
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.recordings import Run


@dataclass(frozen=True, eq=False)
class Identification:
    """A fitted stage model with its estimates, fits and runs.

    Parameters
    ----------
    before, model
        The stage model as it was, and fitted.
    axis
        The axis that was identified.
    estimates
        The verdict on each parameter, in the order asked for. Where some are held, intervals hold for their values.
    held, contradicted
        Values at which parameters are held that the runs do not determine, SI; and the names of those among them whose
        old values the runs contradict, so that the values are those of the best fit.
    known
        Prior knowledge, value and standard deviation, SI.
    fit
        The last fit, of the determined parameters; None if there are none.
    starts
        How the starts of the first fit ended, of all that were asked for.
    runs
        All runs, those for validation among them.
    before_errors
        Root mean square error of the model as it was, by run [response].
    evaluations
        Number of simulations.
    noise
        The noise of the runs, measured where the command is at rest or repeats.
    doubts
        Doubts about the units of runs, in sentences.
    """

    before: StageModel
    model: StageModel
    axis: str
    estimates: tuple[Estimate, ...]
    held: Mapping[str, float]
    contradicted: tuple[str, ...]
    known: Mapping[str, tuple[float, float]]
    fit: Fit | None
    starts: Starts
    runs: tuple[RunComparison, ...]
    before_errors: Mapping[str, float]
    evaluations: int
    noise: NoiseFloor
    doubts: tuple[str, ...] = ()

    @property
    def misfit(self) -> float:
        """The residual of the fitted runs over their noise, a ratio of rms values."""
        return misfit(self.runs)[0]

    @property
    def is_incomplete(self) -> bool:
        """Whether the residual is larger than the noise explains, so that the model lacks physics."""
        return exceeds_noise(self.runs, self.noise)

    @property
    def response(self) -> str:
        """Units of the response."""
        return self.before.axes[self.axis].response_units


def identify(
    model: StageModel,
    runs: Sequence[Run],
    *,
    axis: str | None = None,
    free: Sequence[str] | None = None,
    starts: int = 8,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Fit free parameters of one axis to the runs of role ``identify``, and predict all.

    Parameters
    ----------
    model, runs
        The model, from whose values the fit begins, and the runs.
    axis
        May be left out where model and runs leave no choice.
    free
        Names of numbers, as in `AxisModel.numbers`, or ``controller.delay``; by default gain, damping ratio and
        natural frequency, with a, b, c and rest of a Bouc-Wen hysteresis where the model has one.
    starts, progress
        How many starts the fit may follow; and what receives the progress.

    Raises
    ------
    InputError
        If the axis is ambiguous or unknown, a run lacks its command or response or has it in another unit, a free
        number is unknown, or no run may be fitted.
    """
    name = choose_axis(model, runs, axis)
    seen = tuple(_with_remark(of_axis(run, name, model.axes[name]), name) for run in runs)
    if not any(run.role == "identify" for run in seen):
        remedy = "all are kept for validation or testing; name a run with role identify"
        raise InputError("command line", "RUNS", None, remedy)
    max_command = max(float(np.abs(run.command()).max()) for run in seen) or 1.0
    start = AxisDynamics(name, model.axes[name], max_command, delay=model.controller.delay)
    default = LINEAR_PARAMETERS + (HYSTERESIS_PARAMETERS if "bouc_wen" in start.axis.effects else ())
    asked = default if free is None else require_parameters(start, free)
    observed = [start.comparable(run) for run in seen]
    search = _Search(start, [run for run in observed if run.role == "identify"], asked, starts, progress)
    progress("predicting all runs")
    dynamics, noise = search.dynamics, noise_of_axis(runs, name, model.axes[name])
    matches = tuple(compare_run(dynamics, run, noise.rms[run.name]) for run in seen)
    estimates = [_with_advice(search.verdicts[name]) for name in asked]
    if exceeds_noise(matches, noise):  # an interval would count the noise, but not the physics that the model lacks
        estimates = [replace(e, sigma=None, interval=None, reason="") if e.determined else e for e in estimates]
    certain = {each.name: each.sigma for each in estimates if each.sigma is not None}
    fitted_runs = [match.name for match in matches if match.role == "identify"]
    axes = {**model.axes, name: _update(model.axes[name], search, certain, fitted_runs)}
    return Identification(
        before=model,
        model=replace(model, axes=axes, controller=replace(model.controller, delay=dynamics.delay)),
        axis=name,
        estimates=tuple(estimates),
        held=search.held,
        contradicted=tuple(search.contradicted),
        known=search.known,
        fit=search.last,
        starts=search.starts,
        runs=matches,
        before_errors={run.name: compare_run(start, run, noise.rms[run.name]).rms for run in observed},
        evaluations=search.evaluations,
        noise=noise,
        doubts=tuple(doubts(seen)),
    )


def _with_remark(run: Run, axis: str) -> Run:
    """Return a run that says so if it was recorded in a closed loop."""
    if not (run.closed_loop or {"r", f"r{axis}"} & {*run.columns}):
        return run
    in_a_loop = "recorded with a reference: in a closed loop the command carries sensor noise, which biases a fit"
    return replace(run, remarks=(*run.remarks, in_a_loop))


def _with_advice(estimate: Estimate) -> Estimate:
    """Return an estimate that names the experiment which would show the parameter of an effect, if it is not shown."""
    owner = estimate.name.partition(".")[0]
    if estimate.determined or owner not in effects.names():
        return estimate
    return replace(estimate, reason=f"{estimate.reason}; would show it: {effects.find(owner).reveal}")


def misfit(matches: Sequence[RunComparison]) -> tuple[float, int]:
    """Return the residual of the fitted runs over their noise, a ratio of rms values, and the number of samples."""
    fitted = [match for match in matches if match.role == "identify"]
    counts = [int(np.isfinite(match.measured).sum()) for match in fitted]
    return math.sqrt(np.average([match.ratio**2 for match in fitted], weights=counts)), sum(counts)


def exceeds_noise(matches: Sequence[RunComparison], noise: NoiseFloor) -> bool:
    """Tell whether the residual of the fitted runs is larger than their noise explains; never for a guessed noise."""
    ratio, count = misfit(matches)
    return noise.known and ratio**2 - 1 > noise.allowed_excess(count)


class _Search:
    """The fits of an identification: undetermined parameters are held until all free ones are determined."""

    def __init__(
        self,
        start: AxisDynamics,
        runs: Sequence[Run],
        asked: Sequence[str],
        starts: int,
        progress: Callable[[str], None],
    ) -> None:
        self.start, self.runs, self.asked, self.progress = start, runs, tuple(asked), progress
        self.known = start.axis.prior(asked)
        self.held: dict[str, float] = {}
        self.contradicted: list[str] = []
        self.evaluations = 0
        # Simulations of 1e-5 of the span determine the best minimum: they are faster, and still below any noise.
        self.dynamics = start
        self.starts = self._fit(self.asked, starts, coarser=100.0).starts
        progress("fitting from the best minimum, and checking the intervals")
        self.last: Fit | None = self._fit(self.asked)
        self.verdicts: dict[str, Estimate] = {}  # of a parameter that is held the first one stays
        while self.last is not None and self.last.undetermined:
            self.verdicts = {name: self.last[name] for name in self.last.undetermined} | self.verdicts
            self.last = self._without(self.last.undetermined[-1], self.last)
        self.verdicts |= {estimate.name: estimate for estimate in self.last.estimates} if self.last else {}

    def _without(self, name: str, best: Fit) -> Fit | None:
        """Hold a parameter, at its old value if the runs allow it, and fit the others; None if there are none."""
        others = [estimate.name for estimate in best.estimates if estimate.name != name]
        dynamics = self.dynamics
        for which, model in {"old": self.start, "best": dynamics}.items():
            value = parameter_of(model, name).start or 0.0  # what the model does not say is as in the catalogue
            self.dynamics = dynamics.replace({name: value})
            self.held[name] = value
            self.progress(f"{name} is held at its {which} value; fitting the others again")
            found = self._fit(others) if others else None
            rms = found.rms if found else [compare_run(self.dynamics, run, 1.0).rms for run in self.runs]
            if not any(map(is_worse, rms, best.rms)):
                break
            if which == "old":
                self.contradicted.append(name)
        return found

    def _fit(self, free: Sequence[str], starts: int = 1, coarser: float = 1.0) -> Fit:
        """Fit parameters from the present values, with simulations that are coarser by a factor."""
        found = estimation.fit(
            self.dynamics.refined(coarser * self.start.tolerance),
            self.runs,
            free,
            known=self.known,
            starts=starts,
            progress=self.progress if starts > 1 else lambda _: None,
        )
        assert isinstance(found.model, AxisDynamics)
        self.dynamics = found.model
        self.evaluations += found.evaluations
        return found


def _update(axis: AxisModel, search: _Search, sigmas: Mapping[str, float], runs: Sequence[str]) -> AxisModel:
    """Return the fitted axis with the uncertainties and sources of its numbers."""
    values = {name: v for name, v in search.last.values.items() if name != DELAY} if search.last else {}
    relative = {name: sigmas[name] / abs(v) if v and name in sigmas else math.inf for name, v in values.items()}
    known = known_axis(axis, relative, runs)
    guessed = [name for name in search.contradicted if name != DELAY]
    uncertainty = {name: sigma for name, sigma in known.uncertainty.items() if name not in guessed}
    sources = {**known.sources, **dict.fromkeys(guessed, f"suits {listed_runs(runs)}, as other values do")}
    assumed = tuple(dict.fromkeys([*known.assumed, *guessed]))
    return replace(search.dynamics.axis, uncertainty=uncertainty, assumed=assumed, fitted=(), sources=sources)


def known_axis(axis: AxisModel, relative: Mapping[str, float], runs: Sequence[str]) -> AxisModel:
    """Return an axis with the uncertainties and sources of its fitted numbers."""
    uncertainty = {name: sigma for name, sigma in axis.uncertainty.items() if name not in relative}
    uncertainty |= {name: _round(sigma) for name, sigma in relative.items() if 0 < sigma < 100}
    sources = dict(axis.sources) | dict.fromkeys(relative, f"identified from {listed_runs(runs)}")
    if axis.stiffness is not None and math.isfinite(sigma := relative.get("natural_frequency", math.inf)):
        sources["mass"] = "from the identified natural frequency and the stiffness"
        uncertainty.pop("mass", None)
        if "stiffness" in axis.uncertainty:
            uncertainty["mass"] = _round(math.hypot(axis.uncertainty["stiffness"], 2 * sigma))
    assumed = axis.still_assumed(list(relative))
    return replace(axis, uncertainty=uncertainty, sources=sources, assumed=assumed, fitted=())


def listed_runs(names: Sequence[str]) -> str:
    """Return the names of runs as a source has them: no more than four."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _round(relative: float) -> float:
    """Return two digits, as they come back from a file that has them in percent."""
    return float(f"{100 * relative:.2g}") * units.factor("%", "1")
