"""How long the dashboard's heaviest pages take, to the last chart, in a browser.

A thousand campaigns with a million episodes in SQLite, an eighth of them in the one whose page is
opened by a browser that knows nothing of the service yet. A page is full when all its parts have
come, safety, cost and workers included, and all its charts are drawn; the window is so tall that
no chart waits to be scrolled to. The page's own clock tells when that was.

Measured in Chromium, and in its shell without windows, which the tests use: the first takes part
of the time for itself, on a machine of two cores that also serves the page.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks.figures import Figure
from benchmarks.speed.crowded_store import fill, fill_modes
from playwright.sync_api import Browser, ViewportSize, sync_playwright

BROWSERS = {"": "/usr/bin/chromium", "_shell": "/usr/bin/chromium-headless-shell"}
"""Programs of Debian by the end that names of figures get; the second is that of the tests."""

ARGUMENTS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
VIEW = ViewportSize(width=1280, height=6_000)
STARTS = 3
"""How often the service is started: its first page of a kind costs what is worked out but once."""

AGAIN = 5
COMMAND = "make bench"
TARGETS = {"page_overview": "<= 0.35", "page_campaign": "<= 0.35"}
FURTHER = "<= 0.5"
"""Target of the pages that have none of their own."""

PATIENCE_MS = 60_000

WATCH = """
const isFull = () => {
  const drawn = [...document.querySelectorAll("figure[data-chart] .plot")];
  return document.readyState === "complete"
    && !document.querySelector("[data-later=wanted]")
    && drawn.every((plot) => plot.querySelector("canvas"));
};
const look = setInterval(() => {
  if (!isFull()) return;
  window.fullAt = performance.now();
  clearInterval(look);
}, 10);
"""


def page_figures() -> dict[str, Figure]:
    """Fill a database, and open the pages."""
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        address = f"sqlite:///{Path(folder) / 'eigenfail.db'}"
        largest, analysis = fill(address), fill_modes(address)
        figures: dict[str, Figure] = {}
        for end, program in BROWSERS.items():
            browser = playwright.chromium.launch(executable_path=program, args=ARGUMENTS)
            figures |= measured(browser, address, Crowd(largest, analysis), end)
            browser.close()
    return figures


class Crowd(NamedTuple):
    """What a crowded database has: the largest campaign, and the newest analysis."""

    campaign: int
    analysis: int


def list_paths(crowd: Crowd) -> dict[str, str]:
    """The pages that are measured, by the names of their figures.

    That of an analysis with 40 modes is taller than the window, in which all charts are drawn.
    """
    return {
        "page_overview": "/",
        "page_campaign": f"/campaigns/{crowd.campaign}",
        "page_mode": f"/analyses/{crowd.analysis}/modes/1",
        "page_releases": "/releases",
        "page_release": f"/releases/{crowd.campaign + 1}",
        "page_search": "/search?q=brakes",
        "page_failures": "/failures",
    }


def measured(browser: Browser, address: str, crowd: Crowd, end: str) -> dict[str, Figure]:
    """The figures of all pages in a browser, whose names have an end."""
    paths = {f"{name}{end}": path for name, path in list_paths(crowd).items()}
    first: dict[str, list[float]] = {name: [] for name in paths}
    again: dict[str, list[float]] = {name: [] for name in paths}
    for _ in range(STARTS):
        with serving(address) as url:
            # What is loaded once for all pages, templates and code, is no part of a page.
            opened(browser, f"{url}/campaigns/{crowd.campaign - 1}")
            for name, path in paths.items():
                first[name].append(opened(browser, f"{url}{path}"))
                again[name] += [opened(browser, f"{url}{path}") for _ in range(AGAIN)]
    return {
        **{
            f"{name}_s": figure(times, LATER, TARGETS.get(name.removesuffix(end), FURTHER))
            for name, times in again.items()
        },
        **{f"{name}_first_s": figure(times, FIRST) for name, times in first.items()},
    }


LATER = "somebody has asked for it since the service was started"
FIRST = "nobody has asked for it since the service was started"


def figure(times: list[float], note: str, target: str = "") -> Figure:
    """The middle of some times."""
    spread = (min(times), max(times))
    return Figure(
        value=median(times),
        unit="s",
        n=len(times),
        spread=spread,
        target=target,
        note=note,
        command=COMMAND,
    )


def opened(browser: Browser, url: str) -> float:
    """Seconds from asking for a page to all of it, in a browser that knows nothing of it yet."""
    context = browser.new_context(viewport=VIEW)
    context.add_init_script(WATCH)
    page = context.new_page()
    page.goto(url, wait_until="commit")
    page.wait_for_function("() => window.fullAt", timeout=PATIENCE_MS, polling=100)
    took_ms: float = page.evaluate("window.fullAt")
    context.close()
    return took_ms / 1_000.0


@contextmanager
def serving(address: str) -> Iterator[str]:
    """The service over a database, in a process of its own."""
    command = [sys.executable, "-m", "eigenfail_api", "--database", address, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        if process.stdout is None:
            raise RuntimeError("a pipe was asked for")
        try:
            yield process.stdout.readline().split()[-1]
        finally:
            process.terminate()
