"""docs/first_ten_minutes.md: who follows it finds the links and buttons that it names."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from eigenfail.values.campaign import CampaignState

pytestmark = pytest.mark.browser

PAGE = Path(__file__).parents[2] / "docs" / "first_ten_minutes.md"
NAMED = re.compile(r"(?<!\*)\*([^*\n]+)\*(?!\*)")


def test_the_page_leads_from_the_campaigns_to_a_comparison(visit, made, store, bring):
    followed = []
    page = visit("/")

    def press(name, role="link"):
        page.locator("main").get_by_role(role, name=name, exact=True).first.click()
        followed.append(name)

    followed.append(page.get_by_role("heading", level=1).text_content())
    press("AST on cut-in")
    press("Worst failures")
    page.locator("tbody a").first.click()
    press("Play", "button")
    expect(page.locator("main").get_by_role("button", name="Pause", exact=True)).to_be_visible()
    mode = page.get_by_text("Failure mode").get_by_role("link").last
    while not mode.count():
        page.get_by_role("link", name="Next episode").click()
        page.wait_for_load_state()
    episode = page.url
    mode.click()
    press("Play all", "button")
    expect(page.get_by_text("Cost per failure of the mode")).to_be_visible()
    page.goto(episode)
    expect(page.get_by_role("button", name="Shrink this failure")).to_be_visible()
    press("Replay now", "button")
    followed.append("Shrink this failure")
    expect(page).to_have_url(re.compile(r"/replays/\d+"))
    page.goto(f"{episode.partition('/episodes')[0]}")
    press("Clone")
    page.locator("#field-planner").select_option("idm")
    page.locator("#field-name").fill("idm in its place")
    press("Launch", "button")
    expect(page.locator("h1")).to_have_text("idm in its place")
    second = int(page.url.rsplit("/", 1)[1])
    store.campaigns.move(second, CampaignState.RUNNING)
    bring(second, range(20), 0.5)
    store.campaigns.move(second, CampaignState.DONE)
    press("Compare")
    page.get_by_role("checkbox", name=f"{made.ast}: AST on cut-in", exact=True).check()
    press("Compare", "button")
    expect(page).to_have_url(
        re.compile(f"campaign={second}&campaign={made.ast}|{made.ast}.*{second}")
    )
    page.get_by_role("navigation", name="Main").get_by_role("link", name="Suites").click()
    followed.append("Suites")
    press("New suite")
    expect(page.locator("h1")).to_have_text("New suite")
    assert followed == NAMED.findall(PAGE.read_text())
