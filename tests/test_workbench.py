"""The workbench from end to end, in headless Chromium: what a user sees and does, and what goes wrong."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("nicegui")
import flexdesign as fd
from flexdesign.workbench import charts
from tests.report.test_charts import contrast

playwright = pytest.importorskip("playwright.sync_api")

ROOT = Path(__file__).parent.parent
CHROMIUM = shutil.which("chromium")
DEMO = ROOT / "studies" / "hidden_effect_demo"
#: Milliseconds that anything may take on a machine that does much else.
PATIENCE = 120_000
WIDTHS = (1280, 390)

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's Chromium")


#: What text of a page has less contrast with its paper than WCAG 2.2 AA asks for (4.5), its opacity included; empty
#: text, drawings, and what is switched off are left out.
POOR_CONTRAST = """() => {
  const parse = (colour) => [...colour.match(/[\\d.]+/g).map(Number), 1].slice(0, 4);
  const over = (top, under) => top.slice(0, 3).map((value, k) => value * top[3] + under[k] * (1 - top[3]));
  const linear = (value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
  const WEIGHTS = [0.2126, 0.7152, 0.0722];
  const luminance = (colour) => WEIGHTS.reduce((sum, weight, k) => sum + weight * linear(colour[k] / 255), 0);
  const poor = new Set(), texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = texts.nextNode());) {
    const element = node.parentElement, above = [];
    if (!node.data.trim() || !element.getClientRects().length) continue;
    if (!element.checkVisibility({ visibilityProperty: true })) continue;
    if (element.closest("[aria-hidden=true], .disabled, svg, style, script")) continue;
    for (let each = element; each; each = each.parentElement) above.unshift(getComputedStyle(each));
    const paper = above.reduce((under, style) => over(parse(style.backgroundColor), under), [255, 255, 255]);
    const share = above.reduce((product, style) => product * Number(style.opacity), 1);
    const letters = over([...over(parse(above[above.length - 1].color), paper), share], paper);
    const [low, high] = [luminance(letters), luminance(paper)].sort((a, b) => a - b);
    const ratio = (high + 0.05) / (low + 0.05);
    if (ratio < 4.5) poor.add(`${ratio.toFixed(2)}: ${node.data.trim()}`);
  }
  return [...poor];
}"""


class Server:
    """A server in a process of its own, which may be killed and started anew on the same port."""

    def __init__(self, folder: Path, *options: str) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.folder, self.options = folder, options
        self.url = f"http://127.0.0.1:{self.port}/"
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "flexdesign", "workbench", "--no-browser", "--port", str(self.port)]
        inherited = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
        environment = {**inherited, "PYTHONPATH": str(ROOT), "TMPDIR": str(self.folder)}
        self.log = (self.folder / "server.log").open("a+")
        self.process = subprocess.Popen(
            [*command, *self.options], cwd=ROOT, stdout=self.log, stderr=subprocess.STDOUT, env=environment
        )
        for _ in range(600):
            try:
                urllib.request.urlopen(self.url, timeout=10).close()
            except urllib.error.HTTPError as refusal:
                refusal.close()
                return
            except OSError:
                if self.process.poll() is not None:
                    raise AssertionError(self.said()) from None
                time.sleep(0.2)
            else:
                return
        raise AssertionError(self.said())

    def said(self) -> str:
        self.log.flush()
        return (self.folder / "server.log").read_text()

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        self.log.close()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    made = Server(tmp_path_factory.mktemp("server"))
    yield made
    said = made.said()
    made.kill()
    # A browser that leaves while it is answered makes the framework print two, and is no fault.
    assert said.count("Traceback") == 2 * said.count("RuntimeError: No response returned."), said


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        made = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield made
        made.close()


def opened(browser: Any, server: Server, query: str = "", width: int = 1280, **options: Any) -> Any:
    """Open the page, refuse every request to elsewhere, and fail a page that makes one."""
    page = browser.new_context(viewport={"width": width, "height": 900}, **options).new_page()
    page.set_default_timeout(PATIENCE)
    page.outside = []
    page.on(
        "request", lambda r: None if r.url.startswith((server.url, "data:", "blob:")) else page.outside.append(r.url)
    )
    page.goto(server.url + query)
    page.get_by_role("button", name="Load the demo").wait_for()
    return page


def ratios(page: Any) -> list[float]:
    """Return the steps of the ladder over the noise floor."""
    return [float(text) for text in re.findall(r"([\d.e+]+) × floor", page.locator("#ladder").inner_text())]


def start(page: Any, name: str) -> None:
    """Start a job once nothing else is being done; click again if the page moved the button under the pointer."""
    page.get_by_role("button", name="Cancel").wait_for(state="hidden")
    page.get_by_text("output free").first.wait_for()
    refused = page.locator("[role=alert]:visible").filter(has_text=re.compile("."))
    taken = page.get_by_role("button", name="Cancel").or_(refused).first
    for _ in range(5):
        page.get_by_role("button", name=name, exact=True).click()
        try:
            taken.wait_for(timeout=10_000)
        except playwright.TimeoutError:
            continue
        return
    raise AssertionError(f"{name} began nothing: {page.locator('body').inner_text()}")


def move(page: Any, name: str) -> None:
    """Move a slider by one step of the keyboard."""
    page.get_by_role("slider", name=name).locator("[tabindex='0']").focus()
    page.keyboard.press("ArrowRight")


def uploaded(page: Any, field: str, *files: Path) -> None:
    """Choose files in a field for uploads."""
    there = page.locator(".q-uploader", has_text=field)
    if not there.is_visible():
        page.get_by_text("Files of your own").click()
    with page.expect_file_chooser() as chooser:
        there.locator(".q-uploader__header a, .q-uploader__header button").first.click()
    chooser.value.set_files(files)


@pytest.fixture(scope="module")
def demo(browser: Any, server: Server) -> Iterator[Any]:
    """The demo, loaded, with every effect asked what it explains."""
    page = opened(browser, server)
    page.get_by_role("button", name="Load the demo").click()
    page.get_by_text("explains 100 %").wait_for()
    yield page
    assert page.outside == []
    page.context.close()


def test_where_it_fails_is_read_and_the_suggested_effect_explains_it(demo: Any) -> None:
    said = demo.get_by_text(re.compile("^The model fails mostly")).all_inner_texts()
    assert any("unexplained error" in text for text in said)
    assert ratios(demo)[1] > 100
    # The first in the list is the one that explains most.
    box = demo.get_by_role("checkbox").first
    assert box.get_attribute("aria-label") or "stress stiffening" in box.inner_text()
    box.click()
    demo.locator("#ladder").get_by_text("+ stress stiffening").wait_for()
    assert ratios(demo)[2] < 1.15
    demo.get_by_text("The residual is noise").wait_for()
    demo.get_by_text("being asked").first.wait_for(state="detached")


def test_a_slider_moves_curve_and_ladder(demo: Any) -> None:
    before = ratios(demo)
    move(demo, "gain [µm/V]")
    demo.locator("#ladder").get_by_text("set by hand").wait_for()
    demo.wait_for_function("() => /set by hand/.test(document.getElementById('ladder').innerText)")
    after = ratios(demo)
    assert after[:3] == before[:3] and after[3] > 2 * before[2]


def tick(demo: Any, effect: str, *, wanted: bool) -> None:
    """Tick or untick an effect, again if the page was busy: it then says so, and leaves the box as it was."""
    step = demo.locator("#ladder").get_by_text(f"+ {effect}")
    for attempt in range(3):
        box = demo.get_by_role("checkbox", name=effect)
        if box.is_checked() != wanted:
            box.click()
        try:
            step.wait_for(state="attached" if wanted else "detached", timeout=40_000)
            return
        except playwright.TimeoutError:
            if attempt == 2:
                raise


def test_unticked_the_model_is_back_and_ticked_again_at_once(demo: Any) -> None:
    tick(demo, "stress stiffening", wanted=False)
    assert ratios(demo)[-2] > 100
    tick(demo, "stress stiffening", wanted=True)
    assert ratios(demo)[2] < 1.15


def test_report_and_model_are_exported(demo: Any, tmp_path: Path) -> None:
    demo.get_by_role("button", name="Export the report").click()
    with demo.expect_popup() as popup:
        demo.get_by_role("link", name="report.html").click()
    popup.value.get_by_role("heading", name="The error ladder").wait_for()
    popup.value.close()
    with demo.expect_download() as download:
        demo.get_by_role("button", name="Save the model").click()
    download.value.save_as(tmp_path / "saved.toml")
    assert "stress_stiffening" in (tmp_path / "saved.toml").read_text(encoding="utf-8")


def test_a_bad_file_is_told_beside_its_field(browser: Any, server: Server, tmp_path: Path) -> None:
    page = opened(browser, server)
    page.get_by_label("Model (path or bare name)").fill("no_such_model")
    page.get_by_role("button", name="Confront").click()
    page.get_by_text("no_such_model").and_(page.locator("[role=alert]")).first.wait_for()
    wrong = tmp_path / "wrong.toml"
    wrong.write_text((DEMO / "model.toml").read_text().replace("damping_ratio = 0.03", 'damping_ratio = "3 kg"'))
    uploaded(page, "Stage model", wrong)
    told = page.get_by_text(re.compile("wrong.toml: axis.x.damping_ratio = 3 kg"))
    told.wait_for()
    assert str(server.folder) not in told.inner_text()  # no place of the server is told
    assert page.outside == []
    page.context.close()


def processes_of(server: Server) -> list[str]:
    listed = subprocess.run(["ps", "-eo", "ppid,args"], capture_output=True, text=True, check=True).stdout.splitlines()
    return [line for line in listed if line.split()[0] == str(server.process.pid) and "job_process" in line]


def test_a_job_that_is_cancelled_ends(browser: Any, server: Server) -> None:
    page = opened(browser, server)
    page.get_by_role("tab", name="Design").click()
    page.get_by_role("button", name="Open").click()
    page.get_by_text("output free").first.wait_for()
    before = page.locator(".fd-table").first.inner_text()
    move(page, "hinge thickness [mm]")
    page.wait_for_function("t => document.querySelector('.fd-table').innerText !== t", arg=before)
    page.get_by_role("button", name="Solve with finite elements").click()
    page.get_by_role("button", name="Cancel").wait_for()
    while not processes_of(server):
        time.sleep(0.1)
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("Cancelled: the process was ended").wait_for()
    assert not processes_of(server)
    page.context.close()


def test_the_page_and_its_chart_follow_the_scheme(demo: Any) -> None:
    chart = "getElement(Number(document.querySelector('.nicegui-echart').id.slice(1))).chart.getOption()"
    for scheme, is_dark in (("dark", True), ("light", False)):
        demo.emulate_media(color_scheme=scheme)
        demo.wait_for_function("dark => document.body.classList.contains('body--dark') === dark", arg=is_dark)
        demo.wait_for_function(f"dark => {chart}.darkMode === dark", arg=is_dark)
        demo.evaluate("() => document.getAnimations().forEach(each => each.finish())")
        assert demo.evaluate(POOR_CONTRAST) == []
    for palette, light in ((charts.LIGHT, True), (charts.DARK, False)):
        for colour in (palette.measured, palette.modelled, palette.noise, palette.some, palette.large):
            assert contrast(colour, palette.paper) > 4.5
        assert (contrast(palette.paper, "#ffffff") < 1.1) == light


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_what_goes_wrong_is_read_in_both_schemes(browser: Any, server: Server, scheme: str) -> None:
    """A message of several lines lies on nothing; a job that is cancelled is told where the window is."""
    page = opened(browser, server, width=390, color_scheme=scheme)
    page.get_by_label("Model (path or bare name)").fill("no_such_model")
    page.get_by_role("button", name="Confront").click()
    told = page.get_by_text("no_such_model").and_(page.locator("[role=alert]")).first
    told.wait_for()
    box, below = told.bounding_box(), page.get_by_label("Recordings or static tables").bounding_box()
    assert box["y"] + box["height"] <= below["y"]
    assert page.evaluate(POOR_CONTRAST) == []
    page.get_by_role("tab", name="Design").click()
    page.get_by_role("button", name="Open").click()
    page.get_by_role("button", name="Solve with finite elements").click()
    page.get_by_role("button", name="Cancel").click()
    notice = page.get_by_text("Cancelled: the process was ended")
    notice.wait_for()
    assert 0 < notice.bounding_box()["y"] < 900
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.evaluate(POOR_CONTRAST) == []
    assert page.evaluate("document.body.classList.contains('body--dark')") == (scheme == "dark")
    page.get_by_role("button", name="Close").click()
    notice.wait_for(state="detached")
    page.context.close()


def test_two_tabs_do_not_share_their_state(demo: Any, browser: Any, server: Server) -> None:
    other = opened(browser, server)
    assert other.locator("#ladder").count() == 0
    other.get_by_label("Model (path or bare name)").fill("elsewhere")
    assert demo.get_by_label("Model (path or bare name)").input_value().endswith("model.toml")
    assert ratios(demo)[2] < 1.15
    other.context.close()


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_wider_than_the_screen_and_everything_has_a_name(browser: Any, server: Server, width: int) -> None:
    page = opened(browser, server, width=width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    unnamed = page.evaluate(
        "[...document.querySelectorAll('input:not([type=file]), button')].filter(e => e.offsetParent && "
        "!(e.labels?.length || e.getAttribute('aria-label') || e.innerText.trim() || e.closest('label'))).length"
    )
    assert unnamed == 0
    page.keyboard.press("Tab")
    order = []
    for _ in range(6):
        order.append(page.evaluate("document.activeElement.innerText || document.activeElement.ariaLabel || ''"))
        page.keyboard.press("Tab")
    assert [name.strip() for name in order if name.strip() in ("Confront", "Load the demo")]
    page.context.close()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that others reach, which runs no code of theirs."""
    made = Server(tmp_path_factory.mktemp("guarded"), "--host", "0.0.0.0", "--no-code")
    yield made
    made.kill()


