"""A sweep under way: cases that are missing go to processes or to a cluster, answers are kept as they come."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from flexdesign.core import versions
from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import content_key
from flexdesign.design import part as parts
from flexdesign.design.design import Design
from flexdesign.design.design import read as read_design
from flexdesign.fem import mesh_refinement
from flexdesign.workflows.sweeps import pareto, simulating
from flexdesign.workflows.sweeps.evaluators import DIRECT, EvaluationRequest, learn_correction
from flexdesign.workflows.sweeps.plan import SweepPlan, settings_of
from flexdesign.workflows.sweeps.results import Results, key_of
from flexdesign.workflows.sweeps.sampling import Case
from flexdesign.workflows.sweeps.sampling import cases as sampled
from flexdesign.workflows.sweeps.store import Store
from flexdesign.workflows.sweeps.workers import Cluster, Processes, Workers

Progress = Callable[[str], None]
#: Seconds of work in a batch, about, and its largest number of cases.
BATCH = {"pseudo-rigid": 2000, "analytic": 100, "planar": 16, "fem": 4, "simulation": 4}
#: The sources whose change makes answers anew.
_FORMULAS = (
    "analytic/**/*.py", "core/model/*.py", "design/assembly/*.py", "effects/hinge_compliance/*.py",
    "effects/statics/*.py", "workflows/sweeps/evaluators.py",
)  # fmt: skip
_ELEMENTS = (
    "design/assembly/*.py", "fem/**/*.py", "workflows/sweeps/fem_evaluators.py", "workflows/sweeps/evaluators.py",
    "workflows/validation/stage_model_from_*.py",
)  # fmt: skip
_SIMULATION = ("dynamics/**/*.py", "effects/*.py", "workflows/sweeps/simulating.py")
ANSWERING = {
    "pseudo-rigid": _FORMULAS,
    "analytic": _FORMULAS,
    "planar": _ELEMENTS,
    "fem": _ELEMENTS,
    "simulation": (*_SIMULATION, *_ELEMENTS),
}
#: Distributions whose versions enter into an answer besides those that make meshes.
SIMULATED = ("numpy", "scipy", "numba", "control")
#: Number of designs in space from which the correction of the plane is learned.
SAMPLES = 12
#: Modes of each symmetry class, where a limit or an aim asks for what takes modes.
MODES = 2
#: Why a case has no answer whose process died.
DIED = "the process that solved it died (out of memory, or killed)"


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep that is done.

    Parameters
    ----------
    plan
        What was asked.
    cases, results
        All cases in order, and what was said of each.
    computed
        How many of them this run had to compute.
    seconds
        How long it took.
    """

    plan: SweepPlan
    cases: Sequence[Case]
    results: Results
    computed: int
    seconds: float

    @property
    def failed(self) -> list[int]:
        """The places of the cases without an answer."""
        return [i for i, error in enumerate(self.results.errors) if error]

    @property
    def inaccurate(self) -> dict[int, float]:
        """The cases that miss the accuracy asked of finite elements, by place, with their largest estimated error."""
        asked = self.plan.mesh.accuracy
        if asked is None or self.plan.evaluator not in ("fem", "simulation"):
            return {}
        errors = self.results.relative_errors(mesh_refinement.ACCURACY_QUANTITIES)
        return {int(i): float(errors[i]) for i in np.flatnonzero(errors > asked)}


