"""Every page at four widths, in both colour schemes: nothing overflows, and axe-core finds nothing.

Each is drawn, with all of its charts, and quiet: it asks no other host, and its console is empty.

The pages come from the routes of the application, so that a new page cannot be left out.
"""

import hashlib
import json
import re
from html import unescape
from pathlib import Path
from urllib.parse import quote

import deadlines
import httpx2
import pytest
from fastapi.responses import HTMLResponse
from playwright.sync_api import expect

from eigenfail.values.access import KeyRequest, Scope
from eigenfail_api.app import FORMS, ROUTERS
from eigenfail_services.access import make_key

pytestmark = [pytest.mark.browser, pytest.mark.timeout(deadlines.TEST_S)]

VENDOR = Path(__file__).parent / "vendor"
WIDEST = {"width": 1440, "height": 900}
LAYOUT_RULES = ["scrollable-region-focusable"]
RULES = {
    (1440, "light"): None,
    (1440, "dark"): ["color-contrast"],
    (1024, "light"): LAYOUT_RULES,
    (768, "light"): LAYOUT_RULES,
    (375, "dark"): None,
}
"""Rules of axe-core at a width in a scheme, None for all.

Other pairs would tell nothing new: colours do not depend on the width, nor widths on the scheme.
But at 375 px tables have no header row: dark is checked twice.
"""

PAGES = {
    "/": ["/", "/?search=nothing-has-this-name"],
    "/login": ["/login"],
    "/keys": ["/keys"],
    "/audit": ["/audit"],
    "/campaigns/{campaign}": [
        *("/campaigns/{ast}", "/campaigns/{difs}", "/campaigns/{queued}"),
        *("/campaigns/{long}", "/campaigns/{errored}", "/campaigns/{varied}"),
    ],
    "/campaigns/{campaign}/measures": ["/campaigns/{long}/measures"],
    "/campaigns/{campaign}/episodes": [
        *("/campaigns/{long}/episodes", "/campaigns/{long}/episodes?filter=unknown%20%3D%201"),
    ],
    "/campaigns/{campaign}/episodes/{index}": [
        *("/campaigns/{real}/episodes/0", "/campaigns/{long}/episodes/6"),
        "/campaigns/{baseline}/episodes/1",
    ],
    "/campaigns/{campaign}/episodes/{index}/account": ["/campaigns/{real}/episodes/0/account"],
    "/campaigns/{campaign}/episodes/{index}/clip": ["/campaigns/{real}/episodes/0/clip"],
    "/replays/{campaign}": ["/replays/{queued}"],
    "/analyses/{analysis}": [
        *("/analyses/{analysis}", "/analyses/{failed_analysis}", "/analyses/{waiting_analysis}"),
        "/analyses/{snapshot}",
    ],
    "/analyses/{analysis}/modes/{mode}": ["/analyses/{snapshot}/modes/1"],
    "/analyses/{analysis}/modes/{mode}/history": ["/analyses/{snapshot}/modes/1/history"],
    "/analyses/{analysis}/modes/{mode}/overlay": ["/analyses/{snapshot}/modes/1/overlay"],
    "/comparison": [
        *("/comparison", "/comparison?a={ast}&b={long}"),
        "/comparison?campaign={ast}&campaign={long}&campaign={difs}",
    ],
    "/releases": ["/releases", "/releases?project=none"],
    "/releases/{campaign}": ["/releases/{real}"],
    "/failures": ["/failures", "/failures?planner=none"],
    "/gates": ["/gates"],
    "/gates/{gate}": ["/gates/{gate}"],
    "/workers": ["/workers"],
    "/search": ["/search", "/search?q=a", "/search?q=nothing-has-this-name"],
    "/copies": ["/copies?path=/campaigns"],
    "/suites": ["/suites"],
    "/suites/{suite:path}": ["/suites/{suite}"],
    "/glossary": ["/glossary"],
    "/launch": ["/launch", "/launch?from={long}&wish=check&settings.alpha=-1&seed=4"],
    "/launch/suite": ["/launch/suite"],
}
"""Addresses of the pages of each route."""

PIECES = {"/campaigns/{campaign}/failures"}
"""Routes whose answer is a piece of another page, and no document."""

NOT_FOUND = "/campaigns/999999"

CHARTS = {
    "/": 4,
    "/campaigns/{ast}": 4,
    "/campaigns/{difs}": 4,
    "/campaigns/{queued}": 0,
    "/campaigns/{long}/measures": 2,
    "/campaigns/{real}/episodes/0": 5,
    "/campaigns/{baseline}/episodes/1": 1,
    "/analyses/{analysis}": 7,
    "/analyses/{snapshot}": 7,
    "/analyses/{failed_analysis}": 0,
    "/comparison?a={ast}&b={long}": 2,
}
"""How many charts some of the pages have."""

READY = """() => document.readyState === "complete"
  && (document.documentElement.classList.contains("js") || !document.querySelector("script"))
  && !document.querySelector("[data-later=wanted]")"""
