"""Measurements from Python: read recordings, compare, identify, diagnose, add an effect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from flexdesign import diagnosis
from flexdesign.api import static_tables
from flexdesign.api.models import read_model
from flexdesign.api.result import Result
from flexdesign.design.design import Design
from flexdesign.diagnosis import Diagnosis, initialised_comparison
from flexdesign.diagnosis import add_effect as additions
from flexdesign.diagnosis import check as checking
from flexdesign.diagnosis import identify as identification
from flexdesign.diagnosis.add_effect import AddedEffect
from flexdesign.diagnosis.check import Check, facts, is_table
from flexdesign.diagnosis.comparison import Comparison
from flexdesign.diagnosis.comparison.static_table import TableComparison
from flexdesign.diagnosis.experiment_design.discrimination import proposals
from flexdesign.diagnosis.identify import Identification
from flexdesign.diagnosis.progress import Progress as Steps
from flexdesign.diagnosis.static_tables.diagnose import TableDiagnosis
from flexdesign.dynamics.stage_model import StageModel, edit
from flexdesign.dynamics.stage_model.effect_names import known_effect, own_effects
from flexdesign.measurements import recordings as reading
from flexdesign.measurements.recordings import FrequencyResponse, Run

Progress = Callable[[str], None]
#: Recordings: files or folders, or what `read_recordings` returned.
Recordings = str | Path | Iterable[str | Path | Run | FrequencyResponse]


def read_recordings(paths: Recordings) -> tuple[Run | FrequencyResponse, ...]:
    """Read recorded runs and frequency responses.

    Parameters
    ----------
    paths
        CSV files, or folders of them with a measurements.toml; recordings in memory are passed on.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    ready = [each for each in given if isinstance(each, (Run, FrequencyResponse))]
    files = [each for each in given if isinstance(each, (str, Path))]
    return (*ready, *(reading.read_recordings(files) if files or not ready else ()))


def import_recordings(
    files: str | Path | Sequence[str | Path], folder: str | Path, map_file: str | Path | None = None
) -> tuple[Run | FrequencyResponse, ...]:
    """Convert recordings of other programs to a folder of runs, and read it.

    Parameters
    ----------
    files
        What `flexdesign import` reads: text tables, .mat, HDF5, .tdms, universal files, .npy, .npz; or folders of them.
    folder
        Where the runs and their ``measurements.toml`` are written; without such a file yet.
    map_file
        Map of variables to columns; guessed without it.

    Returns
    -------
    tuple
        As `read_recordings` returns them.

    Raises
    ------
    InputError
        If a file cannot be used, or does not say all that is needed; a note of the error is then the map to complete.
    """
    from flexdesign.measurements import importing

    given = [files] if isinstance(files, (str, Path)) else files
    paths = importing.list_files([Path(file) for file in given])
    plan: Path | importing.Map
    if map_file is not None:
        plan = Path(map_file)
    else:
        proposal = importing.proposal(paths)
        if proposal.questions:
            error = importing.asking(paths, proposal.questions, "Complete this map, save it, and pass it as map_file")
            error.add_note(proposal.text)
            raise error
        plan = proposal.map()
    found = importing.bring_in(paths, plan, Path(folder))
    return (*found.runs, *found.responses)


