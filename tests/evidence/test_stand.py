"""Fits and what is judged by them: initial conditions alone, and runs that are tested in the end."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from flexdesign.evidence import calibration
from flexdesign.evidence import stand as stands
from flexdesign.evidence.marquardt import FULL
from flexdesign.evidence.noise import White
from flexdesign.evidence.suite import Suite
from tests.evidence.test_screening import NAMES, N, column, offset
from tests.evidence.test_selection import HELD, SIGMA, case, recorded, stage
from tests.evidence.toys import Array, Run, parameter


def left_by_its_own(run: Run, shared: Array) -> Array:
    """What is left of a run with its own number and offset fitted, beside what is shared."""
    own = np.column_stack([np.ones(N), column(run, "own")])
    left = np.asarray(run.data) - shared
    return np.asarray(left - own @ np.linalg.lstsq(own, left)[0])


def shared(run: Run, p: float, q: float) -> Array:
    return p * column(run, "p") + q * column(run, "q")


def test_a_model_is_evaluated_with_nothing_but_initial_conditions_fitted() -> None:
    """By linear algebra; its own numbers stay, and the Jacobian holds them all the same."""
    about = case({})
    found = calibration.evaluate_design(about, stage().replace({"p": 1.5, "q": -0.7}))
    assert found is not None
    values = {p.name: p.start for p in found.model.parameters()}
    assert (values["p"], values["q"]) == (1.5, -0.7)
    for suite in (about.identify, about.validate):
        for record in suite.records:
            run = record.observation
            expected = left_by_its_own(run, shared(run, 1.5, -0.7))  # type: ignore[arg-type]
            missed = float(np.sum((found.remainders[run.name] - expected) ** 2)) / SIGMA**2
            assert missed < FULL.share * found.cost  # a fit ends where no step promises more
    assert {"p", "q"} <= set(found.solution.problem.where.names)
    assert set(found.solution.columns()) >= {"p", "q"}


def test_test_runs_are_predicted_in_the_end_and_change_nothing() -> None:
    about = case({})
    unseen = recorded({"p": 2.3}, 5, ("later",))
    model = stage().plus(
        lambda v, run: v["later:own"] * column(run, "own") * (run.name == "later"),
        parameter("later:own", 0.0, -10.0, 10.0, run="later"),
    )
    with_test = dataclasses.replace(about, test=Suite(unseen, White(SIGMA), offset))
    plain, stand = (stands.fit(each, model) for each in (about, with_test))
    assert plain is not None and stand is not None and "later" not in stand.remainders
    assert (stand.cost, stand.held_cost) == (plain.cost, plain.held_cost)
    assert stands.predict_tests(about, plain) is plain
    last = stands.predict_tests(with_test, stand)
    assert set(last.remainders) == {*NAMES, *HELD, "later"}
    assert (last.cost, last.held_cost, last.effects) == (stand.cost, stand.held_cost, stand.effects)
    for name in (*NAMES, *HELD):
        assert last.remainders[name] is stand.remainders[name]
    values = stand.solution.problem.where.values(stand.solution.x)
    expected = left_by_its_own(unseen[0], shared(unseen[0], values["p"], values["q"]))
    assert last.remainders["later"] == pytest.approx(expected, abs=0.02 * SIGMA)
