"""What users do, and what they see without doing anything."""

import re

import pytest
from playwright.sync_api import expect

from eigenfail.values.analysis import AnalysisSettings
from eigenfail_api.dashboard import campaign_page
from eigenfail_services.campaigns.analysis_jobs import run_analysis

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


def test_a_priority_is_changed_and_shown(live, store, queue):
    campaign = queue("in a hurry")
    page = live(f"/campaigns/{campaign}")
    page.get_by_role("button", name="High priority").click()
    expect(page.locator("#course")).to_contain_text("has the priority high from now on")
    expect(page.get_by_role("button", name="Normal priority")).to_be_visible()
    expect(page.get_by_role("button", name="High priority")).to_have_count(0)
    assert store.campaigns.get(campaign).spec.priority == "high"


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
    expect(page.locator("#measures").get_by_role("row", name="Collision")).to_contain_text("50.0 %")
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


@pytest.fixture
def launched(live, made):
    """The page of an analysis that was launched from the form; its id."""
    page = live(f"/campaigns/{made.ast}")
    page.get_by_label("Axes").select_option("longitudinal")
    page.get_by_label("Modes", exact=True).fill("2")
    page.get_by_label("Bootstrap").fill("5")
    page.get_by_label("Further campaigns").fill(f"{made.difs}, {made.replay}")
    page.get_by_role("button", name="Analyse").click()
    expect(page.locator("h1")).to_contain_text("Analysis")
    return page, int(page.url.rsplit("/", 1)[1])


def test_an_analysis_is_launched_and_watched_until_its_modes_appear(launched, store, made):
    page, analysis = launched
    further = (made.difs, made.replay)
    asked = AnalysisSettings(axes="longitudinal", clusters=2, bootstrap=5, campaigns=further)
    assert store.analyses.get(analysis).settings == asked
    expect(page.get_by_text("queued or running")).to_be_visible()
    run_analysis(store, analysis)
    expect(page.get_by_text("2 distinct modes")).to_be_visible()
    expect(page.get_by_text(f"more episodes were to come in campaign {made.difs}")).to_be_visible()
    expect(page.locator(".modes article")).to_have_count(2)
    expect(page.get_by_text("Adjusted Rand index", exact=True)).to_be_visible()
    expect(page.get_by_role("cell", name="s before the collision").first).to_be_visible()
    page.locator("#training-mean-chart").scroll_into_view_if_needed()
    expect(page.locator("#training-mean-chart canvas").first).to_be_visible()


def test_a_proof_is_asked_for_and_followed_to_its_end(launched, store, replayed):
    page, analysis = launched
    run_analysis(store, analysis)
    page.get_by_role("button", name="Replay the modes").click()
    expect(page.get_by_text(re.compile(r"\d+ / 12 replays"))).to_be_visible()
    expect(page.locator("#proof form[data-api]")).to_have_count(0)
    page.get_by_text("Each replay").click()
    same, *others = store.analyses.replays(analysis)
    replayed(same)
    expect(page.get_by_text("4 / 12 replays")).to_be_visible()
    # What the reader opened stays open, and fills.
    expect(page.get_by_role("link", name=f"{same}/0")).to_be_visible()
    for other in others:
        replayed(other)
    expect(page.get_by_text("12 / 12 replays, all ended")).to_be_visible()
    expect(page.locator("#proof .tile").nth(1)).to_contain_text("3 of 6")
    page.get_by_role("link", name=f"{same}/0").click()
    expect(page.locator("h1")).to_have_text("Episode 0")


def test_measures_that_cannot_be_made_leave_the_page_as_it_was(visit, address, made, monkeypatch):
    # What is known already comes with the page.
    monkeypatch.setattr(campaign_page.costs, "is_prefetched", lambda begun: False)
    page = visit("/")
    page.route("**/measures", lambda route: route.fulfill(status=500, body="{}"))
    page.goto(f"{address}/campaigns/{made.ast}")
    expect(page.get_by_role("alert")).to_contain_text("could not be computed")
    expect(page.get_by_role("link", name="Safety and cost on a separate page")).to_be_visible()


def test_an_account_that_others_hold_up_is_asked_for_again(live, made):
    page = live("/")
    answers = iter([503])

    def busy_once(route):
        status = next(answers, None)
        route.fulfill(status=status, body="{}") if status else route.continue_()

    page.route("**/account", busy_once)
    page.goto(page.url + f"campaigns/{made.ast}/episodes/{made.failures[0]}")
    expect(page.locator("#account .account")).to_be_visible()
    expect(page.get_by_role("alert")).to_be_hidden()
    assert next(answers, None) is None
