"""A report in a browser: what its scripts do, what remains without them and on paper, that nothing is fetched."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.report import render
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.traces import Curve, Traces
from flexdesign.report.views import State, Surface, View

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
sync_api = pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
#: Without a graphics card Chromium draws in software.
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

#: Corners of a box, and its triangles seen from outside.
CORNERS = 1e-3 * np.array([[x, y, z] for x in (0, 60) for y in (0, 30) for z in (0, 10)], dtype=float)
SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def view() -> View:
    """Return a box whose points move along x by a thousandth of their x, and a mode of it."""
    moved = np.zeros_like(CORNERS)
    moved[:, 0] = 1e-3 * CORNERS[:, 0]
    states = [
        State("Stretched", 0, moved, 100.0, full="full voltage"),
        State("Stress", 0, moved, 100.0, label="stress", unit="MPa", values=np.full(8, 42.0), full="full voltage"),
        State("Mode 1", 0, moved, 100.0, "phase"),
    ]
    return View([Surface(CORNERS, SIDES)], states)


def document() -> Document:
    time = np.linspace(0.0, 2.0, 5000)
    measured = 100.0 * np.sin(2 * np.pi * time)
    above = [Curve("measured", time, measured, dashed=True), Curve("as designed", time, 0.9 * measured)]
    below = [Curve("as designed", time, 100.0 * measured)]
    traces = Traces([above, below], "time [s]", ["x [µm]", "residual [nm]"])
    rows = [
        ["travel", "1.2 µm"],
        ["noise", "900 ± 5 nm"],
        ["drift", "−3 nm"],
        ["unknown", "–"],
        ["stroke", "0.4 mm"],
    ]
    still = Figure("still.svg", traces.svg(), "The box stretched", view(), "A box, stretched along x by 60 µm")
    sections = [
        Section("The part", ["A box."], [], [still]),
        Section("Measured and predicted", ["Both runs."], [Table(["what", "size"], rows, "Sizes")]),
        Section("More", ["Kept for who asks."], [], [Figure.of_traces("more.svg", traces, "More")], folded=True),
        *(Section(f"Section {k}", ["Words. " * 200]) for k in range(4)),
    ]
    lead = Section("Runs", [], [], [Figure.of_traces("run.svg", traces, "A run beside the model")])
    return Document("A stage", ["The model misses the run by 7 µm rms.", "More words."], [lead, *sections])


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(render.to_html(document()), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@contextmanager
def opened(browser: Any, file: Path, width: int = 1280, **options: Any) -> Iterator[Any]:
    """Open a page; at its end nothing was written to the console and nothing fetched."""
    context = browser.new_context(viewport={"width": width, "height": 900}, **options)
    page, said, fetched = context.new_page(), list[str](), list[str]()
    page.on("console", lambda message: said.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: fetched.append(request.url))
    page.goto(file.as_uri())
    yield page
    context.close()
    assert not said
    assert {url for url in fetched if not url.startswith("data:")} == {file.as_uri()}


def test_the_answer_and_its_picture_come_first(browser: Any, file: Path) -> None:
    with opened(browser, file) as page:
        page.wait_for_selector("figure.lead .uplot")
        tops = [page.locator(place).first.bounding_box()["y"] for place in ("h1", ".answer", "figure.lead", "section")]
        assert tops == sorted(tops)
        assert page.locator("figure.lead").bounding_box()["y"] < 300


def test_curves_zoom_together_and_come_back(browser: Any, file: Path) -> None:
    with opened(browser, file) as page:
        page.wait_for_selector("figure.lead .uplot")
        ranges = "[...document.querySelector('figure.lead').live.plots].map(p => [p.scales.x.min, p.scales.x.max])"
        page.get_by_role("button", name="Zoom in").first.click()
        page.wait_for_function(f"() => ({ranges})[0][0] > 0.4")
        assert page.evaluate(ranges) == [[0.5, 1.5], [0.5, 1.5]]
        over = page.locator("figure.lead .u-over").nth(1).bounding_box()
        middle = over["y"] + over["height"] / 2
        page.mouse.move(over["x"] + 0.25 * over["width"], middle)
        page.mouse.down()
        page.mouse.move(over["x"] + 0.75 * over["width"], middle, steps=4)
        page.mouse.up()
        page.wait_for_function(f"() => ({ranges})[0][0] > 0.7")
        assert np.allclose(page.evaluate(ranges), [[0.75, 1.25]] * 2, atol=0.01)
        page.keyboard.press("ArrowRight")
        page.wait_for_function(f"() => ({ranges})[1][0] > 0.78")
        page.keyboard.press("0")
        page.wait_for_function(f"() => ({ranges})[0][0] === 0")


def test_the_cursor_reads_values_with_their_units(browser: Any, file: Path) -> None:
    with opened(browser, file) as page:
        page.wait_for_selector("figure.lead .uplot")
        over = page.locator("figure.lead .u-over").first.bounding_box()
        page.mouse.move(over["x"] + over["width"] / 8, over["y"] + 20)
        page.wait_for_function("() => document.querySelector('figure.lead .u-legend').textContent.includes('µm')")
        read = page.locator("figure.lead .u-legend").first.inner_text()
        assert "measured" in read and " s" in read
        # Linked: the panel below reads at the same time, a sine's crest, of which the residual is 10 µm.
        left = page.locator("figure.lead .u-legend").nth(1).locator(".u-value").nth(1).inner_text()
        assert left.endswith(" nm") and float(left.split()[0]) == pytest.approx(10_000, rel=0.01)


@contextmanager
def turned(browser: Any, file: Path) -> Iterator[Any]:
    with opened(browser, file) as page:
        page.get_by_role("link", name="The part").click()
        page.wait_for_selector(".view canvas")
        page.evaluate("window.box = document.querySelector('figure:has(.view)').live")
        yield page


def test_the_part_turns_by_pointer_and_keyboard(browser: Any, file: Path) -> None:
    with turned(browser, file) as page:
        where = "box.camera.position.toArray()"
        first = page.evaluate(where)
        seen = page.locator(".scene").bounding_box()
        page.mouse.move(seen["x"] + seen["width"] / 2, seen["y"] + seen["height"] / 2)
        page.mouse.down()
        page.mouse.move(seen["x"] + seen["width"] / 2 + 120, seen["y"] + seen["height"] / 2 + 30, steps=5)
        page.mouse.up()
        dragged = page.evaluate(where)
        assert not np.allclose(dragged, first, rtol=0.01)
        page.keyboard.press("ArrowLeft")
        assert not np.allclose(page.evaluate(where), dragged, rtol=0.001)
        page.get_by_role("button", name="Reset view").click()
        assert np.allclose(page.evaluate(where), first)


def test_the_slider_sets_load_and_phase(browser: Any, file: Path) -> None:
    with turned(browser, file) as page:
        longest = "Math.max(...box.positions().filter((_, k) => k % 3 === 0))"
        slider = page.locator(".view input[type=range]")
        assert page.evaluate(longest) == pytest.approx(66.0, rel=1e-4)
        slider.fill("50")
        assert page.evaluate(longest) == pytest.approx(63.0, rel=1e-4)
        page.locator(".view select").first.select_option(label="Mode 1")
        slider.fill("180")
        assert page.evaluate(longest) == pytest.approx(54.0, rel=1e-4)
        assert not page.locator(".view select").nth(1).is_visible()  # a mode has no size of its own
        page.locator(".view select").first.select_option(label="Stress")
        page.locator(".view select").nth(1).select_option(label="1 ×")
        assert page.evaluate(longest) == pytest.approx(60.06, rel=1e-5)


def test_a_click_on_the_part_reads_the_value_there(browser: Any, file: Path) -> None:
    with turned(browser, file) as page:
        page.get_by_role("button", name="Front").click()
        page.locator(".view select").nth(1).select_option(label="1 ×")
        seen = page.locator(".scene canvas").bounding_box()
        page.mouse.click(seen["x"] + seen["width"] / 2, seen["y"] + seen["height"] / 2)
        reading = page.locator(".view .reading")
        told = reading.inner_text()
        # The middle of the front, x = 30 mm, moves by a thousandth of it.
        moved, place = float(told.split()[1]), told.partition("at (")[2].split(",")[0]
        assert told.startswith("displacement: ") and " µm" in told and told.endswith("mm")
        assert moved == pytest.approx(float(place), rel=0.01) == pytest.approx(30.0, rel=0.02)
        page.locator(".view select").first.select_option(label="Stress")
        page.mouse.click(seen["x"] + seen["width"] / 2, seen["y"] + seen["height"] / 2)
        assert reading.inner_text().startswith("stress: 42 MPa")
        assert "stress [MPa]" in page.locator(".legend").inner_text() and "42" in page.locator(".legend").inner_text()
        assert page.locator(".ruler").inner_text().endswith(" mm")


def test_a_page_unpacks_what_was_packed(browser: Any, tmp_path: Path) -> None:
    """Every point of a bent sheet is as the formula has it there, within half a step of 1/65534 of the range.

    Places are in single precision, and the displacement varies with their third power.
    """
    near, single = 0.5 / 65534, 3 * 2**-23
    count = 40
    across, along = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count)))
    points = np.stack([0.05 * across, 0.03 * along, 0.0 * along], axis=1)
    moved = np.stack([0.0 * across, 0.0 * across, 1e-5 * across**2 * along], axis=1)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1, 1)
    triangles = np.concatenate([first + np.array([0, 1, count + 1]), first + np.array([0, count + 1, count])])
    sheet = View([Surface(points, triangles)], [State("Bent", 0, moved, 100.0, values=50.0 * across, full="1 N")])
    still = Figure("still.svg", b"<svg/>", "A sheet", sheet, "A sheet")
    path = tmp_path / "sheet.html"
    path.write_text(render.to_html(Document("A sheet", ["Bent."], [Section("The part", [], [], [still])])))
    with opened(browser, path) as page:
        page.wait_for_selector(".view canvas")
        page.evaluate("window.box = document.querySelector('figure:has(.view)').live")
        rest, displaced, values, corners = (
            np.array(page.evaluate(f"Array.from({what})"))
            for what in ("box.points", "box.states[0].displacement", "box.states[0].values", "box.triangles")
        )
    x, y, z = rest.reshape(-1, 3).T
    assert len(x) == count**2 and (z == 0).all()
    assert displaced.reshape(-1, 3)[:, 2] == pytest.approx(10.0 * (x / 50) ** 2 * (y / 30), abs=10 * (near + single))
    assert values == pytest.approx(x, abs=50 * (near + single))
    sides = rest.reshape(-1, 3)[corners.reshape(-1, 3)]
    upward = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])[:, 2] / 2
    assert upward == pytest.approx(np.full(2 * (count - 1) ** 2, 50 * 30 / 2 / (count - 1) ** 2), rel=1e-5)


def test_tables_sort_by_number_whatever_the_prefix(browser: Any, file: Path) -> None:
    with opened(browser, file) as page:
        names = "[...document.querySelectorAll('tbody tr td:first-child')].map(cell => cell.textContent)"
        first = page.evaluate(names)
        head = page.get_by_role("button", name="size")
        head.focus()
        page.keyboard.press("Enter")
        assert page.evaluate(names) == ["drift", "noise", "travel", "stroke", "unknown"]
        assert page.get_by_role("columnheader", name="size").get_attribute("aria-sort") == "ascending"
        head.click()
        assert page.evaluate(names) == ["stroke", "travel", "noise", "drift", "unknown"]
        head.click()
        assert page.evaluate(names) == first


def test_contents_follow_and_open_folded_sections(browser: Any, file: Path) -> None:
    with opened(browser, file) as page:
        page.get_by_role("link", name="More").click()
        page.wait_for_selector("section.folded details[open]")
        page.wait_for_function("() => document.querySelector('nav [aria-current]')?.textContent === 'More'")
        page.get_by_role("link", name="Section 2").click()
        page.wait_for_function("() => document.querySelector('nav [aria-current]')?.textContent === 'Section 2'")
        assert page.get_by_role("link", name="Section 2").is_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_window(browser: Any, file: Path, width: int, scheme: str) -> None:
    with opened(browser, file, width, color_scheme=scheme) as page:
        page.wait_for_selector("figure.lead .uplot")
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_without_scripts_pictures_remain(browser: Any, file: Path) -> None:
    with opened(browser, file, java_script_enabled=False) as page:
        assert page.locator("figure.lead img").is_visible()
        assert page.locator("img").count() == page.locator("img[alt]:not([alt=''])").count() == 3


def test_paper_shows_drawings_and_no_folds(browser: Any, file: Path, tmp_path: Path) -> None:
    with opened(browser, file) as page:
        page.wait_for_selector("figure.lead .uplot")
        page.emulate_media(media="print")
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert page.locator("figure.lead img").is_visible() and page.locator(".folded img").is_visible()
        assert not page.locator(".live").first.is_visible() and not page.locator("nav").is_visible()
        page.evaluate("dispatchEvent(new Event('afterprint'))")
        assert page.locator("section.folded details[open]").count() == 0


def test_a_drawing_says_what_it_shows() -> None:
    figure = document().lead
    assert figure is not None
    assert figure.text == (
        "x [µm]; measured from -100 to 100; as designed from -90 to 90. "
        "residual [nm] over time [s]; as designed from -1e+04 to 1e+04."
    )


def test_a_curve_of_zeros_stands_in_the_middle_of_one_unit(browser: Any, tmp_path: Path) -> None:
    time = np.linspace(0.0, 1.0, 100)
    traces = Traces([[Curve("flat", time, 0.0 * time)], [Curve("not flat", time, 5.0 + time)]], "time [s]", ["a", "b"])
    path = tmp_path / "flat.html"
    section = Section("Runs", [], [], [Figure.of_traces("flat.svg", traces, "Flat")])
    path.write_text(render.to_html(Document("Flat", ["It is flat."], [section])))
    with opened(browser, path) as page:
        page.wait_for_selector("figure.lead .uplot")
        flat, other = page.evaluate(
            "document.querySelector('figure.lead').live.plots.map(p => [p.scales.y.min, p.scales.y.max])"
        )
    assert flat == [-1, 1]
    assert 4 < other[0] <= 5 and 6 <= other[1] < 7


def test_a_column_without_a_name_does_not_sort(browser: Any, tmp_path: Path) -> None:
    table = Table(["", "size"], [["a", "2 m"], ["b", "1 m"], ["c", "3 m"]])
    path = tmp_path / "table.html"
    path.write_text(render.to_html(Document("Sizes", ["Three."], [Section("Sizes", [], [table])])))
    with opened(browser, path) as page:
        assert page.locator("thead button").count() == 1
        page.get_by_role("button", name="size").click()
        assert page.locator("tbody tr td:first-child").all_inner_texts() == ["b", "a", "c"]
