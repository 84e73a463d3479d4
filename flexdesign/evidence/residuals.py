"""The residuals of a fit: whitened, free of each observation's offset, with what was known before as further rows."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError
from flexdesign.evidence.coordinates import Coordinates
from flexdesign.evidence.noise import Whitening
from flexdesign.model import Model, Observation

Array = NDArray[np.float64]
Map = Callable[..., Any]
#: How far a finite difference should move the response, relative: between a simulator's error of 1e-7 and curvature.
MOVED = 3e-4
#: Step of a finite difference per size of its coordinate: where it begins, and how small and large it may become.
STEP, SMALLEST, LARGEST = 1e-4, 1e-7, 1e-2


@dataclass(frozen=True, eq=False)
class Record:
    """One observation, ready to be compared.

    Parameters
    ----------
    observation
        The observation itself.
    measured
        Samples by channels, SI; a complex response has its real and imaginary parts as channels. Gaps are zeros.
    present
        False at gaps (values that are not finite); same shape.
    shape
        Shape in which the observation gave them, and a model predicts them.
    offset
        Orthonormal basis of the whitened offsets, (channels * samples) by channels; by 0 if there are none.
    mixing
        The whitened offsets in that basis: upper triangular, channels by channels.
    """

    observation: Observation
    measured: Array
    present: NDArray[np.bool_]
    shape: tuple[int, ...]
    offset: Array
    mixing: Array

    def projected(self, whitened: Array) -> Array:
        """Return whitened samples by channels as one vector, channel by channel, with its offsets taken out."""
        vector = whitened.T.ravel()
        return np.asarray(vector - self.offset @ (self.offset.T @ vector)) if self.offset.size else vector

    def offsets(self, whitened: Array) -> Array:
        """Return the offset of each channel in SI, from whitened samples by channels; zeros if none is taken out."""
        if not self.offset.size:
            return np.zeros(self.measured.shape[1])
        return np.asarray(np.linalg.solve(self.mixing, self.offset.T @ whitened.T.ravel()))

    def restored(self, table: Array) -> NDArray[Any]:
        """Return samples by channels in the shape and kind in which the observation gave them."""
        if np.iscomplexobj(self.observation.measured()):
            half = table.shape[1] // 2
            table = table[:, :half] + 1j * table[:, half:]
        return table.reshape(self.shape)


@dataclass(eq=False)
class Residuals:
    """The residuals of a model as a function of its coordinates; safe to call from several threads.

    Parameters
    ----------
    model
        The model whose values are replaced.
    records
        What it is compared with.
    where
        The free parameters.
    noise
        What whitens.
    scale
        Common factor on the noise; it balances the data against what was known before.
    """

    model: Model
    records: tuple[Record, ...]
    where: Coordinates
    noise: Whitening
    scale: float = 1.0
    evaluations: int = 0
    failures: int = 0
    _last: threading.local = field(default_factory=threading.local, repr=False)
    _lock: Any = field(default_factory=threading.Lock, repr=False)

    @property
    def parts(self) -> list[slice]:
        """Return the rows of the data vector that belong to each record."""
        ends = np.cumsum([0, *(record.measured.size for record in self.records)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @property
    def samples(self) -> int:
        """Number of measured values."""
        return int(sum(record.present.sum() for record in self.records))

    @property
    def offsets(self) -> int:
        """Number of offsets that are taken out."""
        return sum(record.mixing.shape[0] for record in self.records)

    def size(self) -> float:
        """Return the norm of the measured data as the residual sees them: whitened, without offsets."""
        whitened = [r.projected(self.noise.whiten(r.observation, r.measured)) for r in self.records]
        return float(np.linalg.norm(np.concatenate(whitened))) / self.scale

    def raw(self, x: Array) -> list[Array] | None:
        """Return measured less predicted (samples by channels, SI) for each record; None where the model fails."""
        with self._lock:
            self.evaluations += 1
        failed = False
        differences = []
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
                model = self.model.replace(self.where.values(x))
                for record in self.records:
                    difference = record.measured - self._predicted(model, record)
                    differences.append(np.where(record.present, difference, 0.0))
                    if not np.all(np.isfinite(differences[-1])):
                        failed = True
                        break
        except (ArithmeticError, np.linalg.LinAlgError):
            failed = True
        except InputError:  # once the model has answered, only the values of this trial can be what it refuses
            if self.evaluations - self.failures <= 1:
                raise
            failed = True
        if failed:
            with self._lock:
                self.failures += 1
            return None
        return differences

    def data(self, x: Array) -> Array:
        """Return the whitened residual of the data, without the rows of what was known; infinite where it fails.

        The last answer of each thread is remembered, because residual and Jacobian are asked for in turn.
        """
        key = x.tobytes() + np.float64(self.scale).tobytes()
        if getattr(self._last, "key", None) != key:
            self._last.key, self._last.vector = key, self._simulated(x)
        return np.asarray(self._last.vector)

    def _simulated(self, x: Array) -> Array:
        raw = self.raw(x)
        if raw is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                pairs = zip(self.records, raw, strict=True)
                vector = np.concatenate([r.projected(self.noise.whiten(r.observation, part)) for r, part in pairs])
                if np.isfinite(vector @ vector):
                    return np.asarray(vector / self.scale)
        return np.full(sum(record.measured.size for record in self.records), np.inf)

    def __call__(self, x: Array) -> Array:
        """Return the whitened residual, followed by a row for each known parameter."""
        return np.concatenate([self.data(x), self.before(x)])

    def cost(self, x: Array) -> float:
        """Return the sum of the squared residuals; infinite where the model fails."""
        residual = self(x)
        return float(residual @ residual)

    def before(self, x: Array) -> Array:
        """Return how many standard deviations each known parameter is from what was known."""
        values = self.where.values(x)
        return np.array([(values[name] - middle) / sigma for name, (middle, sigma) in self.where.known.items()])

    def before_jacobian(self, x: Array) -> Array:
        """Return the derivative of `before`: known parameters by coordinates."""
        rows = np.zeros((len(self.where.known), len(x)))
        slopes = self.where.slopes(x)
        for row, (name, (_, sigma)) in enumerate(self.where.known.items()):
            column = self.where.names.index(name)
            rows[row, column] = slopes[column] / sigma
        return rows

    def jacobian(
        self, x: Array, steps: Array, *, each: Map = map, central: bool = False, fixed: Collection[int] = ()
    ) -> Array:
        """Return the derivative of the data's residual by finite differences.

        Each column costs one simulation, two if `central`; `each` maps them, over threads perhaps. A step that
        would leave the bounds, or at which the model fails, is taken to the other side.

        Parameters
        ----------
        x
            Where; coordinates.
        steps
            Steps of the coordinates. They are adapted in place for the next call, so that the response moves by
            `MOVED` of the data (3 `MOVED` if `central`, whose error is of second order).
        fixed
            Coordinates that do not move; their columns are left out.
        """
        moving = [j for j in range(len(x)) if j not in fixed]
        here = self.data(x)
        wanted = (3 if central else 1) * MOVED * self.size()

        def column(j: int) -> Array:
            ends = []
            for direction in (1.0, -1.0):
                to = x.copy()
                to[j] += direction * steps[j]
                if self.where.lower[j] <= to[j] <= self.where.upper[j]:
                    there = self._simulated(to)
                    if np.isfinite(there[0]):
                        ends.append((to[j], there))
                        if not central:
                            break
            if len(ends) == 2:
                return np.asarray((ends[0][1] - ends[1][1]) / (ends[0][0] - ends[1][0]))
            return np.asarray((ends[0][1] - here) / (ends[0][0] - x[j])) if ends else np.zeros_like(here)

        columns = np.column_stack(list(each(column, moving)))
        moved = steps[moving] * np.linalg.norm(columns, axis=0)
        steps[moving] *= np.clip(wanted / np.maximum(moved, 1e-300), 0.1, 10.0)
        sizes = self.where.sizes(x)
        np.clip(steps, SMALLEST * sizes, LARGEST * sizes, out=steps)
        return columns

    def _predicted(self, model: Model, record: Record) -> Array:
        predicted = np.asarray(model.predict(record.observation))
        if predicted.shape != record.shape:
            remedy = f"the model predicts values shaped {predicted.shape}, measured are {record.shape}"
            raise InputError("fit", record.observation.name, None, remedy)
        columns = _columns(predicted)
        if columns.shape != record.measured.shape:  # a real measurement of a complex response, or the reverse
            raise InputError(
                "fit", record.observation.name, None, "measured and predicted are not both real or complex"
            )
        return columns


def records(
    observations: Sequence[Observation], noise: Whitening, offsets: bool | Collection[str]
) -> tuple[Record, ...]:
    """Return the observations ready to be compared.

    Parameters
    ----------
    observations
        What was measured.
    noise
        What whitens; an offset is a constant before whitening.
    offsets
        Whether each channel has an offset of its own to be taken out; or the names of the observations that have.

    Raises
    ------
    InputError
        If there are none, one is held back for validation, two have one name, or a channel holds no finite value.
    """
    if not observations:
        raise InputError("fit", "observations", None, "a fit needs something that was measured")
    made: list[Record] = []
    for observation in observations:
        if observation.role != "identify":
            raise InputError("fit", observation.name, observation.role, "is kept for validation; a fit may not see it")
        if observation.name in [record.observation.name for record in made]:
            raise InputError("fit", observation.name, None, "is given twice; every observation needs a name of its own")
        given = np.asarray(observation.measured())
        measured = _columns(given)
        present = np.isfinite(measured)
        if not present.any(axis=0).all():
            raise InputError("fit", observation.name, None, "holds a channel without a finite value")
        has = offsets if isinstance(offsets, bool) else observation.name in offsets
        basis, mixing = _offsets(observation, present if has else present[:, :0], noise)
        made.append(Record(observation, np.where(present, measured, 0.0), present, given.shape, basis, mixing))
    return tuple(made)


def _offsets(observation: Observation, present: NDArray[np.bool_], noise: Whitening) -> tuple[Array, Array]:
    """Return an orthonormal basis of the whitened offsets of some channels, and these offsets in it."""
    if not present.size:
        return np.zeros((0, 0)), np.zeros((0, 0))
    alone = np.eye(present.shape[1])
    whitened = [noise.whiten(observation, present * channel).T.ravel() for channel in alone]
    basis, mixing = np.linalg.qr(np.column_stack(whitened))
    return basis, mixing


def _columns(array: NDArray[Any]) -> Array:
    """Return an array as samples by channels."""
    table = array.reshape(len(array), -1) if array.ndim else array.reshape(1, 1)
    return np.hstack([table.real, table.imag]) if np.iscomplexobj(table) else np.asarray(table, dtype=float)
