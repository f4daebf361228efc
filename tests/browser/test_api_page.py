"""The page of the API in a real browser: quiet under the strict policy, tried without a mouse."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_is_reached_from_any_page_and_quiet(visit, scheme):
    page = visit("/", color_scheme=scheme)
    page.get_by_role("navigation", name="Main").get_by_role("link", name="API").click()
    expect(page.locator("h1")).to_have_text("API")
    page.get_by_role("navigation", name="Contents").get_by_role("link", name="schemas").click()
    expect(page.locator("#schema-CampaignSpec")).to_be_visible()


def test_a_route_is_tried_by_keyboard(visit, made):
    page = visit("/api#get_campaign")
    route = page.locator("#get_campaign")
    field = route.get_by_role("textbox", name="campaign")
    expect(field).to_be_visible()
    field.fill(str(made.ast))
    field.press("Enter")
    expect(route.locator(".answer")).to_contain_text(f"200 OK · /api/v1/campaigns/{made.ast}")
    expect(route.locator(".answer pre")).to_contain_text("AST on cut-in")
    field.fill("999")
    field.press("Enter")
    expect(route.locator(".answer")).to_contain_text("urn:eigenfail:not-found")


def test_a_link_opens_the_schema_that_it_names(visit):
    page = visit("/api#list_campaigns")
    page.locator("#list_campaigns").get_by_role("link", name="CampaignState").click()
    expect(page.locator("#schema-CampaignState")).to_have_attribute("open", "")


def test_a_file_is_told_by_its_size(visit, made):
    page = visit("/api#get_report")
    form = page.locator("#get_report form")
    form.get_by_role("textbox", name="campaign").fill(str(made.ast))
    form.get_by_role("textbox", name="format").fill("zip")
    form.get_by_role("button").click()
    expect(page.locator("#get_report .answer")).to_contain_text("bytes of application/zip")


def test_it_fits_a_telephone(visit):
    page = visit("/api#list_episodes", viewport={"width": 375, "height": 700})
    expect(page.locator("#list_episodes form")).to_be_visible()
    assert page.evaluate(OVERFLOW) <= 0


def test_without_scripts_the_examples_remain(visit):
    page = visit("/api", java_script_enabled=False)
    page.locator("#create_campaign > summary").click()
    expect(page.locator("#create_campaign pre")).to_contain_text("curl -X POST")
    expect(page.locator("#list_campaigns form")).to_be_hidden()
