"""Pages on paper: no navigation, nothing cut off, and every chart drawn."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

A4_PX = 687  # 210 mm without two margins of 14 mm, at 96 pixels an inch
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
CONTROLS = "header.top, footer nav, .actions, button, .button, details.data, details.copy"
EMPTY_PLOTS = """() => [...document.querySelectorAll(".plot")].filter((plot) => {
  const canvas = plot.querySelector("canvas");
  if (!canvas) return true;
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return !data.some((value, place) => place % 4 === 3 && value > 0);
}).map((plot) => plot.id)"""
LIGHT_INK = "rgb(22, 32, 42)"
INK = "getComputedStyle(document.body).color"
NOTE_INK = """() => {
  const ink = () => getComputedStyle(document.body).color;
  addEventListener("beforeprint", () => { window.inkOfPaper = ink(); });
  addEventListener("afterprint", () => { window.inkOfScreen = ink(); });
}"""

PAGES = {
    "/": 2,
    "/campaigns/{ast}": 4,
    "/analyses/{analysis}": 7,
    "/comparison?campaign={ast}&campaign={difs}": 4,
    "/campaigns/{ast}/episodes/{failure}": 5,
}
"""Pages with charts, and how many each has."""


@pytest.fixture
def path_of(made):
    return lambda path: path.format(**{**vars(made), "failure": made.failures[3]})


@pytest.mark.parametrize(("path", "charts"), PAGES.items())
def test_paper_has_every_chart_no_navigation_and_nothing_is_cut_off(visit, path_of, path, charts):
    # The test reads each plot twice, which the browser advises against.
    visit.tolerate("willReadFrequently")
    # Nothing is scrolled to, so that the screen needs few of them.
    page = visit(path_of(path), viewport={"width": 1280, "height": 300}, color_scheme="dark")
    expect(page.locator("html.js")).to_be_attached()
    expect(page.locator("[data-later=wanted]")).to_have_count(0)
    page.evaluate(NOTE_INK)
    pdf = page.pdf(format="A4")
    assert pdf.startswith(b"%PDF")
    assert page.locator(".plot").count() >= charts
    assert page.evaluate(EMPTY_PLOTS) == []
    assert page.evaluate("window.inkOfPaper") == LIGHT_INK
    assert page.evaluate("window.inkOfScreen") != LIGHT_INK

    page.emulate_media(media="print", color_scheme="dark")
    page.set_viewport_size({"width": A4_PX, "height": 600})
    expect(page.locator(".plot:not(:has(canvas))")).to_have_count(0)
    assert page.evaluate(EMPTY_PLOTS) == []
    assert [one for one in page.locator(CONTROLS).all() if one.is_visible()] == []
    assert page.evaluate(INK) == LIGHT_INK
    assert page.evaluate(OVERFLOW) <= 0
    for wide in page.locator("table").all():
        if wide.is_visible():
            box = wide.bounding_box()
            assert box["x"] + box["width"] <= A4_PX + 1, wide.evaluate("one => one.className")
