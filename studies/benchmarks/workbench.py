"""How long the workbench lets one wait: first page, a slider, a tick; on the demo, in Chromium.

    python -m studies.benchmarks.workbench [PORT]

Needs the extras `workbench` and `dev`, and Debian's Chromium. Each time is the median of several in one run.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent.parent
#: Times of the page and the slider, and of a tick; what is promised [s].
PAGES, SLIDES, TICKS = 5, 20, 3
PROMISED = {"first page": 3.0, "slider": 0.1, "tick": 3.0}
#: Milliseconds from a key on a slider until the ladder has changed, measured in the page itself.
SLIDE = """
() => new Promise(resolve => {
  const ladder = document.getElementById('ladder').parentElement, began = performance.now();
  new MutationObserver((_, seen) => { seen.disconnect(); resolve(performance.now() - began); })
    .observe(ladder, {childList: true, subtree: true, characterData: true});
  document.activeElement.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', keyCode: 39, bubbles: true}));
})
"""


def main() -> None:
    """Measure, and print a table."""
    from playwright.sync_api import sync_playwright

    port = sys.argv[1] if len(sys.argv) > 1 else "8791"
    url = f"http://127.0.0.1:{port}/"
    server = subprocess.Popen(
        [sys.executable, "-m", "flexdesign", "workbench", "--no-browser", "--port", port], cwd=ROOT, env=os.environ
    )
    try:
        _wait_for(url)
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            found = {"first page": [_first_page(browser, url) for _ in range(PAGES)]}
            found["tick"] = [_tick(browser, url, found) for _ in range(TICKS)]
            browser.close()
    finally:
        server.terminate()
        server.wait()
    for name, seconds in found.items():
        median, worst = statistics.median(seconds), max(seconds)
        print(f"{name}: median {median:.3g} s, worst {worst:.3g} s of {len(seconds)}; promised {PROMISED[name]:g} s")


def _wait_for(url: str) -> None:
    for _ in range(300):
        try:
            urllib.request.urlopen(url, timeout=10).close()
        except OSError:
            time.sleep(0.2)
        else:
            return


def _timed(action: Callable[[], Any]) -> float:
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


def _first_page(browser: Any, url: str) -> float:
    page = browser.new_context().new_page()
    page.set_default_timeout(120_000)

    def see() -> None:
        page.goto(url)
        page.get_by_role("button", name="Load the demo").wait_for()

    seconds = _timed(see)
    page.context.close()
    return seconds


def _tick(browser: Any, url: str, found: dict[str, list[float]]) -> float:
    page = browser.new_context().new_page()
    page.set_default_timeout(600_000)
    page.goto(url)
    page.get_by_role("button", name="Load the demo").click()
    page.get_by_text("explains 100 %").wait_for()

    def tick() -> None:
        page.get_by_role("checkbox", name="stress stiffening").click()
        page.locator("#ladder").get_by_text("+ stress stiffening").wait_for()

    seconds = _timed(tick)
    if "slider" not in found:
        time.sleep(2.0)
        page.get_by_role("slider", name="gain [um/V]").locator("[tabindex='0']").focus()
        found["slider"] = [page.evaluate(SLIDE) / 1000 for _ in range(SLIDES)]
    page.context.close()
    return seconds


if __name__ == "__main__":
    main()
