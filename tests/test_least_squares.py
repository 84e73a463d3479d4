"""The benchmark of two solvers: same problems, same bounds, and what it says of where they end."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from studies.benchmarks import least_squares as benchmark
from studies.benchmarks.least_squares import MANNERS, SolverOutcome, Task
from tests.estimation import play_problems
from tests.estimation.toys import TRUTH

TASKS = {task.name: task for task in benchmark.formulas()}


@pytest.mark.parametrize("name", TASKS)
def test_both_solvers_reach_the_same_cost(name: str) -> None:
    found = benchmark.compare_solvers(TASKS[name], MANNERS["to the end"])
    assert not benchmark.is_lower(*found.values()) and not benchmark.is_lower(*reversed(found.values()))
    assert all(math.isfinite(each.cost) and each.simulations > len(TRUTH) for each in found.values())


def test_cost_is_that_of_a_fit_written_out() -> None:
    """The known frequency counts as one more residual; a Jacobian of SciPy's own differences."""
    problem = (task := TASKS["oscillation 1, f known"]).make()
    where, (record,) = problem.where, problem.dataset.records

    def residuals(x: np.ndarray) -> np.ndarray:
        values = where.values(x)
        left = (record.measured - problem.model.replace(values).predict(record.observation)) / 0.05
        return np.append(left, (values["f"] - 3.0) / 0.15)

    cost = 2 * least_squares(residuals, where.start, "3-point", (where.lower, where.upper), x_scale="jac").cost
    for each in benchmark.compare_solvers(task, MANNERS["to the end"]).values():
        assert each.cost == pytest.approx(cost, abs=0.1)


@pytest.mark.parametrize("solver", benchmark.SOLVERS)
def test_a_known_jacobian_is_not_found_again(solver: str) -> None:
    """The columns at the start, known before, save a simulation each."""
    task, manner = TASKS["oscillation 0"], MANNERS["roughly"]
    problem = task.make()
    start = problem.where.start
    residuals = problem.residuals(start)
    assert residuals is not None
    (jacobian,) = problem.jacobian(start, residuals)
    old = {name: [jacobian.matrix[:, j]] for j, name in enumerate(problem.where.names)}
    known = benchmark.compare_solvers(Task(task.name, task.make, old), manner)[solver]
    found = benchmark.compare_solvers(task, manner)[solver]
    assert known.simulations <= found.simulations - len(TRUTH) + 1
    assert known.cost == pytest.approx(found.cost, abs=0.1)


def test_only_costs_that_differ_by_more_than_a_last_step_differ() -> None:
    def ended(cost: float, simulations: float = 10.0) -> SolverOutcome:
        return SolverOutcome(cost, simulations, 1.0)

    assert benchmark.is_lower(ended(10.0), ended(10.2))
    assert not benchmark.is_lower(ended(10.0), ended(10.05))
    assert not benchmark.is_lower(ended(10000.0), ended(10009.0))
    pairs = {
        "same": {"own": ended(10.0), "SciPy": ended(10.0, 20.0)},
        "lower": {"own": ended(10.0), "SciPy": ended(30.0, 90.0)},
        "higher": {"own": ended(30.0), "SciPy": ended(10.0, 5.0)},
    }
    first, second = benchmark.summary(pairs)
    assert "3 problems: both methods reach the same cost in 1; own is lower in 1, SciPy's in 1" in first
    assert "2.00 times the simulations" in second


def test_a_case_of_the_trial_is_a_problem() -> None:
    task = next(benchmark.tasks_of_case(20004, benchmark.cases.SEED))
    assert task.name == "single-20004: calibration" and task.make().dataset.samples > 0


def test_a_play_operator_is_a_problem() -> None:
    tasks = list(benchmark.loops())
    assert len(tasks) == play_problems.SEEDS
    assert {"r", "w"} < set(tasks[0].make().where.names)
