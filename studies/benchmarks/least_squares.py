"""Marquardt's method of `estimation.least_squares` and SciPy's trust-region method, on the same problems::

    python -m studies.benchmarks.least_squares              # trial, loops and formulas: three minutes
    python -m studies.benchmarks.least_squares 20004 20101  # these cases of `studies.hidden_effect_trial` only

Of every case the calibration is solved, and the fit with the hidden effect; and a play operator with unknown initial
states, which has kinks and many local minima, in twenty runs. Both methods begin at the same point, have
the same bounds and the same Jacobian, found by the same differences record by record, and stop where a step lowers the
cost by the same share. SciPy's is `least_squares` with `method="trf"`, coordinates scaled by the Jacobian. A simulation
is one of all fitted runs. Every solver runs twice, in turn, in one process; the shorter processor time counts.

Fits are made as the diagnosis makes them: to the end, with a Jacobian found there for the intervals; and roughly, as
most of its fits are, which begin with the Jacobian of the calibration and need none at the end.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import geometric_mean
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexdesign.core.model import Model
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    case_of,
    find_undetermined,
    simulating,
    with_calibrated_conditions,
)
from flexdesign.diagnosis.preparation.dataset import prepare
from flexdesign.diagnosis.preparation.spectra import line_frequencies
from flexdesign.diagnosis.procedure import calibrate, grid_delay, grid_frequency
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import reading
from flexdesign.estimation.least_squares import levenberg_marquardt
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import (
    FULL,
    INEXACT,
    SMALL_REDUCTION,
    Columns,
    Effort,
)
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import fit_model
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from flexdesign.measurements import recordings
from flexdesign.report import render
from flexdesign.report.document import Document, Section, Table
from flexdesign.report.terminal import plain
from studies.hidden_effect_trial import cases, folder
from tests.estimation import play_problems
from tests.estimation.toys import OSCILLATION, TRUTH, Toy, ar1, parameter, run

Array = NDArray[np.float64]
#: Cases of the trial, each of another kind of effect: friction and loops, lags, statics, slow ones, and none.
CASES = (10002, 10010, 20004, 20101, 20300, 20502, 20800, 21101, 21403, 21802, 22101)
#: Costs differ where they do by more than a step that no solver need take, and by this share.
SAME = 1e-3
#: How often each solver runs.
REPEATS = 2
#: SciPy's own test of steps stays out of the way: both methods are to end by what a step gains.
TIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class Task:
    """A problem to be solved.

    Parameters
    ----------
    name
        What it is.
    make
        Returns the problem, its count of simulations at zero.
    old
        Columns of a Jacobian that are known before.
    """

    name: str
    make: Callable[[], Problem]
    old: Columns = field(default_factory=dict)


@dataclass(frozen=True)
class FitSettings:
    """How a fit is made.

    Parameters
    ----------
    effort
        When it ends.
    begins
        Whether the Jacobian of the calibration serves at the start.
    """

    effort: Effort
    begins: bool


@dataclass(frozen=True)
class SolverOutcome:
    """Where a solver ended.

    Parameters
    ----------
    cost
        Sum of squares.
    simulations
        Of all fitted runs.
    seconds
        Time.
    """

    cost: float
    simulations: float
    seconds: float


# --- the solvers ----------------------------------------------------------------------------------------------------


def solve_own(problem: Problem, manner: FitSettings, old: Columns) -> float:
    """Return the cost that the package's own method reaches."""
    found = levenberg_marquardt.solve(problem, problem.where.start, manner.effort, old or None)
    return math.inf if found is None else found.cost


def solve_scipy(problem: Problem, manner: FitSettings, old: Columns) -> float:
    """Return the cost that SciPy's method reaches; its last Jacobian is that of where it ends."""
    where, places = problem.where, problem.places
    rows = [record.rows for record in problem.dataset.records]
    last, known = dict[bytes, list[Array] | None](), [old]

    def residuals(x: Array) -> Array:
        last.clear()
        last[x.tobytes()] = parts = problem.residuals(x)
        # A point at which the model fails is no step for SciPy.
        return np.concatenate([*(parts or [np.full(n, np.nan) for n in rows]), problem.prior_residual(x)])

    def jacobian(x: Array) -> Array:
        parts = last.get(x.tobytes()) or problem.residuals(x)
        assert parts is not None  # SciPy takes no step to where it is
        jacobian = problem.jacobian(x, parts, known.pop() if known else None)
        problem.symmetrise(jacobian)
        blocks = [np.zeros((n, len(x))) for n in rows]
        for block, columns, part in zip(blocks, places, jacobian, strict=True):
            block[:, columns] = part.matrix
        return np.vstack([*blocks, problem.prior_jacobian(x)])

    ends = max(manner.effort.share, SMALL_REDUCTION / problem.dataset.samples)
    bounds = (where.lower, where.upper)
    found = least_squares(
        residuals, where.start, jacobian, bounds, "trf", x_scale="jac", ftol=ends, xtol=TIGHT, gtol=TIGHT
    )
    return float(2.0 * found.cost)


