"""The risk page at four widths in both colour schemes, held to what every page is held to."""

import deadlines
import pytest
from borrowed_fixtures import borrow
from playwright.sync_api import expect

pytestmark = [pytest.mark.browser, pytest.mark.timeout(deadlines.TEST_S)]

LAYOUT = borrow("browser", "test_layout.py")
tab, show, troubles_of = (LAYOUT[name] for name in ("tab", "show", "troubles_of"))


def test_the_page_fits_every_width_and_axe_finds_nothing(show):
    assert not troubles_of(show("/risk"))


def test_the_answer_about_a_risk_fits_every_width_and_axe_finds_nothing(show, filled):
    tab = show("/risk")
    example = tab.get_by_label("Example", exact=True).text_content()
    question = tab.get_by_label("File, as TOML")
    expect(question).to_have_value("")
    question.fill(example.replace("[1]", f"[{filled.baseline}]"))
    tab.get_by_role("button", name="Assess").click()
    expect(tab.locator(".verdict")).to_contain_text("Motorway")
    assert not troubles_of(tab)
