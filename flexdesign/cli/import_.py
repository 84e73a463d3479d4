"""``flexdesign import``: convert recordings of other programs to a folder of runs."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import MEASUREMENTS, app
from flexdesign.core import units
from flexdesign.core.errors import printable

HELP = """Convert recordings of other programs to a folder of runs.

FILES are .mat (any version), HDF5, .tdms, universal files (.uff, .unv: data set 58), .npy, .npz, or text tables with
any separator, decimal commas and lines above the header; arrays may be complex. Time, command, response, reference,
current, force, temperature and frequency responses are recognised by names and units in several languages, and the
command says how each column was understood. It asks for what the files do not say in one message: the printed map with
`?` where an answer is needed. Save it, answer, and pass it with --map. Output: a CSV file for each run or frequency
response, and `measurements.toml`, read back; faults are reported.

**Examples**

    flexdesign import scope_*.csv -o recordings/scope

    flexdesign import sweep.mat > map.toml

    flexdesign import u.npy y.npy --map map.toml -o recordings/mirror

**Map:** the variable of each column (`variable`, `unit`, `scale`, `offset`, `channel`, `input`), the sampling `rate` if
there is no column t, and the `axes` of arrays: sample or frequency, channel, input, realisation (one run each), period
(in sequence). Keys of `measurements.toml` are passed on. With `per_file = true` one map applies to many files: each
file gives its own runs, named after it. A `[[run]]` with `files = ["scope_*.csv"]` is for these files alone.

**Frequency responses** have a column `f` and a complex one, `response`; or `magnitude` and `phase`; or `re` and `im`;
and `coherence` if it was recorded.

**Arithmetic:** a column may be computed, `formula = "qg + pulse / (kv * kp)"`, from variables of the files, those in
`[variables.NAME]`, and `[constants]` such as `kv = "243 V s/m"`. Operators and functions are + - * / **, parentheses,
pi, abs, sqrt, exp, sin, cos, real, imag, conj, angle. Units are checked, and converted to the `unit` of the column.

**Requirement:** `pip install 'flexdesign[import]'` for HDF5, .mat of version 7.3, .tdms and universal files.

**Exit codes:** 0 done; 2 unusable input or a map to complete, with one message that names the cause; 1 internal error;
130 interrupted.
"""


@app.command(name="import", help=HELP, rich_help_panel=MEASUREMENTS)
def import_(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="FILES...", help="Recordings, read together, or a folder of them.")
    ],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Map of variables to columns.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="The folder [default: recordings/FILE].")
    ] = None,
    print_map: Annotated[bool, typer.Option("--print-map", help="Only print the map, complete or not.")] = False,
) -> None:
    """Write the runs of the files, or print the map that is to be completed."""
    from flexdesign.measurements import importing

    folder = out or Path("recordings") / recordings[0].stem
    recordings = importing.list_files(recordings)
    if map_file is not None:
        found = importing.bring_in(recordings, map_file, folder)
    else:
        proposal = importing.proposal(recordings)
        if print_map or proposal.questions:
            typer.echo(proposal.text, nl=False)
        if print_map:
            return
        if proposal.questions:
            raise importing.asking(recordings, proposal.questions)
        found = importing.bring_in(recordings, proposal.map(), folder)
        typer.echo(f"Understood {', '.join(proposal.understood)}.")
        typer.echo("If that is wrong: add --print-map > map.toml, correct the map, and pass it with --map map.toml.")
        if proposal.left_out:
            typer.echo(f"Left out: {', '.join(map(printable, proposal.left_out))}.")
    for run in found.runs:
        names = ", ".join([*run.commands, *(name for name in run.columns if name not in run.commands)])
        rate = units.hertz(1 / run.period, 6)
        typer.echo(f"{found.folder / run.name}.csv: {len(run.time)} samples at {rate}: {names}")
        for remark in run.remarks:
            typer.echo(f"  {remark}")
    for response in found.responses:
        lines = f"{response.frequencies[0]:.6g} to {units.hertz(response.frequencies[-1], 6)}"
        typer.echo(
            f"{found.folder / response.name}.csv: frequency response, {len(response.frequencies)} lines, {lines}"
        )
        for remark in response.remarks:
            typer.echo(f"  {remark}")
    typer.echo(f"{found.folder / 'measurements.toml'}")
    typer.echo(f"Next: flexdesign check {shlex.quote(str(found.folder))}")
