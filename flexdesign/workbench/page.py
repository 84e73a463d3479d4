"""The page and its server."""

from __future__ import annotations

import asyncio
import json
import secrets
from pathlib import Path
from urllib.parse import urlencode

from nicegui import app, ui

from flexdesign.workbench.access import Guard, is_local, new_token
from flexdesign.workbench.client import Client
from flexdesign.workbench.confront_tab import ConfrontTab
from flexdesign.workbench.design_tab import DesignTab

#: Tells one start of the server from another.
SERVER = secrets.token_hex(8)
#: Seconds for which the server keeps the state of a tab that has lost its connection.
RECONNECT = 20.0
#: What a page asks and states as it opens: which server it used before, and which scheme its reader prefers.
WHICH = """
const dark = matchMedia('(prefers-color-scheme: dark)');
dark.addEventListener('change', () => emitEvent('scheme', dark.matches));
const before = sessionStorage.getItem('flexdesign-server');
sessionStorage.setItem('flexdesign-server', %s);
return [before, dark.matches];
"""


async def page(model: str = "", runs: str = "", effects: str = "") -> None:
    """Lay out the page of one client.

    Parameters
    ----------
    model, runs, effects
        What is confronted as the page opens: a stage model, recordings separated by semicolons, effects by commas.
    """
    client = Client()
    ui.context.client.on_delete(client.end)
    ui.colors(primary="#0b5fa5", secondary="#37474f", accent="#0b5fa5", negative="#b3261e")
    ui.dark_mode(None)  # as the reader's system has it
    ui.on("scheme", lambda event: client.choose_scheme(dark=bool(event.args)))
    ui.add_css(Path(__file__).with_name("style.css"))
    ui.page_title("flexdesign workbench")
    with ui.header().classes("items-center"):
        ui.label("flexdesign workbench").classes("text-h6").props("role=heading aria-level=1")
        with ui.tabs().props("no-caps") as tabs:
            ui.tab("Confront")
            ui.tab("Design")
    client.build()
    confront, design = ConfrontTab(client), DesignTab(client)
    with ui.tab_panels(tabs, value="Confront").props("keep-alive").classes("w-full"):
        with ui.tab_panel("Confront"):
            confront.build()
        with ui.tab_panel("Design"):
            design.build()
    confront.model.value, confront.runs.value = model, runs
    await ui.context.client.connected(timeout=30.0)
    try:
        before, is_dark = await ui.run_javascript(WHICH % json.dumps(SERVER), timeout=10.0)
    except TimeoutError:  # the tab was closed, or left for another page
        return
    client.choose_scheme(dark=is_dark)
    if before not in (None, SERVER):
        client.notice(
            "The server was restarted: work that was going on has ended. The inputs are loaded anew.", lasting=True
        )
    if model and runs:
        await asyncio.sleep(0)
        await confront.load([each for each in effects.split(",") if each])


def serve(
    host: str = "127.0.0.1", port: int = 8080, *, show: bool = True, model: str = "", runs: str = "", token: str = ""
) -> None:
    """Serve the page until interrupted.

    Parameters
    ----------
    host, port
        Where; another host than this machine needs a token.
    show
        Whether a browser is opened.
    model, runs
        What is confronted as the page opens.
    token
        What a request must have, if the host is another; made where it is empty.
    """
    secret = "" if is_local(host) else (token or new_token())
    app.add_middleware(Guard, token=secret)
    query = {"token": secret, "model": model, "runs": runs}
    address = f"/?{urlencode({key: value for key, value in query.items() if value})}"
    ui.page("/", reconnect_timeout=RECONNECT, response_timeout=60.0)(page)
    print(
        f"The workbench is at http://{host}:{port}{address if len(address) > 2 else '/'}; Ctrl-C ends it.", flush=True
    )
    ui.run(
        host=host, port=port, title="flexdesign workbench", reload=False, show=address if show else False,
        show_welcome_message=False, reconnect_timeout=RECONNECT, language="en-US", tailwind=True,
    )  # fmt: skip
