"""The workbench's pictures in docs/pictures: its states in headless Chromium, at 1280 and at 390 pixels.

    python -m studies.workbench_pictures [FOLDER]

Needs the extras `workbench` and `dev`, and Debian's Chromium, on Linux; about two minutes.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
DEMO = ROOT / "studies" / "hidden_effect_demo"
STATIC = "?model=bridge_amplifier&runs=studies/hidden_over_cut/bench.csv"
#: Milliseconds that anything may take, and until the page is at rest.
PATIENCE, REST = 120_000, 800
#: Width and height of a window of each kind in the pictures of several states, its scheme, and its width there [px].
WINDOWS = {"narrow": (390, 760, "light", 300), "wide": (1280, 620, "dark", 600)}
#: Pixels between the states of a picture; how many stand in a row, and the quality of the picture.
GAP, IN_A_ROW, QUALITY = 6, {"narrow": 5, "wide": 2}, 72
#: Width of a picture of one state [px].
SINGLE = 1000


class Server:
    """A workbench in a process of its own, which may be killed and started anew on the same port."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        self.start()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        command = [sys.executable, "-m", "flexdesign", "workbench", "--no-browser", "--port", str(self.port)]
        self.process = subprocess.Popen(command, cwd=ROOT, env=os.environ, stdout=subprocess.DEVNULL)
        while self.process.poll() is None:
            try:
                urllib.request.urlopen(self.url, timeout=10).close()
            except OSError:
                time.sleep(0.2)
            else:
                return
        raise SystemExit("the workbench does not start; see above")

    def kill(self) -> None:
        """End it as a power cut does."""
        self.process.kill()
        self.process.wait()


def main() -> None:
    """Take all pictures, and print their sizes."""
    from playwright.sync_api import sync_playwright

    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "pictures"
    server = Server()
    try:
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            _single_states(browser, server, folder)
            for kind in WINDOWS:
                _join(kind, _several_states(browser, server, kind), folder)
            browser.close()
    finally:
        server.kill()
    for path in sorted(folder.glob("workbench_*.webp")):
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


def _opened(browser: Any, url: str, width: int, height: int, scheme: str = "light") -> Any:
    page = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme).new_page()
    page.set_default_timeout(PATIENCE)
    page.goto(url)
    page.get_by_role("button", name="Load the demo").wait_for()
    return page


def _seen(page: Any) -> bytes:
    page.mouse.move(2, 2)
    page.wait_for_timeout(REST)
    picture: bytes = page.screenshot()
    return picture


def _single_states(browser: Any, server: Server, folder: Path) -> None:
    """Take the demo as loaded and with its effect ticked, the tab Design, and a static table."""
    page = _opened(browser, server.url, 1280, 1640)
    page.get_by_role("button", name="Load the demo").click()
    page.get_by_text("explains 100 %").wait_for()
    _write(folder / "workbench_loaded.webp", _seen(page), SINGLE)
    page.get_by_role("checkbox").first.click()
    page.locator("#ladder").get_by_text("+ stress").wait_for()
    page.get_by_text("being asked").first.wait_for(state="detached")
    _write(folder / "workbench_ticked.webp", _seen(page), SINGLE)
    page.set_viewport_size({"width": 390, "height": 800})
    page.wait_for_timeout(REST)
    page.set_viewport_size({"width": 390, "height": page.evaluate("document.documentElement.scrollHeight")})
    _write(folder / "workbench_narrow.webp", _seen(page), 390)
    page.context.close()
    page = _opened(browser, server.url, 1280, 1000)
    _open_design(page)
    _write(folder / "workbench_design.webp", _seen(page), SINGLE)
    page.set_viewport_size({"width": 1280, "height": 700})
    page.goto(server.url + STATIC)
    page.get_by_role("link", name="report.html").wait_for()
    page.get_by_role("button", name="Fit this effect").click()
    page.get_by_role("cell", name="+ over cut", exact=True).wait_for()
    _write(folder / "workbench_static.webp", _seen(page), SINGLE)
    page.context.close()


