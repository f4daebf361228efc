"""Campaigns picked and compared in a real browser."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

OPTION = "element => echarts.getInstanceByDom(element).getOption().series.map(%s)"


@pytest.fixture
def several(made):
    """Of campaigns that have run."""
    ids = (made.baseline, made.ast, made.difs, made.replay)
    return "/comparison?" + "&".join(f"campaign={each}" for each in ids)


def test_campaigns_are_picked_and_drawn_together(visit, made):
    page = visit("/comparison")
    page.get_by_label(f"{made.ast}: AST on cut-in", exact=True).check()
    page.get_by_label("Name contains").fill("difs")
    page.get_by_role("button", name="Search").click()
    expect(page.get_by_label(f"{made.ast}: AST on cut-in", exact=True)).to_be_checked()
    page.get_by_label(f"{made.difs}: DiFS <b>on</b> cut-in").check()
    page.get_by_role("button", name="Compare", exact=True).click()
    plots = page.locator(".plot")
    expect(plots).to_have_count(4)
    for plot in plots.all():
        plot.scroll_into_view_if_needed()
        expect(plot.locator("canvas").first).to_be_visible()


def test_each_has_a_colour_a_shape_and_a_dash_of_its_own(visit, several):
    page = visit(several)
    plot = page.locator("#overlay-rate .plot")
    plot.scroll_into_view_if_needed()
    expect(plot.locator("canvas").first).to_be_visible()
    for look in (
        "one => one.itemStyle.color",
        "one => one.symbol",
        "one => String(one.lineStyle.type)",
    ):
        found = plot.evaluate(OPTION % look)
        assert len(found) == len(set(found)) == 4


def test_campaigns_are_picked_without_a_mouse(visit, made):
    page = visit("/comparison")
    for campaign in (made.ast, made.baseline):
        page.locator(f"input[value='{campaign}']").focus()
        page.keyboard.press("Space")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Difference from the baseline")).to_be_visible()


def test_what_is_chosen_is_changed_with_links_alone(visit, made, several):
    page = visit(several, java_script_enabled=False)
    page.get_by_role("link", name=f"Set as baseline: {made.difs}: DiFS <b>on</b> cut-in").click()
    expect(page.get_by_text(f"Baseline: {made.difs}: DiFS")).to_be_visible()
    page.get_by_role("link", name=f"Remove {made.difs}: DiFS <b>on</b> cut-in").click()
    expect(page.get_by_text(f"Baseline: {made.baseline}: Monte Carlo")).to_be_visible()
    expect(page.locator("#chosen li")).to_have_count(3)
