"""What a figure is, beside the figure: by pointer, by keyboard, by finger."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

WITHIN = """element => {
  const {left, right, top} = element.getBoundingClientRect();
  return left >= 0 && right <= document.documentElement.clientWidth && top >= 0;
}"""


@pytest.fixture
def campaign_page(visit, made):
    """Opens the page of a campaign."""
    return lambda **options: visit(f"/campaigns/{made.ast}", **options)


def button(page, name):
    return page.locator("#live .tiles").first.get_by_role("button", name=f"Definition of {name}")


def test_a_click_tells_what_a_figure_is_and_another_one_closes_it(campaign_page):
    page = campaign_page()
    card = page.get_by_role("dialog", name="Cost per failure")
    button(page, "Cost per failure").click()
    expect(card).to_contain_text("instance-hours ÷ failures")
    expect(card).to_contain_text("[USD]")
    expect(button(page, "Cost per failure")).to_have_attribute("aria-expanded", "true")
    button(page, "Cost per failure").click()
    expect(card).to_be_hidden()
    button(page, "log p").click()
    button(page, "Failure").click()
    expect(page.get_by_role("dialog", name="Failure")).to_contain_text("a collision of the ego")
    page.locator("h1").click()
    expect(page.locator("#definition")).to_be_hidden()


def test_the_keyboard_opens_it_reads_on_and_comes_back(campaign_page):
    page = campaign_page()
    button(page, "log p").press("Enter")
    card = page.get_by_role("dialog", name="log p")
    expect(card).to_be_focused()
    page.keyboard.press("Tab")
    expect(card.get_by_role("link")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.locator("#definition")).to_be_hidden()
    expect(button(page, "log p")).to_be_focused()


def test_it_leads_to_the_glossary(campaign_page):
    page = campaign_page()
    button(page, "log p").click()
    page.get_by_role("dialog").get_by_role("link").click()
    expect(page).to_have_url(page.url.partition("/glossary")[0] + "/glossary#log-p")
    expect(page.locator("dt:target")).to_contain_text("log p")


def test_it_stays_within_a_telephone(campaign_page):
    page = campaign_page(viewport={"width": 375, "height": 700}, has_touch=True)
    for term in page.locator("#live .tiles").first.locator("[data-term]").all():
        term.tap()
        expect(page.locator("#definition")).to_be_visible()
        assert page.locator("#definition").evaluate(WITHIN), term.get_attribute("data-term")
        page.keyboard.press("Escape")


def test_its_script_is_no_part_of_the_page(campaign_page):
    page, asked = campaign_page(), []
    page.on("request", lambda request: asked.append(request.url.rsplit("/", 1)[-1]))
    page.reload(wait_until="networkidle")
    assert "definitions.js" not in asked
    button(page, "log p").click()
    expect(page.get_by_role("dialog")).to_be_visible()
    assert "definitions.js" in asked