def check(recordings: Recordings) -> Result[Check]:
    """Say what recordings hold, what is suspicious about them, and which effects a diagnosis could find in them.

    Parameters
    ----------
    recordings
        Runs, frequency responses, and static tables: files or folders, or what `read_recordings` returned.

    Returns
    -------
    Result
        With `recordings`, `suspicions`, `shown` and `hidden`: effects that the recordings cannot reveal.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    from flexdesign.report.diagnosis import check_report

    given = [recordings] if isinstance(recordings, (str, Path)) else list(recordings)
    named = [Path(each) for each in given if isinstance(each, (str, Path))]
    files = [file for path in named for file in (sorted(path.glob("*.csv")) if path.is_dir() else [path])]
    tables = [path for path in files if is_table(path)]
    rest = [each for each in given if not isinstance(each, (str, Path)) or not _holds_only(Path(each), tables)]
    found = checking.check(read_recordings(rest) if rest else (), [facts(path) for path in tables])
    return Result(
        found,
        check_report.document(found),
        check_report.table(found),
        partial(check_report.result, found),
        numbers={each.effect: each.kinds for each in found.shown},
    )


def _holds_only(path: Path, tables: Sequence[Path]) -> bool:
    """Tell whether a path is a static table, or a folder of nothing else."""
    inside = sorted(path.glob("*.csv")) if path.is_dir() else [path]
    return bool(inside) and all(file in tables for file in inside)


def compare(
    model: str | Path | StageModel | Design,
    recordings: Recordings,
    changes: Sequence[str] = (),
    *,
    axis: str | None = None,
    noise: str | None = None,
    progress: Progress = lambda _: None,
) -> Result[Comparison] | Result[TableComparison]:
    """Compare a model with measurements: by how much it fails, and where.

    Parameters
    ----------
    model
        A stage model, or a design for static tables; its path or bare name.
    recordings
        Recordings, or CSV files of static tables.
    changes
        ``key=value`` of the model, as `--set` takes them.
    axis
        Which axis, where several could be meant.
    noise
        Standard deviation of the noise, ``"3 nm"``; estimated without it.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.diagnosis import comparison_report

    if static_tables.is_design(model):
        static_tables.refuse({"--axis": axis, "--noise": noise})
        return static_tables.compare(model, recordings, changes)
    stage, runs = read_model(_stage(model), changes), read_recordings(recordings)
    stated = additions.size(stage, runs, axis, "--noise", noise)
    found = initialised_comparison.compare(stage, runs, axis=axis, noise=stated, progress=progress)
    return Result(
        found,
        comparison_report.document(found),
        comparison_report.errors(found),
        partial(comparison_report.result, found),
        numbers={run.name: run.rms for run in found.runs},
    )


