"""Direct solvers for symmetric positive definite systems: factorized once, used for every load and every mode."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Tells pypardiso where its library is, and where pip puts that: a search of its own, twice a third of a second, walks
#: through all that is installed.
LIBRARY, PLACES = "PYPARDISO_MKL_RT", ("lib/libmkl_rt.so*", "Library/bin/mkl_rt*.dll")
#: Where a container states how much memory it may take.
CONTAINER = "/sys/fs/cgroup"
#: PARDISO's phases.
ORDER, FACTORIZE, SOLVE = 11, 22, 33
#: PARDISO's settings by number, instead of its defaults: nested dissection; no iterative refinement, which makes three
#: solves of one and leaves the residual of a Cholesky factor where it was; the entries of the factor are counted.
SETTINGS = {1: 1, 2: 3, 8: 0, 18: -1}
#: Number of PARDISO's setting for the order of elimination: 1 takes one, 2 returns the one found.
PERMUTATION = 5
#: Factors of solids grow with the number of unknowns to the power 4/3 (George 1973, Lipton, Rose and Tarjan 1979).
GROWTH = 3 / 4
#: What PARDISO answers where a pivot is zero or negative.
NO_PIVOT = -4


class NotPositiveDefinite(ArithmeticError):
    """A matrix that has no Cholesky factor: a body that is not held, or one that has buckled."""


class NotEnoughMemory(MemoryError):
    """A matrix whose factor would not fit; the message says how large it would be."""


class Factor(Protocol):
    """A factorized matrix, and how much memory that took [bytes], 0 if nobody knows."""

    name: str
    memory: int

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for one or several right-hand sides, shape (n,) or (n, k)."""

    def renew(self, upper: sp.csr_matrix) -> bool:
        """Factorize another matrix in the place of this one if that is quicker than anew, else return False."""

    def free(self) -> None:
        """Give the memory back."""