def token(server: Server) -> str:
    return re.findall(r"token=([\w-]+)", server.said())[0]


def test_another_host_needs_the_token(browser: Any, guarded: Server) -> None:
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(guarded.url)
    page = opened(browser, guarded, f"?token={token(guarded)}")
    page.get_by_role("tab", name="Design").click()  # the socket has come through, too
    page.get_by_role("button", name="Open").wait_for()
    page.context.close()


def test_no_code_of_others_runs_in_the_page_and_in_its_jobs(browser: Any, guarded: Server, tmp_path: Path) -> None:
    ran = tmp_path / "ran"
    effect, part = (tmp_path / f"their_{what}.py" for what in ("effect", "part"))
    for file in (effect, part):
        file.write_text(f"open({str(ran)!r}, 'w')\n")
    model, design = tmp_path / "model.toml", tmp_path / "design.toml"
    model.write_text((DEMO / "model.toml").read_text() + f'\n[axis.x.effects."{effect}"]\n')
    ours = (ROOT / "geometry" / "bridge_amplifier.toml").read_text()
    design.write_text(re.sub(r"^part = .*$", 'part = "their_part.py"', ours, flags=re.MULTILINE))
    refused = re.compile("--no-code forbids its")
    page = opened(browser, guarded, f"?token={token(guarded)}")
    page.get_by_label("Model (path or bare name)").fill(str(model))
    page.get_by_label("Recordings or static tables").fill(str(DEMO / "runs"))
    page.get_by_role("button", name="Confront").click()
    page.get_by_text(refused).wait_for()
    page.get_by_label("Model (path or bare name)").fill(str(DEMO / "model.toml"))
    uploaded(page, "An effect of your own", effect)
    page.get_by_text("their_effect.py is offered").wait_for()
    page.get_by_role("button", name="Confront").click()
    page.get_by_text(refused).wait_for()
    page.get_by_role("tab", name="Design").click()
    page.get_by_text(refused).wait_for(state="detached")
    page.get_by_label("Design (path or bare name)").fill(str(design))
    page.get_by_role("button", name="Open").click()
    page.get_by_text(refused).wait_for()
    page.get_by_label("Design (path or bare name)").fill("bridge_amplifier")
    page.get_by_role("button", name="Open").click()
    page.get_by_text("Sweep and optimise").click()
    page.get_by_text(refused).wait_for(state="detached")
    study = page.get_by_label("Study")
    study.fill(re.sub('design = ".*"', f'design = "{design}"', study.input_value()))
    start(page, "Sweep")
    told = page.locator("[role=alert]:visible").filter(has_text=re.compile(".")).first
    told.wait_for()
    assert refused.search(told.inner_text()), told.inner_text()
    assert not ran.exists()
    page.context.close()


