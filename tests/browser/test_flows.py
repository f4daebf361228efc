"""What users do, and what they see without doing anything."""

import pytest
from playwright.sync_api import expect

from eigenfail.values import AnalysisResult, AnalysisSettings

pytestmark = pytest.mark.browser

HIDE = (
    "() => { Object.defineProperty(document, 'hidden', {value: %s, configurable: true});"
    " document.dispatchEvent(new Event('visibilitychange')); }"
)


@pytest.fixture
def live(visit):
    """Opens a page and waits until it listens."""

    def open_page(path, **options):
        page = visit(path, **options)
        expect(page.locator("#feed")).to_have_text("live")
        return page

    return open_page


def test_cancelling_asks_first_and_shows_the_end(live, store, queue):
    campaign = queue("to be cancelled")
    page = live(f"/campaigns/{campaign}")
    page.once("dialog", lambda dialog: dialog.dismiss())
    page.get_by_role("button", name="Cancel").click()
    assert store.campaigns.get(campaign).state == "queued"
    page.once("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("#live .badge").first).to_contain_text("cancelled")
    expect(page.get_by_role("button", name="Cancel")).to_have_count(0)
    assert store.campaigns.get(campaign).state == "cancelled"


def test_pausing_and_resuming(live, queue):
    page = live(f"/campaigns/{queue('to rest')}")
    page.get_by_role("button", name="Pause").click()
    page.get_by_role("button", name="Resume").click()
    expect(page.locator("#live .badge").first).to_contain_text("queued")


def test_a_refusal_is_told_in_words(visit, store, queue):
    campaign = queue("soon gone")
    # Without the feed the page does not notice that the campaign moved on.
    page = visit(f"/campaigns/{campaign}")
    page.evaluate(HIDE % "true")
    store.campaigns.move(campaign, "running")
    store.campaigns.move(campaign, "done")
    page.get_by_role("button", name="Pause").click()
    expect(page.get_by_role("alert")).to_contain_text("is done and cannot be paused")


def test_the_overview_follows_the_store(live, store, queue, bring):
    page = live("/")
    campaign = queue("appears by itself")
    line = page.locator(f"#campaign-{campaign}")
    expect(line).to_contain_text("queued")
    store.campaigns.move(campaign, "running")
    expect(line).to_contain_text("running")
    bring(campaign, range(40), 1.0)
    expect(line).to_contain_text("40 of 40")


def test_a_campaign_page_follows_its_campaign(live, store, queue, bring):
    campaign = queue("grows")
    store.campaigns.move(campaign, "running")
    page = live(f"/campaigns/{campaign}")
    expect(page.get_by_text("No failure yet")).to_be_visible()
    bring(campaign, range(30), 1.0)
    expect(page.locator(".tiles").first).to_contain_text("30 of 30")
    expect(page.locator("#curve-chart canvas").first).to_be_visible()
    page.locator("#curve-chart summary").click()
    page.get_by_role("button", name="Show more failures").click()
    expect(page.get_by_role("rowheader", name="29", exact=True)).to_be_visible()
    bring(campaign, range(30, 60), 0.0)
    expect(page.locator(".tiles").first).to_contain_text("30 of 60")
    # What the reader opened stays open, and the chart is drawn anew in place.
    expect(page.locator("#curve-chart-data tbody tr")).to_have_count(2)
    expect(page.locator("#curve-chart-data tbody tr").last).to_be_visible()
    page.locator("#curve-chart canvas").first.scroll_into_view_if_needed()
    blocks = "element => echarts.getInstanceByDom(element).getOption().series[1].data.length"
    assert page.locator("#curve-chart .plot").evaluate(blocks) == 2


def test_a_tab_that_nobody_looks_at_gives_its_connection_back(live):
    page = live("/")
    page.evaluate(HIDE % "true")
    expect(page.locator("#feed")).to_have_text("not live")
    page.evaluate(HIDE % "false")
    expect(page.locator("#feed")).to_have_text("live")


def test_an_analysis_is_launched_and_watched_until_its_modes_appear(live, store, made):
    page = live(f"/campaigns/{made.ast}")
    page.get_by_label("Modes").fill("2")
    page.get_by_role("button", name="Analyse").click()
    expect(page.locator("h1")).to_contain_text("Analysis")
    analysis = int(page.url.rsplit("/", 1)[1])
    assert store.analyses.get(analysis).settings == AnalysisSettings(clusters=2)
    expect(page.get_by_text("waits for its turn")).to_be_visible()
    found = store.analyses.get(made.analysis).result
    assert isinstance(found, AnalysisResult)
    store.analyses.start(analysis)
    store.analyses.finish(analysis, found)
    expect(page.get_by_text("The modes are distinct")).to_be_visible()
    expect(page.locator("#eigenfailure-chart canvas").first).to_be_visible()
    page.get_by_role("button", name="Replay the eigenfailures").click()
    expect(page.get_by_role("button", name="Replay again")).to_be_visible()
    replay = store.analyses.get(analysis).replay_campaign
    expect(page.get_by_role("link", name=f"campaign {replay}")).to_be_visible()
    assert store.campaigns.get(replay).spec.settings == {"analysis": analysis}


def test_a_server_that_comes_back_is_found_again(live, visit):
    # The page may be asking at the very moment when it goes offline.
    visit.tolerate("Failed to fetch")
    page = live("/")
    page.context.set_offline(True)
    page.evaluate(HIDE % "true")
    page.evaluate(HIDE % "false")
    expect(page.locator("#feed")).to_contain_text("connection lost")
    page.context.set_offline(False)
    expect(page.locator("#feed")).to_have_text("live")
