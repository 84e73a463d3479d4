"""``flexdesign workbench``: a local page on which a model is confronted with recordings, and a design is changed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import MEASUREMENTS, app

HELP = """Open a local page: confront a model with recordings, and change a design.

MODEL is a stage model and RUNS are its recordings, as for `diagnose`; without them the page asks.

**Examples**

    flexdesign workbench

    flexdesign workbench studies/hidden_effect_demo/model.toml studies/hidden_effect_demo/runs

**Confront:** measured against modelled, run by run; each effect with what it would explain; tick one and it is fitted;
numbers as sliders; what to measure next; the closed loop before and after; save the model, export the report.

**Design:** dimensions as sliders with the answer of the compliance model; finite elements, sweeps and optimisation in a
process that can be cancelled; designs, sketches and STEP files of your own.

The page is served on this machine alone and sends no request to the network. With another --host, anyone with the
token in the printed address can open it.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=MEASUREMENTS)
def workbench(
    model: Annotated[str | None, typer.Argument(help="Stage model: a path, or a bare name.")] = None,
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="[RUNS]...", help="Recorded runs: files or folders.")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to serve on; any other than this machine's needs the token.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to serve on.")] = 8080,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
) -> None:
    """Serve the page until it is interrupted."""
    from flexdesign.core.errors import InputError

    try:
        from flexdesign.workbench import page
    except ImportError as error:
        remedy = 'is not installed; run pip install "flexdesign[workbench]"'
        raise InputError("environment", error.name or "nicegui", None, remedy) from None
    _check(model, recordings or [], host, port)
    page.serve(host, port, show=browser, model=model or "", runs=";".join(map(str, recordings or [])))


def _check(model: str | None, recordings: list[Path], host: str, port: int) -> None:
    """Raise InputError for a model or runs that cannot be read, or for an address that is taken."""
    import socket

    import flexdesign as fd
    from flexdesign.core.errors import InputError

    if model is not None:
        fd.read_model(model)
        if not recordings:
            raise InputError("command line", "RUNS", None, "name the recordings that the model is confronted with")
        fd.read_recordings(recordings)
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind((host, port))
    except OSError as error:
        remedy = f"cannot be served on ({error.strerror or error}); choose another --port or --host"
        raise InputError("command line", "--port", f"{host}:{port}", remedy) from error