class Pardiso:
    """Intel MKL's PARDISO for symmetric positive definite matrices, through pypardiso."""

    name = "MKL PARDISO (symmetric positive definite)"

    def __init__(self, upper: sp.csr_matrix, order: IntArray | None = None) -> None:
        self._matrix = upper
        self._matrix.sort_indices()
        self._solver = _pardiso()
        if order is not None:
            self._solver.set_iparm(PERMUTATION, 1)
            self._solver.perm = (order + 1).astype(np.int32)
        self._factorize((ORDER, FACTORIZE))

    def _factorize(self, phases: Sequence[int]) -> None:
        from pypardiso.pardiso_wrapper import PyPardisoError

        try:
            for phase in phases:
                self._run(phase)
                if phase == ORDER:
                    counts = self._solver.iparm
                    self.memory = 1024 * max(int(counts[14]), int(counts[15] + counts[16]))
                    self._require(available_memory())
        except PyPardisoError as error:
            self.free()
            if error.value == NO_PIVOT:
                raise NotPositiveDefinite("the stiffness matrix is not positive definite") from None
            raise
        self._solver.set_phase(SOLVE)

    def renew(self, upper: sp.csr_matrix) -> bool:
        """Factorize a matrix with entries in the same places, in the order found for the first; False for others.

        Raises
        ------
        NotPositiveDefinite
            If it is not positive definite; the factor is gone then.
        """
        upper.sort_indices()
        same = (np.array_equal(getattr(upper, name), getattr(self._matrix, name)) for name in ("indptr", "indices"))
        if not all(same):
            return False
        self._matrix = upper
        self._factorize((FACTORIZE,))
        return True

    def _run(self, phase: int) -> None:
        self._solver.set_phase(phase)
        self._solver._call_pardiso(self._matrix, np.zeros((self._matrix.shape[0], 1)))

    def _require(self, free: int | None) -> None:
        if free is not None and self.memory > free:
            self.free()
            sizes = f"{self.memory / 2**30:.1f} GiB of memory, and {free / 2**30:.1f} GiB are free"
            count = self._matrix.shape[0]
            fits = count * (free / self.memory) ** GROWTH
            raise NotEnoughMemory(f"{count} unknowns need {sizes}: about {float(f'{fits:.1g}'):.0f} would fit")

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for one or several right-hand sides, shape (n,) or (n, k)."""
        block = np.asfortranarray(right, dtype=float)
        return np.asarray(self._solver._call_pardiso(self._matrix, block)).reshape(right.shape)

    def free(self) -> None:
        """Give the memory back."""
        self._solver.free_memory(everything=True)


def _pardiso() -> Any:
    """Return PARDISO for symmetric positive definite matrices with our settings; raise ImportError without it."""
    if libraries := [str(path) for place in PLACES for path in Path(sys.prefix).glob(place)]:
        os.environ.setdefault(LIBRARY, min(libraries, key=len))
    from pypardiso import PyPardisoSolver

    solver = PyPardisoSolver(mtype=2)
    for place, value in SETTINGS.items():
        solver.set_iparm(place, value)
    return solver


def elimination_order(graph: sp.csr_matrix) -> IntArray | None:
    """Return an order of elimination with little fill, by PARDISO's nested dissection; None without PARDISO.

    Parameters
    ----------
    graph
        Upper triangle, diagonal included, shape (n, n); only the places of its entries count.

    Returns
    -------
    ndarray or None
        Which row is eliminated first, second, ..., shape (n,).
    """
    try:
        solver = _pardiso()
    except ImportError:
        return None
    solver.set_iparm(PERMUTATION, 2)
    solver.perm = np.zeros(graph.shape[0], dtype=np.int32)
    solver.set_phase(ORDER)
    solver._call_pardiso(graph, np.zeros((graph.shape[0], 1)))
    order = solver.perm.astype(np.int64) - 1
    solver.free_memory(everything=True)
    return order


class SuperLU:
    """SciPy's SuperLU: on every platform, but several times slower and larger."""

    name = "SciPy SuperLU"
    memory = 0

    def __init__(self, upper: sp.csr_matrix) -> None:
        full = (upper + sp.triu(upper, k=1).T).tocsc()
        from scipy.sparse.linalg import splu

        way = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        try:
            self._factor = splu(full, **way)
        except MemoryError:
            remedy = "more memory than there is; Intel's MKL needs less: pip install pypardiso, where it has a wheel"
            raise NotEnoughMemory(f"{upper.shape[0]} unknowns need {remedy}") from None

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution for one or several right-hand sides, shape (n,) or (n, k)."""
        return np.asarray(self._factor.solve(np.ascontiguousarray(right)))

    def renew(self, upper: sp.csr_matrix) -> bool:
        """Return False: nothing of a factor is of use to the next."""
        return False

    def free(self) -> None:
        """Nothing to do: the factor goes with the object."""


def available_memory() -> int | None:
    """Return how much memory a program may still take [bytes], or None where the system does not state it."""
    known = [_of_the_machine(), _of_the_container(), _of_the_process()]
    return min((free for free in known if free is not None), default=None)


def _of_the_machine() -> int | None:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")), None)


def _of_the_container() -> int | None:
    try:
        most, taken = (Path(CONTAINER, name).read_text(encoding="ascii") for name in ("memory.max", "memory.current"))
        return int(most) - int(taken)
    except (OSError, ValueError):
        return None


def _of_the_process() -> int | None:
    """Return what `ulimit -v` leaves, which clusters set for each job."""
    try:
        import resource

        most, _ = resource.getrlimit(resource.RLIMIT_AS)
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError):  # no Unix, or no Linux
        return None
    return None if most == resource.RLIM_INFINITY else most - pages * resource.getpagesize()


def factorize(upper: sp.csr_matrix, order: IntArray | None = None) -> Factor:
    """Factorize a symmetric positive definite matrix given by its upper triangle, with the best solver installed.

    PARDISO eliminates in an `order` if it is given one (`elimination_order`), else it finds its own.

    Raises
    ------
    NotPositiveDefinite
        If it is none.
    NotEnoughMemory
        If its factor would not fit; that is known before it is made.
    """
    try:
        return Pardiso(upper, order)
    except ImportError:
        return SuperLU(upper)


def times(upper: sp.csr_matrix, vectors: FloatArray) -> FloatArray:
    """Multiply the symmetric matrix that `upper` is the upper triangle of by one or several vectors."""
    diagonal = upper.diagonal()
    product = upper @ vectors + upper.T @ vectors
    return np.asarray(product - (diagonal * vectors.T).T)
