"""Direct solvers: both give the same answers, and say beforehand what cannot be solved."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from flexdesign.fem.solving import solver
from flexdesign.fem.solving.solver import NotEnoughMemory, NotPositiveDefinite, Pardiso, SuperLU


def laplacian(n: int) -> sp.csr_matrix:
    """The upper triangle of the five-point Laplacian on n by n points."""
    line = sp.diags_array([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    one = sp.eye_array(n)
    return sp.csr_matrix(sp.triu(sp.kron(line, one) + sp.kron(one, line)))


def test_both_solvers_solve_the_same_equations() -> None:
    pytest.importorskip("pypardiso")
    upper, rng = laplacian(30), np.random.default_rng(0)
    full = upper + sp.triu(upper, 1).T
    for right in (rng.standard_normal(900), rng.standard_normal((900, 4))):
        for made in (Pardiso(upper), SuperLU(upper)):
            assert full @ made.solve(right) == pytest.approx(right, abs=1e-10)
            made.free()


def test_the_memory_of_a_factor_is_known_before_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where threads need little room beside it: the entries of the factor once, and up to twice that to work with."""
    pytest.importorskip("pypardiso")
    large = Pardiso(laplacian(600))
    entries = 8 * int(large._solver.iparm[17])
    assert entries < large.memory < 3 * entries
    large.free()
    upper = laplacian(200)
    made = Pardiso(upper)
    made.free()
    monkeypatch.setattr(solver, "available_memory", lambda: made.memory - 1)
    with pytest.raises(NotEnoughMemory, match=r"40000 unknowns need 0\.0 GiB of memory"):
        Pardiso(upper)


def test_a_matrix_that_is_not_positive_definite_is_refused() -> None:
    pytest.importorskip("pypardiso")
    upper = laplacian(10)
    upper.setdiag(upper.diagonal() - 5.0)
    with pytest.raises(NotPositiveDefinite):
        Pardiso(upper)


def test_a_factor_is_renewed_where_entries_are_in_the_same_places() -> None:
    pytest.importorskip("pypardiso")
    upper, right = laplacian(20), np.random.default_rng(1).standard_normal(400)
    heavier = upper + sp.diags_array(np.linspace(1.0, 3.0, 400)).tocsr()
    made = Pardiso(upper)
    assert made.renew(sp.csr_matrix(heavier))
    full = heavier + sp.triu(heavier, 1).T
    assert full @ made.solve(right) == pytest.approx(right, abs=1e-10)
    assert not made.renew(sp.csr_matrix(sp.eye_array(400)))
    assert full @ made.solve(right) == pytest.approx(right, abs=1e-10)  # it is still what it was
    made.free()
    assert not SuperLU(upper).renew(upper)


def test_an_order_found_on_nodes_makes_no_more_fill_than_one_found_on_unknowns() -> None:
    """Three unknowns at each point of a grid that are all coupled to those of its neighbours."""
    pytest.importorskip("pypardiso")
    points = laplacian(60)
    full = points + sp.triu(points, 1).T
    upper = sp.csr_matrix(sp.triu(sp.kron(full, np.eye(3) + 0.1)))
    nodes = solver.elimination_order(points)
    assert nodes is not None and sorted(nodes) == list(range(3600))
    order = (3 * nodes[:, None] + np.arange(3)).ravel()
    found, given = Pardiso(upper), Pardiso(upper, order)
    right = np.random.default_rng(2).standard_normal(3 * 3600)
    assert given.solve(right) == pytest.approx(found.solve(right), rel=1e-8, abs=1e-10)
    assert given._solver.iparm[17] < 1.1 * found._solver.iparm[17]
    found.free()
    given.free()


def test_available_memory_is_no_more_than_there_is() -> None:
    found = solver.available_memory()
    assert found is None or 2**20 < found < 2**50
