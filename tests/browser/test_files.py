"""What can be taken along from a page, and what an administrator changes there."""

import httpx2
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


def test_an_administrator_changes_the_quotas_of_a_key(bare_address, visit):
    asked = {"name": "ci", "scope": "admin", "quotas": {"max_open": 3}}
    token = httpx2.post(f"{bare_address}/api/v1/keys", json=asked).json()["token"]
    page = visit("/login?next=/keys", server=bare_address)
    page.get_by_label("Key").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.get_by_label("Change the quotas of ci").click()
    row = page.get_by_role("row", name="ci")
    expect(row.get_by_label("Max. open campaigns")).to_have_value("3")
    row.get_by_label("Max. open campaigns").fill("")
    row.get_by_label("Max. episodes per campaign").fill("500")
    row.get_by_role("button", name="Set quotas").click()
    expect(row).to_contain_text("500 episodes per campaign")
    expect(row).not_to_contain_text("campaigns open")