def identify(
    model: str | Path | StageModel,
    recordings: Recordings,
    changes: Sequence[str] = (),
    *,
    axis: str | None = None,
    free: Sequence[str] | None = None,
    progress: Progress = lambda _: None,
) -> Result[Identification]:
    """Fit the free parameters of a stage model to recorded runs, and say what the runs leave open.

    Parameters
    ----------
    model
        A stage model, its path or bare name.
    recordings
        Runs in time.
    changes
        ``key=value`` of the model.
    axis
        Which axis, where several could be meant.
    free
        What is fitted; None for gain, damping ratio, natural frequency and hysteresis.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.diagnosis import identification_report

    stage = read_model(model, changes)
    runs = reading.runs_alone(read_recordings(recordings))
    found = identification.identify(stage, runs, axis=axis, free=free, progress=progress)
    return Result(
        found,
        identification_report.document(found),
        identification_report.estimates(found),
        partial(identification_report.result, found),
        lambda folder: {"stage_model.toml": edit(model, found.model, folder)},
        {estimate.name: estimate for estimate in found.estimates},
    )


@dataclass(frozen=True, eq=False, repr=False)
class DiagnosisResult(Result[Diagnosis]):
    """The result of a diagnosis; `model` is the better stage model, with what is now known of its numbers.

    Parameters
    ----------
    better
        That model.
    """

    better: StageModel | None = None

    @property
    def model(self) -> StageModel:
        """The better stage model."""
        return self.better or self.found.model


def diagnose(
    model: str | Path | StageModel | Design,
    recordings: Recordings,
    changes: Sequence[str] = (),
    *,
    axis: str | None = None,
    effects: Sequence[str] = (),
    tolerance: str | None = None,
    noise: str | None = None,
    bare: bool = False,
    progress: Progress = lambda _: None,
) -> DiagnosisResult | Result[TableDiagnosis]:
    """Find which physical effect a model lacks, from measurements.

    Parameters
    ----------
    model
        A stage model, or a design for static tables; its path or bare name.
    recordings
        Recordings, or CSV files of static tables.
    changes
        ``key=value`` of the model.
    axis
        Which axis, where several could be meant.
    effects
        Files with effects of your own, tried with those of the catalogue.
    tolerance
        What matters, rms: ``"0.2 um"``, or ``"0.1 %"`` of the stroke, the largest peak-to-peak reading of a run.
    noise
        Standard deviation of the noise, ``"3 nm"``; estimated without it.
    bare
        For a design: begin with hinges that only rotate.
    progress
        Receives a text about the progress.

    Returns
    -------
    DiagnosisResult
        With `verdict`, `effects`, `ladder` and the better `model`.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.diagnosis import diagnosis_report, diagnosis_result

    if static_tables.is_design(model):
        static_tables.refuse({"--axis": axis, "--tolerance": tolerance, "--noise": noise})
        return static_tables.diagnose(model, recordings, changes, bare=bare, own=effects, progress=progress)
    static_tables.refuse_bare(bare)
    stage, runs = read_model(_stage(model), changes), read_recordings(recordings)
    more = own_effects(effects)
    least = additions.size(stage, runs, axis, "--tolerance", tolerance)
    stated = additions.size(stage, runs, axis, "--noise", noise)
    found = diagnosis.diagnose(
        stage, runs, axis=axis, more=more, tolerance=least, noise=stated, progress=Steps(progress)
    )
    apart = proposals(found, progress)
    better = additions.with_knowledge(found.model, found.axis, additions.values(found), (*found.runs, *found.responses))
    return DiagnosisResult(
        found,
        diagnosis_report.document(found, apart),
        diagnosis_report.ladder_table(found),
        partial(diagnosis_result.result, found, apart),
        lambda folder: {"stage_model.toml": edit(_stage(model), better, folder)},
        {named.name: named for named in found.effects},
        better=better,
    )


def add_effect(
    model: str | Path | StageModel | Design,
    effect: str,
    recordings: Recordings,
    changes: Sequence[str] = (),
    *,
    axis: str | None = None,
    noise: str | None = None,
    progress: Progress = lambda _: None,
) -> Result[AddedEffect] | Result[TableDiagnosis]:
    """Fit one effect to measurements, and put it into the model.

    Parameters
    ----------
    model
        A stage model, or a design for static tables; its path or bare name.
    effect
        Its name, or the path of a file.
    recordings
        Recordings, or CSV files of static tables.
    changes
        ``key=value`` of the model.
    axis
        Which axis, where several could be meant.
    noise
        Standard deviation of the noise, ``"3 nm"``; estimated without it.
    progress
        Receives a text about the progress.

    Returns
    -------
    Result
        With `model`, the model with the effect, and `ladder`, the fall of the error.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.diagnosis import addition_report

    if static_tables.is_design(model):
        static_tables.refuse({"--axis": axis, "--noise": noise})
        return static_tables.add_effect(model, effect, recordings, changes, progress=progress)
    name = known_effect(effect, "EFFECT")
    stage, runs = read_model(_stage(model), changes), read_recordings(recordings)
    stated = additions.size(stage, runs, axis, "--noise", noise)
    found = additions.add(stage, name, runs, axis=axis, noise=stated, progress=progress)
    loop = additions.in_the_loop((name,), found.axis, found.without, found.model, progress)
    return Result(
        found,
        addition_report.document(found, loop),
        addition_report.ladder_table(found),
        partial(addition_report.result, found, loop),
        lambda folder: {"stage_model.toml": edit(_stage(model), found.model, folder)},
        {value.parameter.name: value for value in found.values},
    )


def _stage(model: str | Path | StageModel | Design) -> str | Path | StageModel:
    assert not isinstance(model, Design)  # a design is for static tables
    return model
