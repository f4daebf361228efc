"""The search in the head of every page, and the key that leads to it."""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_a_key_leads_to_the_search_and_the_search_to_what_it_finds(visit, made):
    page = visit("/suites")
    field = page.get_by_role("searchbox", name="Search campaigns, episodes")
    page.keyboard.press("/")
    expect(field).to_be_focused()
    expect(field).to_have_value("")
    page.keyboard.type(f"{made.ast}/0")
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile(rf"/search\?q={made.ast}%2F0$"))
    page.get_by_role("link", name=f"Episode {made.ast}/0").click()
    expect(page).to_have_url(re.compile(rf"/campaigns/{made.ast}/episodes/0$"))


def test_the_key_is_a_letter_in_a_field(visit, made):
    page = visit("/")
    field = page.get_by_label("Name contains")
    field.focus()
    page.keyboard.press("/")
    expect(field).to_be_focused()
    expect(field).to_have_value("/")
