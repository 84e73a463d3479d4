"""Studies of many designs from Python: sweep, optimise, reproduce a publication."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexdesign.api.changing import overrides
from flexdesign.api.result import Result
from flexdesign.core.result_cache import open_cache
from flexdesign.workflows import sweeps
from flexdesign.workflows.sweeps import Sweep, SweepPlan, optimising
from flexdesign.workflows.sweeps.optimising import Optimum
from flexdesign.workflows.sweeps.store import Store

if TYPE_CHECKING:
    from flexdesign.workflows.reproduction import Reproduction

Progress = Callable[[str], None]


def read_sweep(study: str | Path | SweepPlan, changes: Sequence[str] = (), **tables: Any) -> SweepPlan:
    """Read a sweep file: a path, or the bare name of one in studies/; one in memory is passed on.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    return study if isinstance(study, SweepPlan) else sweeps.read(study, overrides(changes, tables))


def sweep(
    study: str | Path | SweepPlan,
    changes: Sequence[str] = (),
    *,
    store: str | Path = "reports/sweep",
    jobs: int = 1,
    scheduler: str = "",
    progress: Progress = lambda _: None,
    **tables: Any,
) -> Result[Sweep]:
    """Evaluate a design in many versions.

    Parameters
    ----------
    study
        A sweep file, its path or bare name.
    changes, tables
        What differs: ``sample={"count": 256}``.
    store
        Folder of the answers; what it holds is not computed again.
    jobs
        Processes at a time.
    scheduler
        Address of a Dask scheduler whose workers do the work.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.sweeps import sweep_report

    plan = read_sweep(study, changes, **tables)
    found = sweeps.run(plan, Store(Path(store)), jobs=jobs, scheduler=scheduler, progress=progress)
    return Result(
        found,
        sweep_report.document(found),
        sweep_report.result_table(found),
        partial(sweep_report.result, found),
        partial(_tables, found),
        rows=partial(sweep_report.records, found),
    )


def _tables(found: Sweep, _: Path) -> dict[str, str | bytes]:
    from flexdesign.report.sweeps import sweep_report

    parquet = sweep_report.parquet(found)
    return {"cases.csv": sweep_report.csv(found), **({} if parquet is None else {"cases.parquet": parquet})}


def optimize(
    study: str | Path | SweepPlan,
    changes: Sequence[str] = (),
    *,
    check: bool = True,
    progress: Progress = lambda _: None,
    **tables: Any,
) -> Result[Optimum]:
    """Find the dimensions that serve an aim best and keep their limits.

    Parameters
    ----------
    study
        A sweep file with ranges, limits and one aim.
    changes, tables
        What differs: ``limits={"K_in_output_free": "< 2 N/um"}``.
    check
        Whether finite elements check and correct the formulas.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.sweeps import optimum_report

    found = optimising.optimise(read_sweep(study, changes, **tables), check=check, progress=progress)
    return Result(
        found,
        optimum_report.document(found),
        optimum_report.optimum(found),
        partial(optimum_report.result, found),
        lambda folder: {"optimum.toml": optimum_report.to_toml(found, folder)},
    )


def reproduce(
    publication: str | Path = "lin2019",
    changes: Sequence[str] = (),
    *,
    cache: str | Path | None = None,
    progress: Progress = lambda _: None,
) -> Result[Reproduction]:
    """Reproduce the numbers of a publication, each with a verdict.

    Parameters
    ----------
    publication
        A file of printed numbers, its path or bare name.
    changes
        ``key=value`` of the stage's study.
    cache
        Folder of meshes and solutions; default that of the command line.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.validation import reproduction_report
    from flexdesign.workflows import reproduction

    store = open_cache(cache)
    found = reproduction.reproduce(str(publication), store, progress, changes)
    return Result(
        found,
        reproduction_report.document(found),
        reproduction_report.verdicts(found),
        partial(reproduction_report.result, found),
    )