def _open_design(page: Any) -> None:
    page.get_by_role("tab", name="Design").click()
    page.get_by_role("button", name="Open").click()
    page.get_by_text("output free").first.wait_for()


def _several_states(browser: Any, server: Server, kind: str) -> list[bytes]:
    """Take an error, an upload that is refused, a cancelled job, a restarted server, and the tab Design."""
    width, height, scheme, _ = WINDOWS[kind]
    page = _opened(browser, server.url, width, height, scheme)
    page.get_by_label("Model (path or bare name)").fill("no_such_model")
    page.get_by_role("button", name="Confront").click()
    page.get_by_text("no_such_model").and_(page.locator("[role=alert]")).first.wait_for()
    taken = [_seen(page)]
    page.get_by_label("Model (path or bare name)").fill("")
    page.get_by_text("Files of your own").click()
    with tempfile.TemporaryDirectory() as scratch:
        wrong = Path(scratch) / "wrong.toml"
        text = (DEMO / "model.toml").read_text(encoding="utf-8")
        wrong.write_text(text.replace("damping_ratio = 0.03", 'damping_ratio = "3 kg"'), encoding="utf-8")
        _upload(page, "Stage model", [wrong])
        page.get_by_text(re.compile("wrong.toml: axis.x.damping_ratio = 3 kg")).wait_for()
    _upload(page, "Recordings", sorted((DEMO / "runs").iterdir()))
    page.get_by_text("1-quiet.csv").first.wait_for()
    page.locator(".q-uploader").first.scroll_into_view_if_needed()
    taken.append(_seen(page))
    _open_design(page)
    thickness = page.get_by_role("slider", name="hinge thickness [mm]")
    thickness.scroll_into_view_if_needed()
    thickness.locator("[tabindex='0']").focus()
    page.keyboard.press("ArrowRight")
    design = _seen(page)
    page.get_by_role("button", name="Solve with finite elements").click()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("Cancelled: the process").wait_for()
    taken.append(_seen(page))
    page.goto(server.url)
    page.get_by_role("button", name="Load the demo").click()
    page.get_by_text("explains 100 %").wait_for()
    server.kill()
    page.get_by_text("Connection lost").wait_for()
    server.start()
    page.get_by_text("The server was restarted").wait_for()
    page.locator("#ladder").get_by_text("as designed").wait_for()
    page.evaluate("scrollTo(0, 0)")
    taken.append(_seen(page))
    page.context.close()
    return [*taken, design]


def _upload(page: Any, field: str, files: list[Path]) -> None:
    place = page.locator(".q-uploader", has_text=field)
    with page.expect_file_chooser() as chooser:
        place.locator(".q-uploader__header a, .q-uploader__header button").first.click()
    chooser.value.set_files(files)


def _resized(data: bytes, width: int) -> Any:
    from PIL import Image

    picture = Image.open(io.BytesIO(data)).convert("RGB")
    return picture.resize((width, picture.height * width // picture.width), Image.Resampling.LANCZOS)


def _write(path: Path, data: bytes, width: int) -> None:
    _resized(data, width).save(path, quality=QUALITY, method=6)


def _join(kind: str, taken: list[bytes], folder: Path) -> None:
    """Write several states as one picture, in rows."""
    from PIL import Image

    columns, width = IN_A_ROW[kind], WINDOWS[kind][3]
    states = [_resized(data, width) for data in taken]
    height, rows = states[0].height, -(-len(states) // columns)
    size = (columns * (width + GAP) - GAP, rows * (height + GAP) - GAP)
    joined = Image.new("RGB", size, (138, 148, 158))
    for place, state in enumerate(states):
        joined.paste(state, (place % columns * (width + GAP), place // columns * (height + GAP)))
    joined.save(folder / f"workbench_states_{kind}.webp", quality=QUALITY, method=6)


if __name__ == "__main__":
    main()