def test_a_page_of_another_site_is_refused(server: Server) -> None:
    for header in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(urllib.request.Request(server.url, headers=header))


def with_study(browser: Any, server: Server) -> Any:
    """A design that is opened, with its study to begin with."""
    page = opened(browser, server)
    page.get_by_role("tab", name="Design").click()
    page.get_by_role("button", name="Open").click()
    page.get_by_text("Sweep and optimise").click()
    return page


def test_a_sweep_ends_in_its_report(browser: Any, server: Server) -> None:
    page = with_study(browser, server)
    start(page, "Sweep")
    page.get_by_role("link", name="report.html").wait_for()
    page.frame_locator("iframe").get_by_role("heading", level=1).wait_for()
    study = page.get_by_label("Study")
    study.fill(study.input_value().replace("hinge_thickness", "hinge_thicknes"))
    start(page, "Sweep")
    page.get_by_text("did you mean hinge_thickness").wait_for()
    assert page.outside == []
    page.context.close()


def test_a_sweep_starts_from_the_sliders(browser: Any, server: Server) -> None:
    """The best case of the study is that of the formulas with the dimension that was moved."""
    page = with_study(browser, server)
    move(page, "arm span [mm]")
    number = page.get_by_label("arm span [mm]").and_(page.locator("input"))
    playwright.expect(number).not_to_have_value("20", timeout=PATIENCE)
    span = number.input_value()
    start(page, "Sweep")
    page.get_by_role("link", name="report.html").wait_for()
    found = page.get_by_role("row", name=re.compile(r"^0.6 ")).first.inner_text().split()
    moved = fd.formulas("bridge_amplifier", dimensions={"hinge_thickness": "0.6 mm", "arm_span": f"{span} mm"})
    assert moved is not None
    stiffness = moved["K_out_actuator_installed"].value / 1e3
    assert float(found[1]) == pytest.approx(stiffness, rel=1e-3)  # printed with four digits
    assert abs(stiffness / 120.0 - 1) > 3e-3  # and not that of the file
    page.context.close()


