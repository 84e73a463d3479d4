"""STEP files from Python: their faces, and a design to start from."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

from flexdesign.api.result import Result
from flexdesign.core.errors import InputError
from flexdesign.design import step_file, step_part
from flexdesign.design.faces import SolidFace
from flexdesign.fem.meshing import hinge_cuts, thin_regions
from flexdesign.fem.meshing.thin_regions import ThinRegions
from flexdesign.report import faces_report

Progress = Callable[[str], None]


@dataclass(frozen=True)
class StepFaces:
    """What a STEP file holds.

    Parameters
    ----------
    file
        The file.
    body
        Its solid, with notes on what was done to it.
    faces
        The faces of the solid.
    thin
        Where it is thin.
    """

    file: Path
    body: step_file.StepBody
    faces: tuple[SolidFace, ...]
    thin: ThinRegions

    def design_for(self, folder: Path) -> str:
        """Return a design to start from, for a file in a folder."""
        return faces_report.design(os.path.relpath(self.file, folder), self.faces, self.body.solids, self.bodies)

    @cached_property
    def bodies(self) -> tuple[int | None, ...]:
        """The body that each face is on, of those that hinges join; None of several."""
        return hinge_cuts.bodies_of(self.body.solid, self.faces, self.thin)


def read_ports(
    file: str | Path, *, solids: Sequence[str] = (), progress: Progress = lambda _: None
) -> Result[StepFaces]:
    """Read the faces of a STEP file.

    Parameters
    ----------
    file
        The file.
    solids
        Names or numbers of the solids that are meant, where it holds several; by default all.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If the file cannot be read, is no closed solid, or has no solid of a name.
    """
    path = Path(file)
    if not step_part.is_step(path.name):
        raise InputError("command line", "STEP", str(file), "is no STEP file; its name ends in .step or .stp")
    progress("reading the solid")
    body = step_file.read(path, tuple(solids))
    progress("looking where it is thin")
    found = StepFaces(path, body, step_part.listed(body), thin_regions.find(body.solid))
    return Result(
        found,
        faces_report.document(path, body, found.faces, found.thin, found.design_for(path.parent), progress),
        faces_report.brief(found.faces),
        partial(faces_report.result, body, found.faces, found.thin),
        is_table_first=True,
    )
