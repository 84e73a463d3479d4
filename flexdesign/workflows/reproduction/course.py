"""From a file of printed numbers to rows with verdicts: the stage by finite elements, then the experiments."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from flexdesign.core import printed_numbers
from flexdesign.core.printed_numbers import Publication
from flexdesign.core.result_cache import Cache
from flexdesign.design import study as studies
from flexdesign.dynamics import experiments, stage_model
from flexdesign.dynamics.experiments import simulation
from flexdesign.dynamics.experiments.simulation import Simulation
from flexdesign.workflows.reproduction import bench, statics
from flexdesign.workflows.reproduction.items import VERDICTS, Item
from flexdesign.workflows.validation.validate_stage import StageValidation, validate_stage

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Reproduction:
    """A publication compared with ours.

    Parameters
    ----------
    paper
        What it prints.
    stage, experiments
        What ours are made of.
    items
        The rows, in the order of the paper's systems.
    seconds
        How long it took.
    """

    paper: Publication
    stage: StageValidation
    experiments: Simulation
    items: tuple[Item, ...]
    seconds: float

    def counted(self) -> Mapping[str, int]:
        """Return how many rows have each verdict."""
        return {verdict: sum(item.verdict == verdict for item in self.items) for verdict in VERDICTS}

    def unused(self) -> list[tuple[str, str]]:
        """Return place and name of the printed numbers that no row uses."""
        used = {key for item in self.items for key in item.uses}
        return [key for key in self.paper.printed if key not in used]


def reproduce(
    name: str | Path, cache: Cache, progress: Progress = lambda _: None, overrides: Sequence[str] = ()
) -> Reproduction:
    """Compare every number that a publication prints with ours.

    Parameters
    ----------
    name
        Of the file of printed numbers.
    cache
        Where meshes and condensed parts are kept.
    progress
        Receives a text about the progress.
    overrides
        For the study of the stage, ``table.key=value``.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    began = perf_counter()
    paper = printed_numbers.read(name)
    study = replace(studies.read(paper.stage, overrides), variants={})
    stage = validate_stage(study, cache, lambda text: progress(f"stage: {text}"))
    model = stage_model.read(paper.model)
    plan = experiments.read(paper.experiments, list(model.axes))
    variants = experiments.variants(plan, lambda changes: stage_model.read(paper.model, changes))
    found = simulation.run(model, variants, plan, lambda text: progress(f"experiments: {text}"))
    progress("comparing")
    items = sorted([*statics.items(paper, stage), *bench.items(paper, found)], key=lambda item: int(item.system[1:]))
    return Reproduction(paper, stage, found, tuple(items), perf_counter() - began)
