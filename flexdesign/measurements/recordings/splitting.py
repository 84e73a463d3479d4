"""The roles of runs where nobody stated them: which are fitted, which choose the model, which only test it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.measurements.recordings.run import Role, Run

#: The share of the runs that is kept for validation.
VALIDATION_SHARE = 0.25
#: With fewer moving runs none is for testing: of six, two validate, one tests and three are fitted; of five or fewer,
#: a test run would leave the fit less than it needs, or a single run to choose the model by.
ENOUGH = 6
#: Blocks into which a single record is split, and which of them judge; both early and late, none at an end.
BLOCKS, JUDGING = 8, (2, 6)
#: The same once for this number of samples of a long record: a slow sweep passes a resonance within one of eight
#: blocks, which would judge nothing of what the others teach.
SAMPLES_OF_BLOCKS = 50_000
#: A block with a step of the command this many times the largest step of those that teach is the only one of its kind.
ONLY = 2.0
#: Samples left out on each side of a border between blocks, as a share of the record: noise has a memory.
BORDER = 0.005
#: Fewest samples in a block; a shorter record is not split.
SHORTEST = 50
#: A command that spans less than this share of the largest one stands still.
STILL = 1e-3


def split(runs: Sequence[Run], *, test: bool = False) -> tuple[Run, ...]:
    """Return runs with roles, so that some judge what the others taught; where somebody chose roles, as they are.

    About a quarter of the runs is kept for validation: one of each kind that was recorded more than once, then a second
    one, and so on; the last of its kind, and others evenly before it. Runs without a kind count as one kind. A record
    in which no command moves is never kept: it teaches the noise. Nor is the only run of its kind.

    With ``test``, and at least `ENOUGH` moving runs, one more gets the role ``test``: of the kind with most runs left
    to fit, the one in the middle. It is never the only fitted run of its kind.

    Where nothing can be kept whole, the longest run is split into `BLOCKS` blocks, two of which judge, and a long one
    into as many for each `SAMPLES_OF_BLOCKS` samples: moving ones, but not the one with the only step, for which the
    next one judges. Both halves are the whole record, so that it is simulated straight through, and have NaN where the
    other half counts and at the borders; they are called ``NAME:identify`` and ``NAME:validate``. Such a record has no
    blocks for testing: noise has a memory and a stage drifts, so that a block next to a fitted one tests little.

    Parameters
    ----------
    runs
        As they were read.
    test
        Whether one of many runs is for testing.

    >>> t = np.arange(400.0)
    >>> seen, kept = split([Run("sine", t, {"u": np.sin(t), "x": np.sin(t)}, {"u": "V", "x": "m"})])
    >>> seen.name, kept.name, kept.role, int(np.isfinite(kept.measured()).sum())
    ('sine:identify', 'sine:validate', 'validate', 92)
    """
    if any(run.role_is_stated or run.role != "identify" for run in runs):
        return tuple(runs)
    moving = [run for run in runs if not _has_constant_command(run, runs)]
    validation_runs = _chosen(moving)
    if validation_runs:
        roles: dict[str, Role] = dict.fromkeys(validation_runs, "validate")
        left = [run for run in moving if run.name not in validation_runs]
        if test and len(moving) >= ENOUGH and (tested := _test_run(left)) is not None:
            roles[tested] = "test"
        return tuple(replace(run, role=roles.get(run.name, run.role)) for run in runs)
    parted = max(moving, key=lambda run: len(run.time), default=None)
    if parted is None or len(parted.time) < BLOCKS * SHORTEST:
        return tuple(runs)
    return tuple(part for run in runs for part in (_blocks(run) if run is parted else (run,)))


def _has_constant_command(run: Run, runs: Sequence[Run]) -> bool:
    largest = max(float(np.ptp(each.command(), axis=-1).max()) for each in runs)
    return float(np.ptp(run.command(), axis=-1).max()) <= STILL * largest


def _by_kind(runs: Sequence[Run]) -> list[list[str]]:
    """Return the names of runs by kind: the kinds with most runs first, equal ones as they come."""
    kinds: dict[str, list[str]] = {}
    for run in runs:
        kinds.setdefault(run.kind.strip().lower(), []).append(run.name)
    return sorted(kinds.values(), key=len, reverse=True)


def _test_run(left: Sequence[Run]) -> str | None:
    """Return the name of the run that tests, of those not for validation; None if each is alone of its kind."""
    names = _by_kind(left)[0]
    return names[len(names) // 2] if len(names) > 1 else None


def _chosen(moving: Sequence[Run]) -> set[str]:
    """Return the names of the runs that are kept."""
    order = _by_kind(moving)
    turns = range(1, max(map(len, order), default=0))
    served = [kind for turn in turns for kind, names in enumerate(order) if len(names) > turn]
    many = Counter(served[: max(1, round(VALIDATION_SHARE * len(moving)))])
    return {order[kind][-1 - k * len(order[kind]) // count] for kind, count in many.items() for k in range(count)}


def _judging(commands: NDArray[np.float64], block: NDArray[np.intp]) -> list[int]:
    """Return the blocks that judge: `JUDGING`, or the next one where one stands still or is the only one of its kind.

    A step is all that shows how a stage rings, and much of what distinguishes a lag from hysteresis: fitted runs need
    one.
    """
    steps = np.abs(np.diff(commands, axis=1, prepend=commands[:, :1])).max(axis=0)
    every = range(block[-1] + 1)
    largest = np.array([steps[block == k].max() for k in every])
    spans = np.array([np.ptp(commands[:, block == k], axis=1).max() for k in every])
    chosen = [BLOCKS * turn + k for turn in range((block[-1] + 1) // BLOCKS) for k in JUDGING]
    for place, k in enumerate(tuple(chosen)):
        others = np.delete(largest, chosen)
        if spans[k] <= STILL * spans.max() or largest[k] > ONLY * others.max():
            chosen[place] = k + 1
    return chosen


def _blocks(run: Run) -> tuple[Run, Run]:
    """Return the two halves of a record that is judged by blocks."""
    count = len(run.time)
    turns = max(1, count // SAMPLES_OF_BLOCKS)
    block = np.minimum(np.arange(count) * BLOCKS * turns // count, BLOCKS * turns - 1)
    validation_lines = np.isin(block, _judging(np.atleast_2d(run.command()), block))
    turn = np.flatnonzero(np.diff(validation_lines)) + 1
    width = max(1, round(BORDER * count / turns))
    border = np.zeros(count, dtype=bool)
    for place in turn:
        border[max(place - width, 0) : place + width] = True

    def half(role: Role, rows: NDArray[np.bool_]) -> Run:
        gaps = {name: np.where(rows & ~border, run.columns[name], np.nan) for name in run.responses}
        purpose = {"identify": "identification", "validate": "validation"}[role]
        remark = f"blocks of one record: {np.count_nonzero(rows & ~border)} of {count} samples are for {purpose}"
        remarks = (*run.remarks, remark)
        return replace(run, name=f"{run.name}:{role}", columns={**run.columns, **gaps}, role=role, remarks=remarks)

    return half("identify", ~validation_lines), half("validate", validation_lines)
