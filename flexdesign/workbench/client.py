"""What belongs to one client, a tab of a browser: its folder, its work, its notices, its files."""

from __future__ import annotations

import json
import re
import secrets
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

from nicegui import app, events, run, ui

import flexdesign as fd
from flexdesign.core import units
from flexdesign.workbench import charts
from flexdesign.workbench.work import Work

#: The largest file that may be uploaded [bytes].
LARGEST_UPLOAD = 200 * 2**20
#: Seconds between two looks at what is going on.
LOOK = 0.2
#: Start of the names of clients' folders, and the path of such a folder in a message.
FOLDER = "flexdesign-workbench-"
_PATH = re.compile(rf"[^\s\"']*/{FOLDER}\w+/(?:[\w.-]+/)*")
#: What follows the name of an uploaded file in a field.
UPLOADED = " (uploaded)"


def field_error(field: Any, text: str) -> None:
    """Say in words next to a field what is wrong with it; nothing if the text is empty.

    Files of clients are named without their folder on the server.
    """
    text = _PATH.sub("", text)
    if isinstance(field, ui.label):
        field.set_text(text)
    else:
        field.error = text or None


class Client:
    """One client.

    `work` is what it waits for; its files are in a folder of their own, which goes with it.
    """

    def __init__(self) -> None:
        self.work, self._tab = Work(), ui.context.client
        self.folder = Path(tempfile.mkdtemp(prefix=FOLDER))
        self.address = f"/files/{secrets.token_urlsafe(16)}"
        app.add_static_files(self.address, self.folder)
        self._remembered: dict[str, str] = {}
        self._uploads: dict[str, Path] = {}
        self._lasts = False
        self.palette, self.on_scheme = charts.LIGHT, list[Callable[[], None]]()

    def build(self) -> None:
        """Lay out the line that says what is going on, and the place of notices."""
        with ui.element("div").classes("fd-foot"):
            self.notices = ui.element("div").props("aria-live=assertive").mark("notices")
            with ui.row().classes("fd-status items-center no-wrap").props("role=status") as line:
                ui.icon("hourglass_top").props("aria-hidden=true")  # one that turns would cost what the work needs
                message = ui.label("").classes("grow").mark("progress")
                ui.button("Cancel", on_click=self.work.cancel).props("no-caps outline dense padding='4px 12px'")
        line.set_visibility(False)

        def look() -> None:
            line.set_visibility(self.work.is_busy)
            message.set_text(self.work.message)

        ui.timer(LOOK, look)

    def choose_scheme(self, *, dark: bool) -> None:
        """Take the scheme that the reader's system prefers; what draws its own colours draws anew."""
        palette = charts.DARK if dark else charts.LIGHT
        if palette is not self.palette:
            self.palette = palette
            for draw in self.on_scheme:
                draw()

    def end(self) -> None:
        """End the work and remove the files of a client that is gone."""
        self.work.cancel()
        app.remove_route(self.address)
        shutil.rmtree(self.folder, ignore_errors=True)

    def notice(self, text: str, *, lasting: bool = False) -> None:
        """Show a notice in the place of the one before, until it is closed; one that is not lasting, until work begins.

        It stands at the foot of the window, where the button was that it answers, however far the page was scrolled.
        """
        self._lasts = lasting
        self.notices.clear()
        with self.notices, ui.row().classes("fd-notice items-center no-wrap"):
            ui.label(text).classes("grow").props("role=alert")
            ui.button("Close", on_click=self.notices.clear).props("no-caps flat dense text-color=inherit")

    def remember(self, **state: str) -> None:
        """Write the inputs into the address of the page, which then opens as it is now."""
        self._remembered |= state
        self.run_javascript(
            "const q = new URLSearchParams(window.location.search);"
            f"for (const [k, v] of Object.entries({json.dumps(self._remembered)})) q.set(k, v);"
            "history.replaceState(null, '', '?' + q.toString());"
        )

    def run_javascript(self, code: str) -> None:
        """Run a script in the tab, wherever in the page it was asked for: that place may be gone by now."""
        self._tab.run_javascript(code)

    async def is_free(self) -> bool:
        """Tell whether something may begin; say so if not."""
        if await self.work.is_free():
            if not self._lasts:
                self.notices.clear()
            return True
        self.notice("Something is being done; cancel it first, or wait.")
        return False

    def new_folder(self, name: str) -> Path:
        """Return an empty folder for a report."""
        return Path(tempfile.mkdtemp(prefix=f"{name}-", dir=self.folder))

    def register_upload(self, path: Path) -> str:
        """Return the name by which fields show an uploaded file: not that of its place on the server."""
        name = f"{path.name}{UPLOADED}"
        self._uploads[name] = path
        return name

    def path_of(self, text: str) -> str:
        """Return the path that a field means: that of an uploaded file, or the text as it stands.

        Raises
        ------
        InputError
            If the file was uploaded to a server that has ended since.
        """
        text = text.strip()
        if text.endswith(UPLOADED) and text not in self._uploads:
            raise fd.InputError(text.removesuffix(UPLOADED), "", None, "is no longer on the server: upload it again")
        return str(self._uploads.get(text, text))

    def with_paths(self, text: str) -> str:
        """Return a text with the paths of uploaded files in the place of their names."""
        for name, path in self._uploads.items():
            text = text.replace(f'"{name}"', f'"{path.as_posix()}"')
        return text

    def url(self, path: Path) -> str:
        """Return the address of a file in the folder of this client."""
        return f"{self.address}/{path.relative_to(self.folder).as_posix()}"

    def links(self, folder: Path) -> None:
        """Show links to the report of a folder and to the files next to it."""
        with ui.row():
            for path in sorted(folder.iterdir()):
                if path.is_file() and path.suffix not in (".svg", ".png"):
                    ui.link(path.name, self.url(path), new_tab=True)

    def answer(self, found: Mapping[str, Any], folder: Path) -> None:
        """Show what a process found: its sentences, its table, its files."""
        ui.label(found["title"]).classes("text-subtitle1")
        for text in found["summary"]:
            ui.label(units.typeset(_PATH.sub("", text)))
        ui.html(charts.table(found["columns"], found["rows"]), sanitize=False).classes("w-full fd-scroll")
        self.links(folder)

    def upload(
        self,
        label: str,
        endings: tuple[str, ...],
        came: Callable[[Path], Awaitable[None] | None],
        check: Callable[[Path], object] | None = None,
    ) -> None:
        """Lay out a field for files of the user, which are read as those of the command line are.

        Parameters
        ----------
        label
            What is expected.
        endings
            How the names of its files may end.
        came
            Takes the file that came.
        check
            Reads it; raises InputError if it cannot be used.
        """
        folder = self.new_folder("upload")

        async def keep(event: events.UploadEventArguments) -> None:
            field_error(problem, "")
            path = folder / Path(event.file.name.replace("\\", "/")).name
            try:
                if path.suffix.lower() not in endings or path.name.startswith("."):
                    raise fd.InputError(event.file.name, "", None, f"is of no use here; choose {' or '.join(endings)}")
                await event.file.save(path)
                if check is not None:
                    await run.io_bound(check, path)
            except fd.InputError as error:
                field.reset()  # its tick would say that the file is taken
                field_error(problem, str(error))
                return
            if (going := came(path)) is not None:
                await going

        def refuse() -> None:
            field_error(problem, f"A file is too large or its name does not end in {' or '.join(endings)}.")

        with ui.column().classes("gap-0 min-w-[260px] grow"):
            field = ui.upload(
                label=label,
                multiple=True,
                auto_upload=True,
                max_file_size=LARGEST_UPLOAD,
                on_upload=keep,
                on_rejected=refuse,
            )
            field.props(f'flat bordered accept="{",".join(endings)}"')
            problem = ui.label("").classes("fd-error").props("role=alert")