def run(
    plan: SweepPlan, store: Store, *, jobs: int = 2, scheduler: str = "", progress: Progress = lambda _: None
) -> Sweep:
    """Run a sweep: compute what the store does not have.

    Parameters
    ----------
    plan
        What to do.
    store
        Where answers are looked up and kept.
    jobs
        Processes at a time on this machine.
    scheduler
        Address of a Dask scheduler, whose workers see the same files; none uses processes of this machine.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, or answers cannot be kept. KeyboardInterrupt ends it; what is done is kept.
    """
    began = time.perf_counter()
    progress("looking up what is known")
    cases = plan.cases()
    requests = requests_of(plan, cases)
    store.refresh()
    todo = list({q.key: q for q in requests if q.key not in store}.values())
    if todo:
        if plan.evaluator == "planar":
            progress(f"solving {SAMPLES} designs in space, to correct the plane")
            todo = _learn_correction(plan, todo)
        size = max(1, min(BATCH[plan.evaluator], -(-len(todo) // (4 * jobs))))
        batches = [todo[i : i + size] for i in range(0, len(todo), size)]
        workers: Workers = Cluster(scheduler) if scheduler else Processes(jobs)
        try:
            _compute(batches, workers, store, progress, known=len(requests) - len(todo))
        finally:
            workers.close()
    found = store.find([request.key for request in requests])
    pareto.refuse_unknown(found, plan.limits, plan.aims, plan.file)
    return Sweep(plan, cases, found, len(todo), time.perf_counter() - began)


def requests_of(plan: SweepPlan, cases: Sequence[Case]) -> list[EvaluationRequest]:
    """Return the question of each case; its key holds all that the answer depends on, the code among it."""
    factors = {factor.key: factor for factor in plan.factors}
    file, mesh = plan.subject_file.resolve(), plan.mesh.model_dump()
    modes = MODES if plan.evaluator == "fem" and _beyond_direct(plan) else 0
    how = [mesh, modes, _root(plan, plan.overrides)] if plan.is_meshed else []
    if plan.evaluator == "planar":
        how += [repr(plan.factors), SAMPLES, plan.seed]  # from which the plane's correction is learned
    code = content_key(_code(plan), plan.evaluator, how)
    roots = dict[tuple[str, ...], str]()
    made = []
    for case in cases:
        overrides, dimensions = settings_of(case, factors)
        overrides = (*plan.overrides, *overrides)
        if overrides not in roots:
            roots[overrides] = content_key(code, _root(plan, overrides))
        key = content_key(roots[overrides], sorted(dimensions.items()))
        made.append(
            EvaluationRequest(
                key, file, overrides, dimensions, plan.evaluator, mesh, modes, plan.overrides, None, plan.bench
            )
        )
    return made


def _learn_correction(plan: SweepPlan, todo: Sequence[EvaluationRequest]) -> list[EvaluationRequest]:
    """Return questions with what the plane leaves out, learned from a sample of what varies."""
    sample = requests_of(plan, list(sampled(plan.factors, "latin-hypercube", SAMPLES, plan.seed)))
    with threadpool_limits(1):
        correction = learn_correction(sample)
    return [replace(request, correction=correction) for request in todo]


def _beyond_direct(plan: SweepPlan) -> bool:
    """Tell whether anything is asked that takes modes or lateral motions."""
    named = [*plan.show, *(aim.quantity for aim in plan.aims), *(limit.quantity for limit in plan.limits)]
    return any(not key_of(quantity).startswith(DIRECT) for quantity in named)


def _root(plan: SweepPlan, overrides: Sequence[str]) -> list[object]:
    """Return what a design or stage is, but for the dimensions that vary; where it cannot be read, what was asked."""
    try:
        simulated = [] if plan.bench is None else plan.bench.inputs(overrides)
        if not isinstance(plan.subject, Design):
            return simulated
        design = read_design(plan.subject_file, simulating.of_design(overrides))
    except InputError as error:
        return [list(overrides), str(error)]
    drive = design.actuator.model_dump() if design.actuator else {}
    owner = parts.sketch_text(design.part_class)
    return [
        dict(design.dimensions),
        repr(design.material),
        drive,
        design.effects,
        *([owner] if owner else []),
        *simulated,
    ]


def _code(plan: SweepPlan) -> list[object]:
    """Return what the answers depend on besides design or stage: the part, the sources that answer, the libraries."""
    package = Path(__file__).parents[2]
    sources = sorted(path for place in ANSWERING[plan.evaluator] for path in package.glob(place))
    if isinstance(plan.subject, Design):
        sources += _parts(plan.subject)
    libraries = {*(mesh_refinement.LIBRARIES if plan.is_meshed else ("numpy",)), *(SIMULATED if plan.bench else ())}
    return [[path.read_text(encoding="utf-8") for path in sources], versions.installed(sorted(libraries))]


def _parts(design: Design) -> list[Path]:
    """Return the files of a part, or of a stage and the parts that it is built of."""
    built = [type(piece) for piece, _ in design.stage().assembly().kinds()] if design.is_stage else []
    return sorted({parts.file_of(each) for each in (design.part_class, *built)})


def _compute(
    batches: Sequence[Sequence[EvaluationRequest]], workers: Workers, store: Store, progress: Progress, known: int
) -> None:
    """Have batches computed, and keep each as it comes; cases of a process that died are tried again one by one."""
    total, done, failed, began = known + sum(map(len, batches)), known, 0, time.perf_counter()
    queue, waiting = deque(batches), dict[Future[Results], Sequence[EvaluationRequest]]()

    def take(batch: Sequence[EvaluationRequest], found: Results) -> None:
        nonlocal done, failed
        store.keep([request.key for request in batch], found)
        done, failed = done + len(found), failed + sum(map(bool, found.errors))
        left = (total - done) * (time.perf_counter() - began) / (done - known)
        words = f"{done} of {total} cases" + (f", {failed} failed" if failed else "")
        progress(f"{words}, {_span(left)} left" if done < total else words)

    while queue or waiting:
        while queue and len(waiting) < workers.window:
            batch = queue.popleft()
            waiting[workers.submit(batch)] = batch
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            if future not in waiting:
                continue
            batch = waiting.pop(future)
            try:
                take(batch, future.result())
            except workers.died:
                for request in itertools.chain(batch, *workers.lost(waiting)):
                    take([request], _alone(workers, request))


def _alone(workers: Workers, request: EvaluationRequest) -> Results:
    """Return the answer to one question that has a process to itself, or that the process died of it."""
    try:
        return workers.alone(request)
    except workers.died:
        return Results.of([((), DIED, 0.0)])


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
