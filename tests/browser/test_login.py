"""Signing in: from any page to the form, back to that page, and out again."""

import httpx2
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser


@pytest.fixture
def token(bare_address):
    """The key of an administrator; from it on, everybody needs one."""
    made = httpx2.post(f"{bare_address}/api/v1/keys", json={"name": "me <b>", "scope": "admin"})
    return made.json()["token"]


def test_a_page_leads_to_the_form_and_the_form_to_the_page(bare_address, token, visit):
    page = visit("/suites?before=7", server=bare_address)
    expect(page).to_have_url(f"{bare_address}/login?next=/suites%3Fbefore%3D7")
    field = page.get_by_label("Key")
    expect(field).to_be_focused()
    field.fill("ef_1_wrong")
    field.press("Enter")
    expect(page.get_by_role("alert").filter(has_text="Invalid key")).to_be_visible()
    page.get_by_label("Key").fill(token)
    page.get_by_role("button", name="Sign in").click()
    expect(page).to_have_url(f"{bare_address}/suites?before=7")
    expect(page.get_by_text("signed in as me <b>")).to_be_visible()
    (cookie,) = page.context.cookies()
    assert (cookie["httpOnly"], cookie["sameSite"], cookie["secure"]) == (True, "Strict", False)
    assert cookie["value"] not in token
    assert token.split("_", 2)[2] not in page.content()


def test_the_pages_work_with_the_cookie_until_one_signs_out(bare_address, token, visit):
    page = visit("/login?next=/", server=bare_address)
    page.get_by_label("Key").fill(token)
    page.get_by_role("button", name="Sign in").click()
    expect(page.locator('[data-feed="live"]')).to_be_visible()
    page.evaluate(
        """() => fetch("/api/v1/campaigns", {
             method: "POST",
             headers: {"Content-Type": "application/json"},
             body: JSON.stringify({name: "sent", method: "monte_carlo", episodes: 5}),
           })"""
    )
    page.goto(bare_address)
    expect(page.get_by_role("link", name="sent")).to_be_visible()
    page.get_by_role("button", name="Sign out").click()
    expect(page).to_have_url(f"{bare_address}/login")
    page.goto(f"{bare_address}/")
    expect(page.get_by_role("heading", name="Sign in")).to_be_visible()
    assert page.context.cookies() == []


def test_a_page_of_somebody_else_cannot_sign_anybody_out(bare_address, token, visit):
    page = visit("/login", server=bare_address)
    page.get_by_label("Key").fill(token)
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_text("signed in as")).to_be_visible()
    form = f'<form method="post" action="{bare_address}/logout"><button>Win</button></form>'
    page.goto(f"data:text/html,{form}")
    page.get_by_role("button", name="Win").click()
    expect(page.get_by_text("are not allowed")).to_be_visible()
    page.goto(f"{bare_address}/suites")
    expect(page.get_by_text("signed in as")).to_be_visible()


def test_an_administrator_makes_a_key_and_revokes_it(bare_address, token, visit):
    page = visit("/login?next=/keys", server=bare_address)
    page.get_by_label("Key").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.get_by_label("Owner").fill("ci <i>")
    page.get_by_label("Scope").select_option("runner")
    page.locator("#new-key").get_by_label("Max. open campaigns").fill("0")
    page.get_by_role("button", name="Create key").click()
    expect(page.get_by_text("The key of ci <i>.")).to_be_visible()
    made = page.get_by_label("The new key").text_content()
    header = {"Authorization": f"Bearer {made}"}
    campaigns = f"{bare_address}/api/v1/campaigns"
    assert httpx2.get(campaigns, headers=header).status_code == 200
    expect(page.get_by_role("row", name="ci <i>")).to_contain_text("0 of 0 campaigns open")
    page.once("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Revoke the key of ci <i>").click()
    expect(page.get_by_role("row", name="ci <i>")).to_contain_text("revoked")
    assert httpx2.get(campaigns, headers=header).status_code == 401
    page.get_by_role("link", name="Audit log", exact=True).click()
    expect(page.get_by_role("row", name="DELETE")).to_contain_text("/api/v1/keys/{key}")