def test_what_is_typed_moves_slider_and_study(browser: Any, server: Server) -> None:
    """A value beyond the end of its slider is taken; the study to begin with is about it, until somebody edits it."""
    page = with_study(browser, server)
    number = page.get_by_label("hinge thickness [mm]").and_(page.locator("input"))
    study, slider = page.get_by_label("Study"), page.get_by_role("slider", name="hinge thickness [mm]")
    number.fill("0.8")
    number.press("Tab")
    playwright.expect(study).to_have_value(re.compile('from = "0.64 mm", to = "0.96 mm"'), timeout=PATIENCE)
    playwright.expect(slider).to_have_attribute("aria-valuemax", "0.8", timeout=PATIENCE)
    playwright.expect(slider).to_have_attribute("aria-valuenow", "0.8", timeout=PATIENCE)
    study.fill("# mine")
    number.fill("0.7")
    number.press("Tab")
    playwright.expect(slider).to_have_attribute("aria-valuenow", "0.7", timeout=PATIENCE)
    playwright.expect(study).to_have_value("# mine")
    page.context.close()


@pytest.mark.slow
def test_an_optimum_ends_in_its_report(browser: Any, server: Server) -> None:
    page = with_study(browser, server)
    start(page, "Optimise")
    page.get_by_role("link", name="report.html").wait_for()
    page.frame_locator("iframe").get_by_role("heading", level=1).wait_for()
    assert page.outside == []
    page.context.close()