SOLVERS: dict[str, Callable[[Problem, FitSettings, Columns], float]] = {"own": solve_own, "SciPy": solve_scipy}
MANNERS = {"to the end": FitSettings(FULL, False), "roughly": FitSettings(INEXACT, True)}


def compare_solvers(task: Task, manner: FitSettings) -> dict[str, SolverOutcome]:
    """Return where each solver ends."""
    found = dict[str, SolverOutcome]()
    for _ in range(REPEATS):
        for name, solver in SOLVERS.items():
            problem = task.make()
            began = time.process_time()
            cost = solver(problem, manner, task.old if manner.begins else {})
            seconds = time.process_time() - began
            before = found[name].seconds if name in found else math.inf
            simulations = problem.evaluations / len(problem.dataset.records)
            found[name] = SolverOutcome(cost, simulations, min(seconds, before))
    return found


# --- the problems ---------------------------------------------------------------------------------------------------


def tasks_of_case(number: int, seed: int) -> Iterator[Task]:
    """Yield the calibration of a case of the trial, and the fit with what is hidden, if a fit can show it."""
    with tempfile.TemporaryDirectory() as scratch, simulating(1) as each:
        here = Path(scratch)
        case = cases.make(number, seed)
        folder.write(case, here, here / "answer.toml")
        model = reading.read(here / folder.MODEL)
        data = prepare(model, recordings.read_runs([here / folder.RUNS]), None, None)
        dynamics, task = case_of(model, data, each, lambda _: None)
        held = find_undetermined(task, dynamics)
        task = replace(task, free=tuple(name for name in task.free if name not in held))
        start = grid_frequency(task, grid_delay(task, dynamics))
        yield Task(f"{case.name}: calibration", _problem_maker(task, start, ()))
        fit = calibrate(task, start)
        if fit is None:
            return
        task = with_calibrated_conditions(task, cast(AxisDynamics, fit.model), data.rounded(fit))
        if (fit := fit_model(task, fit.model)) is None:
            return
        every = candidates(dynamics, (), line_frequencies(data, fit))
        for effect in (each for each in every if each.name in case.effects):
            making = _problem_maker(task, _best_trial(task, fit.model, effect), (effect,))
            yield Task(f"{case.name}: with {effect.name}", making, _matching_columns(fit.solution.columns(), making()))


def _matching_columns(columns: Columns, problem: Problem) -> Columns:
    """Return columns of a Jacobian if they have the rows of a problem: effects may add initial conditions."""
    rows = [record.rows for record in problem.dataset.records]
    fits = all(c is None or len(c) == n for parts in columns.values() for c, n in zip(parts, rows, strict=True))
    return columns if fits else {}


def _best_trial(task: EstimationTask, model: Model, effect: Candidate) -> Model:
    """Return a model with an effect at the trial that fits best."""
    added = effect.add(model)
    tried = [added.replace(values) for values in effect.trials]
    problems = [_problem_maker(task, each, (effect,))() for each in tried]
    costs = [problem.cost(problem.where.start, problem.residuals(problem.where.start)) for problem in problems]
    return tried[int(np.argmin(costs))]


def _problem_maker(task: EstimationTask, model: Model, effects: Sequence[Candidate]) -> Callable[[], Problem]:
    """Return what makes the problem of a fit, as `fitted_model.solve_case` does."""
    task = task.prepared(task, model)
    free = [*task.free, *(n for effect in effects for n in effect.free)]
    return lambda: task.problem(task.identify, model, free)


def formulas() -> Iterator[Task]:
    """Yield fits of formulas: oscillations from starts up to 30 % off, and Rosenbrock's valley (1960)."""
    t = np.linspace(0.0, 2.0, 400)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        seen = run(OSCILLATION, TRUTH, t, ar1(rng, len(t), 0.05, 0.5))
        start = OSCILLATION.replace({name: value * rng.uniform(0.7, 1.3) for name, value in TRUTH.items()})
        if seed % 2:  # the frequency is known to a twentieth
            yield Task(f"oscillation {seed}, f known", _formula(start, seen, 0.05, {"f": (3.0, 0.15)}))
        else:
            yield Task(f"oscillation {seed}", _formula(start, seen, 0.05, {}))
    valley = Toy(
        lambda v, _: np.array([10.0 * (v["y"] - v["x"] ** 2), v["x"]]),
        (parameter("x", -1.2, -10.0, 10.0), parameter("y", 1.0, -10.0, 10.0)),
    )
    yield Task("Rosenbrock's valley", _formula(valley, run(valley, {"x": 1.0, "y": 1.0}, t[:2]), 1e-2, {}))


def loops() -> Iterator[Task]:
    """Yield fits of a play operator with unknown threshold and initial states; noise a fiftieth of its width."""
    for seed in range(play_problems.SEEDS):
        about = play_problems.problem(seed, 0.01)
        yield Task(f"loop: play operator {seed}", _problem_maker(about.task, about.model, (about.effect,)))


