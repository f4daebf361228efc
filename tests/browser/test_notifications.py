"""Notifications of the browser: asked for by a click alone, and shown once."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

START = "Notify me when this campaign ends"
STOP = "Do not notify me when this campaign ends"

RECORD = """
window.shown = [];
window.asked = 0;
const Original = window.Notification;
window.Notification = class {
  static get permission() { return Original.permission; }
  static requestPermission() {
    window.asked += 1;
    return Original.requestPermission();
  }
  constructor(title, options) { window.shown.push([title, options.body, options.tag]); }
};
"""
"""What a page shows and asks for is noted; the permission is that of the browser."""


@pytest.fixture
def look(visit):
    """Opens a page whose notifications are noted, in a browser with these permissions."""

    def go(path, permissions=("notifications",)):
        page = visit("/glossary", permissions=[*permissions])
        page.context.add_init_script(RECORD)
        page.goto(page.url.replace("/glossary", path))
        return page

    return go


def end(store, campaign):
    store.campaigns.move(campaign, "running")
    store.campaigns.move(campaign, "done")


def test_a_campaign_that_ends_is_announced_once(look, queue, store):
    campaign = queue("ends soon")
    page = look(f"/campaigns/{campaign}")
    assert page.evaluate("window.asked") == 0
    page.get_by_role("button", name=START).click()
    expect(page.get_by_role("button", name=STOP)).to_be_visible()
    assert page.evaluate("window.asked") == 1
    other = page.context.new_page()
    other.goto(page.url.replace(f"/campaigns/{campaign}", "/glossary"))
    page.close()
    end(store, campaign)
    other.wait_for_function("() => window.shown.length > 0")
    body = "ends soon: 0 failures in 0 completed episodes."
    title = f"Campaign {campaign} has ended: done"
    assert other.evaluate("window.shown") == [[title, body, f"eigenfail-{campaign}"]]
    assert other.evaluate("localStorage.getItem('notify')") == "[]"


def test_a_request_is_withdrawn_and_survives_a_reload(look, queue):
    page = look(f"/campaigns/{queue('is not watched')}")
    page.get_by_role("button", name=START).click()
    page.get_by_role("button", name=STOP).wait_for()
    page.reload()
    page.get_by_role("button", name=STOP).click()
    expect(page.get_by_role("button", name=START)).to_be_visible()
    assert page.evaluate("localStorage.getItem('notify')") == "[]"


def test_all_open_campaigns_of_the_first_page_are_watched(look, queue, store):
    campaign = queue("on the first page")
    page = look("/")
    page.get_by_role("button", name="Notify me when these campaigns end").click()
    page.get_by_role("button", name="Do not notify me when these campaigns end").wait_for()
    end(store, campaign)
    page.wait_for_function("() => window.shown.length > 0")
    assert page.evaluate("window.shown[0][2]") == f"eigenfail-{campaign}"


def test_a_browser_that_refuses_is_not_asked_again_by_itself(look, queue):
    page = look(f"/campaigns/{queue('refused')}", permissions=())
    page.evaluate("window.Notification.requestPermission = async () => 'denied'")
    page.get_by_role("button", name=START).click()
    expect(page.locator("#notice")).to_contain_text("does not allow notifications")
    expect(page.get_by_role("button", name=START)).to_be_visible()
    assert page.evaluate("localStorage.getItem('notify')") is None


def test_without_the_interface_there_is_no_button(visit, queue):
    campaign = queue("without notifications")
    page = visit("/glossary")
    page.context.add_init_script("delete window.Notification")
    page.goto(page.url.replace("/glossary", f"/campaigns/{campaign}"))
    expect(page.locator('[data-feed="live"]')).to_be_visible()
    expect(page.locator("[data-notify]")).to_be_hidden()


def test_an_ended_campaign_has_no_button(visit, queue, store):
    campaign = queue("has ended")
    end(store, campaign)
    page = visit(f"/campaigns/{campaign}")
    expect(page.locator("[data-notify]")).to_have_count(0)