OPEN = """() => {
  const [first] = document.querySelectorAll("details.data");
  for (const one of document.querySelectorAll("details:not(.data)")) one.open = true;
  if (first) first.open = true;
}"""
STILL_TO_COME = "#copies-here > a, .mode-clip:not(:has(.clip, .stage, a))"
TITLE = re.compile("<title>(.*?)</title>", re.DOTALL)
SETTLE = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
OVERFLOWING = """() => {
  const scrolls = (one) => getComputedStyle(one).overflowX !== "visible";
  const folded = [...document.querySelectorAll("details.data:not([open])")];
  for (const one of folded) one.open = true;
  const excess = document.documentElement.scrollWidth - window.innerWidth;
  const found = excess > 0 ? [`the page, by ${excess} px`] : [];
  for (const table of document.querySelectorAll("table")) {
    if (!table.offsetWidth) continue;
    const within = table.parentElement;
    const edge = within.getBoundingClientRect();
    const reachable = scrolls(within) && within.tabIndex >= 0;
    if (table.getBoundingClientRect().right > edge.right + 1 && !reachable) {
      found.push(`a table in ${within.tagName}.${within.className}`);
    }
  }
  for (const name of document.querySelectorAll("tbody th[scope=row] > a")) {
    if (name.offsetWidth && name.closest("th").offsetWidth < 40) found.push(`${name.textContent}`);
  }
  for (const one of folded) one.open = false;
  return found;
}"""
RUN_AXE = """async (only) => {
  const rules = { "label-content-name-mismatch": { enabled: true } };
  const asked = only ? { runOnly: { type: "rule", values: only } } : { rules };
  const quick = { resultTypes: ["violations"], preload: false, selectors: false };
  const { violations } = await axe.run(document, { ...quick, ...asked });
  return violations.map(({ id, impact, nodes }) =>
    `${id} (${impact}): ${nodes.slice(0, 3).map((node) => node.html.slice(0, 160)).join(" | ")}`);
}"""


def document_routes():
    """Paths of the routes that answer with HTML."""
    for router in (*ROUTERS, *FORMS):
        for route in router.routes:
            kind = getattr(route.response_class, "value", route.response_class)
            if "GET" in route.methods and kind is HTMLResponse:
                yield route.path


def test_every_route_of_a_page_is_listed_here():
    assert {*document_routes()} == PAGES.keys() | PIECES


def test_axe_is_what_its_manifest_says():
    (library,) = json.loads((VENDOR / "manifest.json").read_text())
    assert {path.name for path in VENDOR.iterdir()} == {*library["files"], "manifest.json"}
    for name, expected in library["files"].items():
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == expected, name


@pytest.fixture(scope="module")
def tab(browser, store, address, watch, troubles):
    """One tab of an administrator who has signed in, with axe-core in each document."""
    token = make_key(store, KeyRequest("Administrator of the test bench", Scope.ADMIN)).token
    asked = {"name": "nightly regression of the planners", "scope": "runner"}
    shown = {"Authorization": f"Bearer {token}"}
    assert httpx2.post(f"{address}/api/v1/keys", json=asked, headers=shown).is_success
    context = browser.new_context(viewport=WIDEST)
    context.add_init_script((VENDOR / "axe.min.js").read_text("utf-8"))
    context.set_default_timeout(1_000 * deadlines.PROCESS_S)
    assert context.request.post(f"{address}/login", form={"key": token}).ok
    page = context.new_page()
    watch(page, troubles)
    yield page
    context.close()


@pytest.fixture
def show(tab, address, filled, troubles):
    """Opens a page as wide as the widest screen, with its charts drawn and its details open."""
    ids = {**vars(filled), "suite": quote(filled.suite, safe="")}

    def open_page(path):
        tab.set_viewport_size(WIDEST)
        tab.emulate_media(color_scheme="light")
        answer = tab.goto(address + path.format(**ids))
        tab.wait_for_function(READY)
        tab.evaluate(OPEN)
        expect(tab.locator(STILL_TO_COME)).to_have_count(0)
        for plot in tab.locator(".plot").all():
            plot.scroll_into_view_if_needed()
        expect(tab.locator(".plot:not(:has(canvas))")).to_have_count(0)
        if path in CHARTS:
            expect(tab.locator(".plot")).to_have_count(CHARTS[path])
        expect(tab.locator("details.data:not(:has(tbody tr))")).to_have_count(0)
        # What was fetched later came in documents of their own.
        expect(tab).to_have_title(unescape(TITLE.search(answer.text())[1]))
        return tab

    yield open_page
    assert not troubles


ADDRESSES = [*(path for paths in PAGES.values() for path in paths), NOT_FOUND]


@pytest.mark.parametrize("path", ADDRESSES)
def test_a_page_fits_every_width_and_axe_finds_nothing(show, path):
    assert not troubles_of(show(path))


def troubles_of(page):
    """What overflows or is wrong for axe-core, by width and colour scheme."""
    found = {}
    for (width, scheme), rules in RULES.items():
        page.set_viewport_size({"width": width, "height": 900})
        page.emulate_media(color_scheme=scheme)
        page.evaluate(SETTLE)
        if wrong := page.evaluate(OVERFLOWING) + page.evaluate(RUN_AXE, rules):
            found[width, scheme] = wrong
    return found
