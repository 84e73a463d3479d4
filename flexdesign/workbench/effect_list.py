"""The effects in the tab Confront: boxes to tick, each with what it would explain."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from flexdesign.workbench.client import Client

if TYPE_CHECKING:
    from flexdesign.api.confrontation import EffectOffer

#: Effects that are listed at once; the others are one click away.
LISTED = 8
#: Puts the keyboard back on a box that was laid out anew, unless it has gone elsewhere.
FOCUS = """
setTimeout(() => {
  const box = document.querySelector(`[data-effect="${CSS.escape(%s)}"]`);
  if (document.activeElement === document.body) box?.focus({preventScroll: true});
}, 100);
"""


class EffectList:
    """The effects that a model has, and those that may be added.

    Parameters
    ----------
    client
        Work and notices of this client.
    tick
        Called with the names that are ticked after a box was changed.
    """

    def __init__(self, client: Client, tick: Callable[[list[str]], Awaitable[None]]) -> None:
        self.client, self._tick = client, tick
        self.ticked: list[str] = []
        self.offers: Sequence[EffectOffer] = ()
        # The effects in the model for which the evidence of the others was gathered, and whether that is going on.
        self.weighed: tuple[str, ...] | None = None
        self.is_weighing, self._reason, self._changed_last = False, "", ""

    def build(self) -> None:
        """Lay out its place."""
        ui.label("Effects").classes("text-subtitle1").props("role=heading aria-level=3")
        self.place = ui.column().classes("w-full gap-1").mark("effects")

    def show(self, ticked: Sequence[str], reason: str = "") -> None:
        """Show a model.

        Parameters
        ----------
        ticked
            Effects that it has.
        reason
            Why the last of them is not needed; empty if it is.
        """
        self.ticked, self._reason = list(ticked), reason
        self.refresh()

    def refresh(self) -> None:
        """Lay the boxes out as they are ticked now."""
        self.place.clear()
        listed = [each for each in self.offers if each.name not in self.ticked]
        with self.place:
            for name in self.ticked:
                self._box(name, name.replace("_", " "), True).classes("font-medium")
            if self._reason:
                ui.label(f"Not needed: {self._reason}.").classes("text-caption")
            if not self.offers:
                ui.label("They are listed when the numbers of the model are fitted.").classes("text-caption")
            for offer in listed[:LISTED]:
                self._offer(offer)
            if listed[LISTED:]:
                with ui.expansion(f"{len(listed) - LISTED} more").classes("w-full"):
                    for offer in listed[LISTED:]:
                        self._offer(offer)
        if self._changed_last:
            self.client.run_javascript(FOCUS % json.dumps(self._changed_last))

    def _offer(self, offer: EffectOffer) -> None:
        if offer.share is None or self.weighed != tuple(self.ticked):  # a result with other effects does not apply
            share = "being asked" if self.is_weighing else "not asked"
        else:
            share = f"explains {100 * offer.share:.0f} %" if offer.share >= 0.005 else "not significant"
        with ui.row().classes("w-full items-center no-wrap justify-between"):
            self._box(offer.name, offer.called, False).tooltip(offer.physics)
            ui.label(share).classes("text-caption")

    def _box(self, name: str, called: str, is_ticked: bool) -> ui.checkbox:
        box = ui.checkbox(called, value=is_ticked, on_change=partial(self._changed, name))
        return box.props(f'data-effect="{name}"')

    async def _changed(self, name: str, event: Any) -> None:
        self.ticked, self._changed_last = [each for each in self.ticked if each != name], name
        if event.value:
            self.ticked.append(name)
        await self._tick(list(self.ticked))
