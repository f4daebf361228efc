"""Episodes are found in a real browser: with a filter, by heads, by a stretch of an axis."""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

MARGIN, AXES, MIN_TTC = 56, 6, 3
"""Pixels beside the first and the last axis, how many there are, and which one is drawn along."""


def draw_along_min_ttc(page):
    plot = page.locator("#parallel-chart-plot")
    plot.scroll_into_view_if_needed()
    expect(plot.locator("canvas").first).to_be_visible()
    box = plot.bounding_box()
    x = box["x"] + MARGIN + (box["width"] - 2 * MARGIN) * MIN_TTC / (AXES - 1)
    page.mouse.move(x, box["y"] + 160)
    page.mouse.down()
    page.mouse.move(x, box["y"] + 220, steps=4)
    page.mouse.move(x, box["y"] + 260, steps=4)
    page.mouse.up()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_stretch_of_an_axis_narrows_list_and_address(visit, made, scheme):
    address = f"/campaigns/{made.ast}/episodes?filter=outcome+%3D+collision&sort=-severity"
    page = visit(address, color_scheme=scheme)
    draw_along_min_ttc(page)
    box = page.get_by_label("Filter", exact=True)
    expect(box).to_have_value(
        re.compile(r"^outcome = collision and min_ttc_s >= [\d.]+ and min_ttc_s <= [\d.]+$")
    )
    files = page.locator("#found a[download]")
    expect(files.first).to_have_attribute("href", re.compile(r"filter=.*min_ttc_s"))
    assert "sort=-severity" in page.url
    found = page.locator("#found-title").inner_text()
    page.reload()
    expect(page.locator("#found-title")).to_have_text(found)
    expect(box).to_have_value(re.compile("min_ttc_s >= "))


def test_it_works_without_scripts_and_on_a_telephone(visit, made):
    page = visit(
        f"/campaigns/{made.ast}/episodes",
        java_script_enabled=False,
        viewport={"width": 375, "height": 800},
    )
    page.get_by_label("Filter", exact=True).fill("severity > 60")
    page.get_by_role("button", name="Search").click()
    page.get_by_role("link", name="Severity").click()
    assert "filter=severity+%3E+60&sort=-severity" in page.url
    expect(page.get_by_role("columnheader", name="Severity")).to_have_attribute(
        "aria-sort", "descending"
    )
    page.get_by_role("link", name="Next 50").click()
    expect(page.locator("#found-title")).to_contain_text("further")
    page.locator("#found tbody a").first.click()
    expect(page.locator("h1")).to_contain_text("Episode")
