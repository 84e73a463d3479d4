"""The tab Design: dimensions as sliders, formulas at once, finite elements and studies on demand."""

from __future__ import annotations

import tomllib
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import run, ui

import flexdesign as fd
from flexdesign.core import units
from flexdesign.workbench import charts
from flexdesign.workbench.client import UPLOADED, Client, field_error
from flexdesign.workbench.work import Cancelled

if TYPE_CHECKING:
    from flexdesign import Design, Parameter

#: Steps of a slider, and how far it reaches about the value of the file.
STEPS, REACH = 200, 0.5
#: A study to begin with.
STUDY = """format = 1
title = "{title}"
design = "{file}"
evaluator = "analytic"

[vary]
"dimensions.{dimension}" = {{ from = "{low} {unit}", to = "{high} {unit}", count = 21 }}

[aim]
maximise = "{aim}"
"""


class DesignTab:
    """One client's design.

    Parameters
    ----------
    client
        Folder, work and notices of this client.
    """

    def __init__(self, client: Client) -> None:
        self.client = client
        self.design: Design | None = None
        self.moved = dict[str, float]()  # in the units of the parameters
        self._last_field: ui.number | None = None

    # --- the page -------------------------------------------------------------------------------------------------

    def build(self) -> None:
        """Lay the tab out."""
        with ui.card().classes("w-full"):
            with ui.row().classes("w-full items-start"):
                self.name = ui.input("Design (path or bare name)", value="bridge_amplifier").classes("grow")
                self.name.props("outlined dense")
                ui.button("Open", on_click=self.open).props("no-caps").mark("open-design")
            with ui.expansion("A design, sketch or STEP file of your own").classes("w-full"):
                self.client.upload("Design or sketch (.toml), solid (.step)", (".toml", ".step", ".stp"), self._came)
                self.starter = ui.column().classes("w-full")
        self.problem = ui.label("").classes("fd-error").props("role=alert")
        self.body = ui.column().classes("w-full")

    async def _came(self, path: Path) -> None:
        if path.suffix.lower() == ".toml":
            self.name.value = self.client.register_upload(path)
            await self.open()
            return
        self.starter.clear()
        try:
            found = await self.client.work.in_thread("reading the solid", fd.read_ports, path)
        except (fd.InputError, Cancelled) as error:
            field_error(self.problem, str(error) or "Cancelled.")
            return
        file = path.with_suffix(".toml")
        with self.starter:
            ui.html(charts.table(found.table.columns, found.table.rows), sanitize=False).classes("w-full fd-scroll")
            text = ui.textarea("A design to start from: name the ports", value=found.design_for(path.parent))
            text.classes("w-full font-mono").props("outlined autogrow")

            async def use() -> None:
                file.write_text(str(text.value), encoding="utf-8")
                self.name.value = self.client.register_upload(file)
                await self.open()

            ui.button("Use this design", on_click=use).props("no-caps outline")

    async def open(self) -> None:
        """Read the design that the field names, and lay out its dimensions."""
        field_error(self.name, "")
        field_error(self.problem, "")
        self.body.clear()
        self.moved, self._last_field = {}, None
        try:
            self.design = await run.io_bound(fd.read_design, self.client.path_of(str(self.name.value or "")))
        except fd.InputError as error:
            field_error(self.name, str(error))
            return
        assert self.design is not None
        with self.body:
            ui.label(self.design.title).classes("text-h6").props("role=heading aria-level=2")
            with ui.element("div").classes("fd-grid"):
                with ui.column().classes("w-full gap-1"):
                    for parameter in self.design.part_class.dimensions:
                        self._dimension(parameter, self.design.dimensions[parameter.name])
                with ui.column().classes("w-full fd-answer"):
                    ui.label("Compliance model").classes("text-subtitle1").props("role=heading aria-level=3")
                    self.formulas = ui.html("", sanitize=False).classes("w-full fd-scroll").mark("formulas")
            self._buttons()
        await self._predict()

    def _dimension(self, parameter: Parameter, value: float) -> None:
        unit = parameter.unit or ""
        factor = parameter.factor
        low = max(parameter.plausible[0], value * (1 - REACH)) / factor
        high = (min(parameter.plausible[1], value * (1 + REACH)) if value else parameter.plausible[1]) / factor
        name, shown = parameter.name.replace("_", " "), units.typeset(unit)
        label = f"{name} [{shown}]" if unit else name
        with ui.element("div").classes("fd-number"):
            ui.label(label).tooltip(parameter.meaning)
            slider = ui.slider(min=min(low, high), max=high, step=(high - low) / STEPS, value=value / factor)
            slider.props(f'aria-label="{label}"').mark(f"slider-{parameter.name}")
            number = ui.number(value=float(f"{value / factor:.6g}"), format="%.4g")
            number.props(f'dense outlined suffix="{shown}" aria-label="{label}"')
            slider.on("update:model-value", partial(self._slid, parameter, number), throttle=0.03)
            number.on("change", partial(self._typed, parameter, number, slider))

    def _buttons(self) -> None:
        with ui.row():
            ui.button("Solve with finite elements", on_click=self._solve).props("no-caps")
        self.solved = ui.column().classes("w-full").props("aria-live=polite")
        with ui.expansion("Sweep and optimise").classes("w-full"):
            ui.label(
                "Dimensions that the study does not vary are as the sliders show them, if it is a study of this design."
            ).classes("text-caption")
            self._offered = self._starting_study()
            self.study = ui.textarea("Study", value=self._offered).classes("w-full font-mono")
            self.study.props('outlined rows="12"')  # where it is folded away it would not grow with its text
            with ui.row():
                ui.button("Sweep", on_click=partial(self._study, "sweep")).props("no-caps outline")
                ui.button("Optimise", on_click=partial(self._study, "optimize")).props("no-caps outline")
            self.studied = ui.column().classes("w-full").props("aria-live=polite")

    def _starting_study(self) -> str:
        design = self.design
        if design is None or not design.part_class.dimensions:
            return ""
        parameters = design.part_class.dimensions
        thick = [p for p in parameters if "thickness" in p.name and design.dimensions[p.name] > 0]
        parameter = min(thick, key=lambda p: design.dimensions[p.name], default=parameters[0])  # what bends
        value = self.moved.get(parameter.name, design.dimensions[parameter.name] / parameter.factor)
        return STUDY.format(
            title=design.title, file=self._written_name(), dimension=parameter.name, unit=parameter.unit,
            low=f"{0.8 * value:.4g}", high=f"{1.2 * value:.4g}",
            aim="K_out_actuator_installed" if design.actuator else "K_out_input_free",
        )  # fmt: skip

    def _written_name(self) -> str:
        """Return how a study names the design that is open: an uploaded file by its name, others by their path."""
        assert self.design is not None
        name = str(self.name.value).strip()
        return name if name.endswith(UPLOADED) else self.design.file.resolve().as_posix()

    def _is_of_this_design(self, study: str) -> bool:
        """Tell whether a study names the design that is open; one that cannot be read is refused later, in words."""
        try:
            named = tomllib.loads(study).get("design")
        except tomllib.TOMLDecodeError:
            return False
        return self.design is not None and named in (self._written_name(), str(self.name.value))

    # --- what is done ---------------------------------------------------------------------------------------------

    async def _slid(self, parameter: Parameter, number: ui.number, event: Any) -> None:
        number.value = float(f"{event.args:.5g}")
        self._set(parameter, float(event.args), number)
        await self._predict()

    async def _typed(self, parameter: Parameter, number: ui.number, slider: ui.slider, _: Any) -> None:
        if number.value is None:
            field_error(number, "give a number")
            return
        value = float(number.value)
        slider.props["min"], slider.props["max"] = min(slider.props["min"], value), max(slider.props["max"], value)
        slider.value = value
        slider.update()
        self._set(parameter, value, number)
        await self._predict()

    def _set(self, parameter: Parameter, value: float, number: ui.number) -> None:
        """Take the value of a dimension; a study that nobody has edited is about the new one."""
        self._last_field = number
        self.moved[parameter.name] = value
        if self.study.value == self._offered:
            self.study.value = self._offered = self._starting_study()

    @property
    def changed(self) -> dict[str, str]:
        """Dimensions that were moved, each with its unit."""
        assert self.design is not None
        units_of = {each.name: each.unit or "" for each in self.design.part_class.dimensions}
        return {name: f"{value:.6g} {units_of[name]}".rstrip() for name, value in self.moved.items()}

    async def _predict(self) -> None:
        """Show what the compliance model says."""
        assert self.design is not None
        place = self._last_field or self.problem
        field_error(self.problem, "")  # now: what is asked for meanwhile may end in an error of its own
        try:
            found = await run.io_bound(fd.formulas, self.design, dimensions=self.changed)
        except fd.InputError as error:
            field_error(place, str(error))
            return
        if place is not self.problem:
            field_error(place, "")
        rows = [[each.name, each.boundary, each.formatted()] for each in (found or {}).values()]
        self.formulas.set_content(charts.table(["quantity", "boundary", "value"], rows))

    async def _in_process(self, verb: str, argument: str, options: dict[str, Any], place: ui.column) -> None:
        """Run a command in a process, and show its answer and its report."""
        field_error(self.problem, "")
        if not await self.client.is_free():
            return
        place.clear()
        folder = self.client.new_folder(verb)
        try:
            found = await self.client.work.in_process(verb, [argument], options, folder)
        except Cancelled:
            self.client.notice("Cancelled: the process was ended, nothing was written.")
            return
        except fd.InputError as error:
            field_error(self.problem, error.remedy)
            return
        with place:
            self.client.answer(found, folder)
            frame = ui.element("iframe").classes("fd-frame")
            frame.props(f'src="{self.client.url(folder / "report.html")}" title="The report, with its views in 3D"')

    async def _solve(self) -> None:
        assert self.design is not None
        options = {"dimensions": self.changed} if self.moved else {}
        await self._in_process("validate", str(self.design.file), options, self.solved)

    async def _study(self, verb: str) -> None:
        folder = self.client.new_folder("study")
        file = folder / "study.toml"
        file.write_text(self.client.with_paths(str(self.study.value)), encoding="utf-8")
        options: dict[str, Any] = {"store": str(folder / "answers")} if verb == "sweep" else {}
        if self.moved and self._is_of_this_design(str(self.study.value)):
            options["dimensions"] = self.changed
        await self._in_process(verb, str(file), options, self.studied)