def test_a_static_table_is_compared_and_an_effect_fitted(browser: Any, server: Server) -> None:
    """The table was made with over-cut notches: studies/hidden_over_cut."""
    page = opened(browser, server, "?model=bridge_amplifier&runs=studies/hidden_over_cut/bench.csv")
    page.get_by_role("link", name="report.html").wait_for()
    page.get_by_role("button", name="Fit this effect").click()
    page.get_by_role("cell", name="+ over cut", exact=True).wait_for()
    page.get_by_label("Static effect (name or path)").fill("over_cutt")
    page.get_by_role("button", name="Fit this effect").click()
    page.get_by_text("did you mean over_cut").wait_for()
    page.context.close()


@pytest.mark.slow
def test_uploaded_model_recordings_and_effect_are_confronted(browser: Any, server: Server, tmp_path: Path) -> None:
    made = subprocess.run(
        [sys.executable, "-m", "flexdesign", "init", "effect", "my_effect"], cwd=tmp_path, check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    (effect,) = tmp_path.rglob("my_effect.py")
    page = opened(browser, server)
    uploaded(page, "Stage model", DEMO / "model.toml")
    uploaded(page, "Recordings", *sorted((DEMO / "runs").iterdir()))
    uploaded(page, "An effect of your own", effect)
    page.get_by_text("my_effect.py is offered").wait_for()
    assert page.get_by_label("Model (path or bare name)").input_value() == "model.toml (uploaded)"
    data = sorted(path.name for path in (DEMO / "runs").iterdir() if path.suffix != ".toml")
    runs = page.get_by_label("Recordings or static tables").input_value()
    assert runs == "; ".join(f"{name} (uploaded)" for name in data)
    page.get_by_role("button", name="Confront").click()
    page.locator("#ladder").get_by_text("recalibrated").wait_for()
    page.get_by_text(re.compile(r"^\d+ more$")).click()
    page.get_by_role("checkbox", name=re.compile("my.effect")).click()
    page.locator("#ladder").get_by_text(re.compile(r"\+ .*my.effect")).wait_for()
    assert page.outside == [], made.stdout
    page.context.close()


def test_the_loop_is_closed_before_and_after(demo: Any) -> None:
    demo.get_by_role("button", name="Close the loop").click()
    demo.get_by_role("table").filter(has_text="without").last.wait_for()
    assert demo.locator(".fd-svg svg").count() >= 1


def test_a_server_that_is_restarted_is_told_and_the_inputs_come_back(demo: Any, server: Server) -> None:
    """The last of the tests with the demo: it stands anew then."""
    demo.get_by_role("button", name="Export the report").click()
    demo.get_by_role("button", name="Cancel").wait_for()  # and the work goes on
    server.kill()
    demo.get_by_text("Connection lost").wait_for()
    server.start()
    demo.get_by_text("The server was restarted").wait_for()
    assert demo.get_by_label("Model (path or bare name)").input_value().endswith("model.toml")
    demo.locator("#ladder").get_by_text("as designed").wait_for()
