"""Saved views in a browser, with JavaScript and without."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("with_scripts", [True, False])
def test_a_view_is_saved_opened_renamed_and_deleted(visit, made, with_scripts):
    address = f"/campaigns/{made.difs}/episodes?filter=severity+%3E+80&sort=-severity"
    page = visit(address, java_script_enabled=with_scripts)
    first = page.url
    name, renamed = f"hard <b>ones</b> {with_scripts}", f"hard & new {with_scripts}"
    page.locator("#views > summary").click()
    page.get_by_label("Name of the view").fill(name)
    page.get_by_role("button", name="Save this view").click()
    expect(page).to_have_url(first)
    page.goto(first.split("?")[0])
    page.locator("#views > summary").click()
    page.get_by_role("link", name=name).click()
    expect(page).to_have_url(first)
    expect(page.locator("#filter")).to_have_value("severity > 80")
    page.locator("#views > summary").click()
    page.get_by_text("Rename or delete").click()
    page.get_by_label("Name", exact=True).fill(renamed)
    page.get_by_role("button", name="Rename").click()
    page.locator("#views > summary").click()
    expect(page.get_by_role("link", name=renamed)).to_have_attribute("aria-current", "true")
    page.get_by_text("Rename or delete").click()
    page.get_by_role("button", name=f"Delete the view {renamed}").click()
    expect(page).to_have_url(first)
    expect(page.get_by_text("No views of this list yet.")).to_be_attached()


def test_a_view_of_one_campaign_opens_with_another(visit, made, store):
    query = "filter=steps+%3C+75"
    page = visit(f"/campaigns/{made.difs}/episodes?{query}")
    other = page.url.split("/campaigns/")[0] + f"/campaigns/{made.ast}/episodes"
    page.locator("#views > summary").click()
    page.get_by_label("Name of the view").fill("short ones")
    page.get_by_role("button", name="Save this view").click()
    page.goto(other)
    page.locator("#views > summary").click()
    page.get_by_role("link", name="short ones").click()
    expect(page).to_have_url(
        page.url.split("/campaigns/")[0] + f"/campaigns/{made.ast}/episodes?filter=steps+%3C+75"
    )
    for view in store.views.page(9).items:
        store.views.delete(view.id)


def test_views_of_campaigns_and_failures(visit, store):
    for path, query in (("/", "state=done&sort=-failures"), ("/failures", "planner=rulebook")):
        page = visit(f"{path}?{query}")
        first = page.url
        page.locator("#views > summary").click()
        page.get_by_label("Name of the view").fill(f"view of {path}")
        page.get_by_role("button", name="Save this view").click()
        page.locator("#views > summary").click()
        expect(page.get_by_role("link", name=f"view of {path}")).to_have_attribute(
            "aria-current", "true"
        )
        page.goto(first.split("?")[0])
        page.locator("#views > summary").click()
        page.get_by_role("link", name=f"view of {path}").click()
        expect(page.get_by_role("link", name="Clear filters")).to_be_visible()