def _formula(model: Toy, seen: Any, sigma: float, known: dict[str, tuple[float, float]]) -> Callable[[], Problem]:
    where = coordinates(model, [p.name for p in model.every], known)
    dataset = Dataset(
        [seen], ColouredNoise(Process.white(sigma)), lambda each: (np.zeros((len(each.measured()), 0)), np.zeros(0))
    )
    return lambda: Problem(dataset, model, where)


# --- the table ------------------------------------------------------------------------------------------------------


def row(name: str, found: dict[str, SolverOutcome]) -> list[str]:
    """Return a row of the table."""
    mine, other = found["own"], found["SciPy"]
    return [
        name,
        f"{mine.cost:.2f}",
        f"{other.cost - mine.cost:+.2g}",
        f"{mine.simulations:.0f}",
        f"{other.simulations:.0f}",
        f"{mine.seconds:.2f}",
        f"{other.simulations / mine.simulations:.2f}",
        f"{other.seconds / mine.seconds:.2f}",
    ]


#: Parts of the report.
PARTS = ("Formulas", "Hysteresis loops", "Fits to runs")
HEADS = (
    "problem",
    "cost, own",
    "SciPy's less own",
    "simulations, own",
    "SciPy",
    "seconds, own",
    "simulations, SciPy / own",
    "seconds, SciPy / own",
)


def is_lower(a: SolverOutcome, b: SolverOutcome) -> bool:
    """Tell whether one cost is lower than another by more than solvers may leave."""
    return b.cost - a.cost > max(SMALL_REDUCTION, SAME * a.cost)


@dataclass(frozen=True)
class Ratio:
    """What a number of problems come to.

    Parameters
    ----------
    alike, own_lower, scipy_lower
        In how many both reach the same cost, and in how many each reaches a lower one.
    simulations, seconds
        SciPy's over own, geometric means where both reach the same cost.
    """

    alike: int
    own_lower: int
    scipy_lower: int
    simulations: float
    seconds: float


def ratio(found: dict[str, dict[str, SolverOutcome]]) -> Ratio:
    """Return what the problems come to."""
    pairs = [(each["own"], each["SciPy"]) for each in found.values()]
    same = [(a, b) for a, b in pairs if not is_lower(a, b) and not is_lower(b, a)]
    return Ratio(
        len(same),
        sum(is_lower(a, b) for a, b in pairs),
        sum(is_lower(b, a) for a, b in pairs),
        geometric_mean([b.simulations / a.simulations for a, b in same]) if same else math.nan,
        geometric_mean([b.seconds / a.seconds for a, b in same]) if same else math.nan,
    )


def summary(found: dict[str, dict[str, SolverOutcome]]) -> list[str]:
    """Return the same as text."""
    total = ratio(found)
    lines = [
        f"{len(found)} problems: both methods reach the same cost in {total.alike}; own is lower in "
        f"{total.own_lower}, SciPy's in {total.scipy_lower}."
    ]
    if total.alike:
        lines.append(
            f"Where they do, SciPy's takes {total.simulations:.2f} times the simulations and {total.seconds:.2f} times "
            "the seconds (geometric means)."
        )
    return lines


def part_of(problem: str) -> str:
    """Return the part of the report in which a problem stands, by its name."""
    return PARTS[1 if problem.startswith("loop: ") else 2 * (": " in problem)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve all problems by both, print the table and write it."""
    parser = argparse.ArgumentParser(prog="python -m studies.benchmarks.least_squares", description="Two solvers")
    parser.add_argument("numbers", nargs="*", type=int, help="cases of the trial [default: eleven, and formulas]")
    parser.add_argument("--seed", type=int, default=cases.SEED, help="of the trial's cases [default: %(default)s]")
    parser.add_argument("--out", type=Path, default=Path("reports/least_squares"), help="folder of the report")
    given = parser.parse_args(arguments)
    tasks = (task for number in given.numbers or CASES for task in tasks_of_case(number, given.seed))
    found = {(part, how): dict[str, dict[str, SolverOutcome]]() for how in MANNERS for part in PARTS}
    for task in (*(() if given.numbers else (*formulas(), *loops())), *tasks):
        part = part_of(task.name)
        for how, manner in MANNERS.items():
            found[part, how][task.name] = compare_solvers(task, manner)
            print(how, *row(task.name, found[part, how][task.name]), sep="  ", file=sys.stderr, flush=True)
    sections = [
        Section(f"{part}, {how}", summary(ended), [Table(HEADS, [row(*each) for each in ended.items()])])
        for (part, how), ended in found.items()
        if ended
    ]
    result = {
        "seed": given.seed,
        "problems": [
            {"problem": name, "manner": how, **{solver: vars(each) for solver, each in pair.items()}}
            for (_, how), ended in found.items()
            for name, pair in ended.items()
        ],
    }
    text = ["Marquardt's method of the package and SciPy's trust-region method, on the same problems."]
    render.write(given.out, Document("Two methods of least squares", text, sections), result, {})
    for section in sections:
        print(plain(section.tables[0]), *section.paragraphs, sep="\n")
    print(given.out / "report.html")
    return 0


if __name__ == "__main__":
    sys.exit(main())
