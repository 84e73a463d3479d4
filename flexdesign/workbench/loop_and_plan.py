"""Below the curves: the closed loop before and after, and what to measure next."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from nicegui import ui

import flexdesign as fd
from flexdesign.core import units
from flexdesign.workbench import charts
from flexdesign.workbench.client import Client, field_error
from flexdesign.workbench.work import Cancelled

if TYPE_CHECKING:
    from flexdesign.api.confrontation import Confrontation


class LoopAndPlan:
    """Two cards of the tab Confront.

    Parameters
    ----------
    client
        Folder, work and notices of this client.
    session, model
        The confrontation, and what its model was read from.
    ticked
        The effects that are ticked: a list that the tab changes.
    resume
        Goes on with the work that this one ended.
    """

    def __init__(
        self,
        client: Client,
        session: Confrontation | None,
        model: str,
        ticked: list[str],
        resume: Callable[[], Awaitable[None]],
    ) -> None:
        self.client, self.session, self.model, self.ticked, self.resume = client, session, model, ticked, resume

    def build(self) -> None:
        """Lay the cards out."""
        with ui.card().classes("w-full"):
            ui.label("What to measure next").classes("text-subtitle1").props("role=heading aria-level=3")
            with ui.row().classes("w-full items-start"):
                self.slew = ui.input("Slew limit [V/s]", value="5000").props("outlined dense inputmode=decimal")
                self.noise = ui.input("Sensor noise [nm]", value="20").props("outlined dense inputmode=decimal")
                self.apart = ui.input("Effects to distinguish (two, separated by a comma)").classes("grow")
                self.apart.props("outlined dense")
                ui.button("Plan", on_click=self._plan).props("no-caps outline")
            self.planned = ui.column().classes("w-full").props("aria-live=polite")
        with ui.card().classes("w-full"):
            ui.label("Closed loop before and after").classes("text-subtitle1").props("role=heading aria-level=3")
            ui.button("Close the loop", on_click=self._loop).props("no-caps outline")
            self.looped = ui.column().classes("w-full").props("aria-live=polite")

    async def _plan(self) -> None:
        for each in (self.slew, self.noise, self.apart):
            field_error(each, "")
        if not await self.client.is_free():
            return
        options: dict[str, object] = {"slew": f"{self.slew.value} V/s", "sensor_noise": f"{self.noise.value} nm"}
        if names := [each.strip().replace(" ", "_") for each in str(self.apart.value or "").split(",") if each.strip()]:
            options["resolve"] = names
        folder = self.client.new_folder("plan")
        try:
            found = await self.client.work.in_process("plan", [self.model], options, folder)
        except Cancelled:
            self.client.notice("Cancelled: nothing was planned.")
            return
        except fd.InputError as error:
            text = str(error)
            field_error(self.slew if "slew" in text else self.noise if "noise" in text else self.apart, text)
            return
        self.planned.clear()
        with self.planned:
            self.client.answer(found, folder)
        await self.resume()

    async def _loop(self) -> None:
        session = self.session
        self.looped.clear()
        with self.looped:
            if not self.ticked:
                ui.label("Tick an effect first: the loop is shown without and with it.")
                return
        if session is None or not await self.client.is_free():
            return
        try:
            found = await self.client.work.in_thread("closing the loop", session.loop, self.ticked)
        except Cancelled:
            self.client.notice("Cancelled: no loop was closed.")
            return
        except fd.InputError as error:
            self.client.notice(str(error))
            return
        with self.looped:
            for text in found.document.summary:
                ui.label(units.typeset(text))
            ui.html(charts.table(found.table.columns, found.table.rows, found.table.caption), sanitize=False).classes(
                "fd-scroll"
            )
            for figure in found.document.figures:
                ui.html(figure.data.decode(), sanitize=False).classes("w-full fd-svg")
                ui.label(units.typeset(figure.caption)).classes("text-caption")
        await self.resume()
