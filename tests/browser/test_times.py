"""Times on pages: in the time zone of the browser, and in UTC without JavaScript."""

from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def write(at_ms, zone, name):
    at = datetime.fromtimestamp(at_ms / 1_000, UTC).astimezone(zone)
    return f"{at:%Y-%m-%d %H:%M:%S} {name}"


@pytest.mark.parametrize(
    ("zone", "name"),
    [("Asia/Kolkata", "UTC+05:30"), ("America/Phoenix", "UTC−07:00"), ("UTC", "UTC")],
)
def test_times_are_those_of_the_browser(visit, made, store, zone, name):
    at_ms = store.campaigns.get(made.ast).created_ms
    page = visit(f"/campaigns/{made.ast}", timezone_id=zone)
    created = page.locator("dt", has_text="Created").locator("xpath=..").locator("time")
    expect(created).to_have_text(write(at_ms, ZoneInfo(zone), name))
    expect(created).to_have_attribute("title", write(at_ms, UTC, "UTC"))
    expect(page.locator("#zone")).to_have_text("all times in the time zone of this browser")


def test_without_scripts_times_are_in_utc(visit, made, store):
    at_ms = store.campaigns.get(made.ast).created_ms
    page = visit(f"/campaigns/{made.ast}", timezone_id="Asia/Kolkata", java_script_enabled=False)
    created = page.locator("dt", has_text="Created").locator("xpath=..").locator("time")
    expect(created).to_have_text(write(at_ms, UTC, "UTC"))
    expect(page.locator("#zone")).to_have_text("all times in UTC")


def test_times_stay_local_when_a_part_of_the_page_is_replaced(visit, queue, store):
    campaign = queue("moved while it is looked at")
    page = visit(f"/campaigns/{campaign}", timezone_id="Asia/Kolkata")
    expect(page.locator('[data-feed="live"]')).to_be_visible()
    store.campaigns.move(campaign, "running")
    expect(page.locator("#live .badge")).to_contain_text("running")
    texts = page.locator("time[datetime]").all_text_contents()
    assert texts
    assert all(text.endswith(" UTC+05:30") for text in texts), texts
