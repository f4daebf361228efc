"""Triage in a browser, with JavaScript and without."""

import pytest
from playwright.sync_api import expect


@pytest.mark.parametrize("with_scripts", [True, False])
def test_a_mode_is_triaged(visit, made, with_scripts):
    page = visit(f"/analyses/{made.snapshot}/modes/1", java_script_enabled=with_scripts)
    form = page.locator("#triage")
    note = f"seen <b>twice</b>, {with_scripts}"
    form.get_by_label("State").select_option("known")
    form.get_by_label("Note").fill(note)
    form.get_by_label("Ticket").fill("https://tickets.example/7")
    form.get_by_role("button", name="Save").click()
    expect(page).to_have_url(f"{page.url.split('#')[0]}#triage")
    expect(form.get_by_label("State")).to_have_value("known")
    expect(form.get_by_label("Note")).to_have_value(note)
    expect(form.get_by_role("link", name="tickets.example")).to_be_visible()


def test_a_ticket_that_is_no_address_is_not_sent(visit, made, store):
    page = visit(f"/analyses/{made.snapshot}/modes/2")
    before = store.analyses.get_triage(made.snapshot, 2)
    form = page.locator("#triage")
    form.get_by_label("Ticket").fill("tickets/7")
    form.get_by_role("button", name="Save").click()
    expect(form.locator("input:invalid")).to_have_count(1)
    assert store.analyses.get_triage(made.snapshot, 2) == before
