"""The tab Confront: measured against modelled; effects are ticked, numbers are moved, and the residual answers."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import run, ui

import flexdesign as fd
from flexdesign.api.static_tables import is_design
from flexdesign.core import units
from flexdesign.workbench import charts
from flexdesign.workbench.client import Client, field_error
from flexdesign.workbench.effect_list import EffectList
from flexdesign.workbench.loop_and_plan import LoopAndPlan
from flexdesign.workbench.static_tables import StaticTables
from flexdesign.workbench.work import Cancelled

if TYPE_CHECKING:
    from flexdesign.api.confrontation import Confrontation
    from flexdesign.diagnosis.confrontation import AdjustableParameter, Confronted

#: The demo of `make demo`.
DEMO = ("studies/hidden_effect_demo/model.toml", "studies/hidden_effect_demo/runs")
#: How the names of files with recordings end.
RECORDED = (".csv", ".toml", ".parquet")
#: Steps of a slider over its range.
STEPS = 400
#: Seconds after the last move of a slider until the sentences follow, and until the work goes on that it ended.
SETTLED, PAUSE = 0.15, 1.0


class ConfrontTab:
    """One client's confrontation.

    Parameters
    ----------
    client
        Folder, work and notices of this client.
    """

    def __init__(self, client: Client) -> None:
        self.client = client
        self.session: Confrontation | None = None
        self.shown: Confronted | None = None
        self.ticked: list[str] = []
        self.effects = EffectList(client, self._tick)
        self.own: list[str] = []
        self.run = ""
        self.model_path = ""
        self._asked: dict[str, float] | None = None
        self._simulating, self._slides = False, 0
        client.on_scheme.append(partial(self._show_curves, whole=True))

    # --- the page -------------------------------------------------------------------------------------------------

    def build(self) -> None:
        """Lay the tab out."""
        with ui.card().classes("w-full"):
            with ui.row().classes("w-full items-start"):
                self.model = ui.input("Model (path or bare name)").classes("grow").props("outlined dense")
                self.runs = ui.input("Recordings or static tables (files or folders, separated by ;)").classes("grow")
                self.runs.props("outlined dense")
                ui.button("Confront", on_click=self.load).props("no-caps").mark("load")
                ui.button("Load the demo", on_click=self.load_demo).props("no-caps outline")
            with ui.expansion("Files of your own").classes("w-full"), ui.row().classes("w-full"):
                self.client.upload("Stage model (.toml)", (".toml",), self._model_came, fd.read_model)
                self.client.upload(
                    "Recordings (.csv, measurements.toml)", (".csv", ".toml", ".parquet"), self._runs_came
                )
                self.client.upload("An effect of your own (.py)", (".py",), self._effect_came)
        self.body = ui.column().classes("w-full")

    def _model_came(self, path: Path) -> None:
        self.model.value = self.client.register_upload(path)

    def _runs_came(self, path: Path) -> None:
        """Name all files with data that were uploaded; a description is read with the files next to it."""
        data = [each for each in sorted(path.parent.iterdir()) if each.suffix.lower() != ".toml"]
        self.runs.value = "; ".join(map(self.client.register_upload, data))

    def _effect_came(self, path: Path) -> None:
        self.own.append(str(path))
        self.client.notice(f"{path.name} is offered with the other effects; press Confront.")

    async def load_demo(self) -> None:
        """Confront the model of the demo with its recordings."""
        self.model.value, self.runs.value = DEMO
        await self.load()

    async def load(self, ticked: Sequence[str] = ()) -> None:
        """Confront the model with the recordings that the fields name."""
        if not await self.client.is_free():
            return
        field_error(self.model, "")
        field_error(self.runs, "")
        self.body.clear()
        try:
            self.model_path = self.client.path_of(str(self.model.value or ""))
            if is_static := await run.io_bound(is_design, self.model_path):
                model = None
            else:
                model = await run.io_bound(fd.read_model, self.model_path)
        except fd.InputError as error:
            field_error(self.model, str(error))
            return
        try:
            paths = [self.client.path_of(each) for each in str(self.runs.value or "").split(";") if each.strip()]
            if is_static:
                self.client.remember(model=self.model.value, runs=self.runs.value)
                with self.body:
                    await StaticTables(self.client, self.model_path, paths, self.own).build()
                return
            self.session = await self.client.work.in_thread(
                "reading the recordings", fd.confront, self.model_path, paths, effects=self.own
            )
            self.shown = await run.io_bound(self.session.designed)
        except fd.InputError as error:
            field_error(self.runs, str(error))
            return
        except Cancelled:
            self.client.notice("Cancelled: nothing was loaded.")
            return
        self.client.remember(model=self.model.value, runs=self.runs.value)
        if model is None or self.shown is None:  # the server shuts down
            return
        self.run = max(self.shown.comparison.runs, key=lambda each: each.rms).name if self.shown.runs else ""
        self.ticked, self.effects.offers, self.effects.weighed = [], (), None
        with self.body:
            self._lay_out(model.title or model.name)
        self._show()
        await self._weigh(ticked)

    async def _weigh(self, ticked: Sequence[str] = ()) -> None:
        """Calibrate the model, and compute the evidence of each effect."""
        session = self.session
        assert session is not None

        async def weigh() -> None:
            for count in range(len(ticked) + 1):
                said = "fitting the numbers of the model"
                self.shown = await self.client.work.in_thread(said, session.fit, ticked[:count], roughly=True)
                self.ticked[:] = ticked[:count]
                self._show()
            self.effects.offers = await run.io_bound(session.offers, self.ticked) or ()

        await self._guarded(weigh)
        await self._ask()

    async def _ask(self) -> None:
        """End a rough fit, and ask what each further effect would explain; whatever the user asks for ends that."""
        session, ticked, work = self.session, tuple(self.ticked), self.client.work
        if session is None or work.is_busy or self.effects.weighed == ticked:
            return
        self.effects.is_weighing = True
        self.effects.refresh()
        try:
            if self.shown is not None and self.shown.is_rough:
                self.shown = await work.in_thread("carrying the fit to its end", session.fit, ticked, yields=True)
                self._show()
            said = "asking each effect what it explains"
            self.effects.offers = await work.in_thread(said, session.evidence, ticked, yields=True)
            self.effects.weighed = ticked
        except Cancelled:
            pass
        except fd.InputError as error:
            field_error(self.problem, str(error))
        finally:
            self.effects.is_weighing = False
        self.effects.refresh()

    async def _guarded(self, action: Callable[[], Awaitable[None]]) -> None:
        """Do something long; show what stops it."""
        field_error(self.problem, "")
        try:
            await action()
        except Cancelled:
            self.client.notice("Cancelled: the model stands as it did before.")
        except fd.InputError as error:
            field_error(self.problem, str(error))
        self._show_effects()

    def _lay_out(self, title: str) -> None:
        ui.label(title).classes("text-h6").props("role=heading aria-level=2")
        self.sentences = ui.column().classes("w-full gap-1").props("aria-live=polite").mark("where")
        self.problem = ui.label("").classes("fd-error").props("role=alert")
        with ui.element("div").classes("fd-grid"):
            with ui.column().classes("w-full"):
                names = [each.name for each in self.shown.comparison.runs] if self.shown else []
                self.choice = ui.select(names, value=self.run or None, label="Run", on_change=self._choose_run)
                self.choice.classes("w-full").props("outlined dense")
                self.chart = ui.echart({}).style("height: 460px").classes("w-full")
                ui.label("Residual: grey within 3, brown within 10, red beyond 10 times the noise.").classes(
                    "text-caption"
                )
                ui.label("Error ladder").classes("text-subtitle1").props("role=heading aria-level=3")
                self.ladder = ui.html("", sanitize=False).classes("w-full fd-scroll")
            with ui.column().classes("w-full"):
                self.effects.build()
                ui.label("Numbers of the model").classes("text-subtitle1").props("role=heading aria-level=3")
                self.numbers = ui.column().classes("w-full gap-1")
                with ui.row():
                    ui.button("Export the report", on_click=self._export).props("no-caps outline")
                    ui.button("Save the model", on_click=self._save).props("no-caps outline")
                self.exported = ui.column().props("aria-live=polite")
        self.further = LoopAndPlan(self.client, self.session, self.model_path, self.ticked, self._ask)
        self.further.build()

    # --- what is shown --------------------------------------------------------------------------------------------

    def _show(self) -> None:
        """Show the model as it stands: sentences, curves, ladder, effects and numbers."""
        self._show_sentences()
        self._show_curves(whole=True)
        self._show_effects()
        self._show_numbers()

    def _show_sentences(self) -> None:
        self.sentences.clear()
        with self.sentences:
            for text in self.session.where(self.shown) if self.session and self.shown else []:
                ui.label(units.typeset(text))

    def _show_curves(self, whole: bool = False) -> None:
        if self.session is None or self.shown is None:
            return
        self.ladder.set_content(charts.ladder(self.session.ladder(self.shown)))
        if not self.run:
            return
        traces = self.session.traces(self.shown, self.run)
        if whole:
            self.chart.options.clear()
            self.chart.options.update(charts.trace_options(traces, self.client.palette))
            self.chart.update()
        else:
            moved = charts.trace_series(traces, self.client.palette, ("modelled", "residual"))
            self.chart.run_chart_method("setOption", {"series": moved})

    def _choose_run(self, event: Any) -> None:
        self.run = event.value
        self._show_curves(whole=True)

    def _show_effects(self) -> None:
        self.effects.show(self.ticked, self.shown.reason if self.shown else "")

    def _show_numbers(self) -> None:
        self.numbers.clear()
        with self.numbers:
            for setting in self.shown.settings if self.shown else ():
                self._number(setting)

    def _number(self, setting: AdjustableParameter) -> None:
        parameter, factor = setting.parameter, setting.parameter.factor
        low, high, value = setting.low / factor, setting.high / factor, setting.value / factor
        name = parameter.name.replace("_", " ").replace(".", ": ")
        label = units.typeset(f"{name} [{parameter.unit}]") if parameter.unit else name
        with ui.element("div").classes("fd-number"):
            ui.label(label).tooltip(parameter.meaning)
            slider = ui.slider(min=low, max=high, step=(high - low) / STEPS, value=value)
            slider.props(f'aria-label="{label}"').mark(f"slider-{parameter.name}")
            shown = ui.label(f"{value:.4g}").classes("text-right")
            slider.on("update:model-value", partial(self._slid, parameter.name, factor, shown), throttle=0.03)

    # --- what is done ---------------------------------------------------------------------------------------------

    async def _tick(self, wanted: list[str]) -> None:
        """Fit the model with the effects that are ticked."""
        session = self.session
        if session is None or not await self.client.is_free():
            self._show_effects()
            return

        async def fit() -> None:
            said = f"fitting {' and '.join(wanted) or 'the model'}"
            self.shown = await self.client.work.in_thread(said, session.fit, wanted, roughly=True)
            self.ticked[:] = wanted
            self.client.remember(effects=",".join(wanted))
            self._show()

        await self._guarded(fit)
        await self._ask()

    async def _slid(self, name: str, factor: float, shown: ui.label, event: Any) -> None:
        """Simulate with a number that was moved; only the last of many positions counts."""
        if self.session is None or self.shown is None or not await self.client.work.is_free():
            return
        shown.set_text(f"{event.args:.4g}")
        present = {each.parameter.name: each.value for each in self.shown.settings}
        self._asked = {**(self._asked or present), name: float(event.args) * factor}
        self._slides += 1
        if self._simulating:
            return
        self._simulating = True
        try:
            while self._asked is not None:
                asked, self._asked = self._asked, None
                self.shown = await run.io_bound(self.session.simulate, self.ticked, asked)
                field_error(self.problem, "")
                self._show_curves()
                await asyncio.sleep(0)
        except fd.InputError as error:
            field_error(self.problem, str(error))
        finally:
            self._simulating = False
        slides = self._slides
        await asyncio.sleep(SETTLED)
        if slides != self._slides:
            return
        self._show_sentences()
        await asyncio.sleep(PAUSE)
        if slides == self._slides:
            await self._ask()

    async def _write(self, write: Callable[[Confrontation, Confronted, Path], object]) -> Path | None:
        """Write something of the model as it stands into a new folder; None if that fails."""
        session, shown, folder = self.session, self.shown, self.client.new_folder("confronted")
        if session is None or shown is None or not await self.client.is_free():
            return None

        def written(progress: Callable[[str], None]) -> Path:
            progress("writing")
            write(session, shown, folder)
            return folder

        try:
            return await self.client.work.in_thread("writing", written)
        except Cancelled:
            self.client.notice("Cancelled: nothing was written.")
        except fd.InputError as error:
            field_error(self.problem, str(error))
        return None

    async def _export(self) -> None:
        if (folder := await self._write(lambda session, shown, to: session.result(shown).report(to))) is not None:
            self.exported.clear()
            with self.exported:
                ui.label("The report is written:")
                self.client.links(folder)
        await self._ask()

    async def _save(self) -> None:
        name = "stage_model.toml"

        def write(session: Confrontation, shown: Confronted, to: Path) -> None:
            (to / name).write_text(session.model_file(shown, to), encoding="utf-8")

        if (folder := await self._write(write)) is not None:
            ui.download.file(folder / name)
        await self._ask()
