"""How long the workbench lets one wait: first page, a slider, a tick; on the demo, in Chromium.

    python -m studies.benchmarks.workbench [PORT]

Needs the extras `workbench` and `dev`, and Debian's Chromium, on Linux. Each time is the median of several in one run;
and the processor time of the server, which does not depend on what else the machine does.
"""

from __future__ import annotations

import os
import re
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
LIMITS = {"first page": 3.0, "slider": 0.1, "tick": 3.0, "tick before the evidence": 3.0}
#: Milliseconds from a key on a slider until the ladder has changed and is painted, measured in the page itself.
SLIDE = """
() => new Promise(resolve => {
  const ladder = document.getElementById('ladder').parentElement, began = performance.now();
  const painted = () => requestAnimationFrame(() => setTimeout(() => resolve(performance.now() - began)));
  new MutationObserver((_, seen) => { seen.disconnect(); painted(); })
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
    measured = Measured(server.pid)
    try:
        _wait_for(url)
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            for _ in range(PAGES):
                _first_page(browser, url, measured)
            for is_early in (False, True):
                for _ in range(TICKS):
                    _tick(browser, url, measured, is_early)
            browser.close()
    finally:
        server.terminate()
        server.wait()
    print(measured)


class Measured:
    """Times of the page and processor times of the server, by what was done.

    Parameters
    ----------
    pid
        Process of the server.
    """

    def __init__(self, pid: int) -> None:
        self.pid, self.seconds = pid, dict[str, list[tuple[float, float]]]()

    def take(self, name: str, action: Callable[[], float | None]) -> None:
        """Do something; what it returns is how long it took, if it knows [s]."""
        began, spent = time.perf_counter(), self._spent()
        seconds = action()
        seconds = time.perf_counter() - began if seconds is None else seconds
        self.seconds.setdefault(name, []).append((seconds, self._spent() - spent))

    def _spent(self) -> float:
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")  # user and system time

    def __str__(self) -> str:
        lines = []
        for name, pairs in self.seconds.items():
            (median, cpu), worst = map(statistics.median, zip(*pairs, strict=True)), max(pairs)[0]
            lines.append(
                f"{name}: median {median:.3g} s, worst {worst:.3g} s of {len(pairs)}, processor time {cpu:.2g} s; "
                f"promised {LIMITS[name]:g} s"
            )
        return "\n".join(lines)


def _wait_for(url: str) -> None:
    for _ in range(300):
        try:
            urllib.request.urlopen(url, timeout=10).close()
        except OSError:
            time.sleep(0.2)
        else:
            return


def _first_page(browser: Any, url: str, measured: Measured) -> None:
    page = browser.new_context().new_page()
    page.set_default_timeout(120_000)

    def see() -> None:
        page.goto(url)
        page.get_by_role("button", name="Load the demo").wait_for()

    measured.take("first page", see)
    page.context.close()


def _tick(browser: Any, url: str, measured: Measured, is_early: bool) -> None:
    page = browser.new_context().new_page()
    page.set_default_timeout(600_000)
    page.goto(url)
    page.get_by_role("button", name="Load the demo").click()
    if is_early:
        page.get_by_text(re.compile(r"^\d+ more$")).click()
    else:
        page.get_by_text("explains 100 %").wait_for()

    def tick() -> None:
        page.get_by_role("checkbox", name="stress stiffening").click()
        page.locator("#ladder").get_by_text("+ stress stiffening").wait_for()

    measured.take("tick before the evidence" if is_early else "tick", tick)
    if "slider" not in measured.seconds:
        page.get_by_text("being asked").first.wait_for(state="detached")
        page.get_by_role("slider", name="gain [µm/V]").locator("[tabindex='0']").focus()
        for _ in range(SLIDES):
            measured.take("slider", lambda: float(page.evaluate(SLIDE)) / 1000)
    page.context.close()


if __name__ == "__main__":
    main()
