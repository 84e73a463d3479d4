"""``flexdesign import``: recordings of other programs made into a folder of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import app

HELP = """Bring recordings of other programs into a folder of runs.

FILES are .mat (any version), HDF5, .tdms, universal files (.uff, .unv: data set 58), .npy, .npz, or tables in text with
any separator, decimal commas and lines above the header; arrays may be complex. Without --map it prints what they hold
as a map to complete; with one it writes a CSV file for each run or frequency response, and `measurements.toml`, reads
them back, and says what is wrong with them.

**Examples**

    flexdesign import sweep.mat > map.toml

    flexdesign import sweep.mat --map map.toml -o recordings/sweep

    flexdesign import u.npy y.npy --map map.toml -o recordings/mirror

    flexdesign import scope_*.csv --map map.toml -o recordings/scope

**What a map says:** which variable is which column (`variable`, `unit`, `scale`, `offset`, `channel`, `input`), the
sample `rate` where there is no column t, and the `axes` of arrays: sample or frequency, channel, input, realisation (a
run each), period (in a row). What `measurements.toml` may say is passed on. With `per_file = true` one map serves
many files of the same variables: each file makes runs of its own, named after it.

**Frequency responses** have a column `f` and a complex one, `response`; or `magnitude` and `phase`; or `re` and `im`;
and `coherence` where it was recorded.

**Arithmetic:** a column may be computed, `formula = "qg + pulse / (kv * kp)"`, of variables of the files, of those in
`[variables.NAME]`, and of `[constants]` such as `kv = "243 V s/m"`. It has + - * / **, parentheses, pi, abs, sqrt, exp,
sin, cos, real, imag, conj, angle. Units are checked, and converted to the `unit` of the column.

**What it needs:** `pip install 'flexdesign[import]'` for HDF5, .mat of version 7.3, .tdms and universal files.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.
"""


@app.command(name="import", help=HELP)
def import_(
    recordings: Annotated[list[Path], typer.Argument(metavar="FILES...", help="Recordings, read together.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Which variable is which column.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="The folder [default: recordings/FILE].")
    ] = None,
) -> None:
    """Show what files hold, or write their runs."""
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
