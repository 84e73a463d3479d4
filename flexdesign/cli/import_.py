"""``flexdesign import``: convert recordings of other programs to a folder of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import app

HELP = """Convert recordings of other programs to a folder of runs.

FILES are .mat (any version), HDF5, .tdms, universal files (.uff, .unv: data set 58), .npy, .npz, or text tables with
any separator, decimal commas and lines above the header; arrays may be complex. Without --map, the command prints the
content of the files as a map to complete. With a map it writes a CSV file for each run or frequency response, and
`measurements.toml`, reads them back, and reports faults.

**Examples**

    flexdesign import sweep.mat > map.toml

    flexdesign import sweep.mat --map map.toml -o recordings/sweep

    flexdesign import u.npy y.npy --map map.toml -o recordings/mirror

    flexdesign import scope_*.csv --map map.toml -o recordings/scope

**Map:** the variable of each column (`variable`, `unit`, `scale`, `offset`, `channel`, `input`), the sampling `rate` if
there is no column t, and the `axes` of arrays: sample or frequency, channel, input, realisation (one run each), period
(in sequence). Keys of `measurements.toml` are passed on. With `per_file = true` one map applies to many files of the
same variables: each file gives its own runs, named after it.

**Frequency responses** have a column `f` and a complex one, `response`; or `magnitude` and `phase`; or `re` and `im`;
and `coherence` if it was recorded.

**Arithmetic:** a column may be computed, `formula = "qg + pulse / (kv * kp)"`, from variables of the files, those in
`[variables.NAME]`, and `[constants]` such as `kv = "243 V s/m"`. Operators and functions are + - * / **, parentheses,
pi, abs, sqrt, exp, sin, cos, real, imag, conj, angle. Units are checked, and converted to the `unit` of the column.

**Requirement:** `pip install 'flexdesign[import]'` for HDF5, .mat of version 7.3, .tdms and universal files.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(name="import", help=HELP)
def import_(
    recordings: Annotated[list[Path], typer.Argument(metavar="FILES...", help="Recordings, read together.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Map of variables to columns.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="The folder [default: recordings/FILE].")
    ] = None,
) -> None:
    """Print the map of the files, or write their runs."""
    from flexdesign.measurements import importing

    if map_file is None:
        typer.echo(importing.propose(recordings), nl=False)
        return
    found = importing.bring_in(recordings, map_file, out or Path("recordings") / recordings[0].stem)
    for run in found.runs:
        names = ", ".join([*run.commands, *(name for name in run.columns if name not in run.commands)])
        rate = f"{1 / run.period:.6g} Hz"
        typer.echo(f"{found.folder / run.name}.csv: {len(run.time)} samples at {rate}: {names}")
        for remark in run.remarks:
            typer.echo(f"  {remark}")
    for response in found.responses:
        lines = f"{response.frequencies[0]:.6g} to {response.frequencies[-1]:.6g} Hz"
        typer.echo(
            f"{found.folder / response.name}.csv: frequency response, {len(response.frequencies)} lines, {lines}"
        )
        for remark in response.remarks:
            typer.echo(f"  {remark}")
    typer.echo(f"{found.folder / 'measurements.toml'}")
