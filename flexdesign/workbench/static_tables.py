"""The tab Confront where the model is a design: its compliance model against static tables."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

import flexdesign as fd
from flexdesign.workbench.client import Client, field_error
from flexdesign.workbench.work import Cancelled


class StaticTables:
    """A design and static tables; each question is answered by a process of its own.

    Parameters
    ----------
    client
        Folder, work and notices of this client.
    design, tables
        Path or bare name of the design, and the files of its tables.
    own
        Files with effects of the user, tried with the others.
    """

    def __init__(self, client: Client, design: str, tables: list[str], own: list[str]) -> None:
        self.client, self.design, self.tables, self.own = client, design, tables, own

    async def build(self) -> None:
        """Lay the questions out, and compare."""
        first = self.client.register_upload(Path(self.own[0])) if self.own else "over_cut"
        with ui.row().classes("w-full items-start"):
            ui.button("Compare", on_click=partial(self._ask, "compare")).props("no-caps outline")
            ui.button("Find what is missing", on_click=self._diagnose).props("no-caps outline")
            self.effect = ui.input("Static effect (name or path)", value=first)
            self.effect.classes("grow").props("outlined dense")
            ui.button("Fit this effect", on_click=self._fit).props("no-caps outline")
        self.problem = ui.label("").classes("fd-error").props("role=alert")
        self.said = ui.column().classes("w-full").props("aria-live=polite").mark("static")
        await self._ask("compare")

    async def _diagnose(self) -> None:
        await self._ask("diagnose", effects=self.own)

    async def _fit(self) -> None:
        try:
            effect = self.client.path_of(str(self.effect.value or ""))
        except fd.InputError as error:
            field_error(self.effect, str(error))
            return
        await self._ask("add_effect", effect)

    async def _ask(self, verb: str, *between: str, **options: Any) -> None:
        field_error(self.problem, "")
        field_error(self.effect, "")
        if not await self.client.is_free():
            return
        folder = self.client.new_folder(verb)
        try:
            found = await self.client.work.in_process(verb, [self.design, *between, self.tables], options, folder)
        except Cancelled:
            self.client.notice("Cancelled: the process was ended, nothing was written.")
            return
        except fd.InputError as error:
            field_error(self.effect if between else self.problem, error.remedy)
            return
        self.said.clear()
        with self.said:
            self.client.answer(found, folder)
