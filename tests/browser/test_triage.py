"""Triage in a browser, with JavaScript and without."""

import pytest
from playwright.sync_api import expect

from eigenfail_services.store.triage import episode_subject, mode_subject


@pytest.mark.parametrize("with_scripts", [True, False])
def test_a_mode_is_triaged(visit, made, with_scripts):
    page = visit(f"/analyses/{made.snapshot}/modes/1", java_script_enabled=with_scripts)
    form = page.locator("#triage")
    form.get_by_label("State").select_option("known")
    form.get_by_label("Owner").fill("anna & ben")
    form.get_by_label("Labels").fill("late, braking")
    form.get_by_label("Ticket").fill("https://tickets.example/7")
    form.get_by_role("button", name="Save").click()
    expect(page).to_have_url(f"{page.url.split('#')[0]}#triage")
    expect(form.get_by_label("Owner")).to_have_value("anna & ben")
    expect(form.get_by_label("State")).to_have_value("known")
    expect(form.get_by_role("link", name="tickets.example")).to_be_visible()
    note = f"seen <b>twice</b>, {with_scripts}"
    form.get_by_label("New note").fill(note)
    form.get_by_role("button", name="Add note").click()
    expect(form.get_by_text(note)).to_be_visible()


def test_all_episodes_of_a_filter_are_triaged(visit, made, store):
    address = f"/campaigns/{made.difs}/episodes?filter=index%20%3C%203"
    page = visit(address, java_script_enabled=False)
    page.get_by_text("Triage all episodes that match").click()
    form = page.locator("#triage")
    form.get_by_label("State").select_option("fixed")
    form.get_by_role("button", name="Change all that match").click()
    expect(page.get_by_role("status")).to_have_text("Triage of 3 episodes was changed.")
    states = [store.triage.get(episode_subject(made.difs, index)).state for index in range(4)]
    assert states == ["fixed", "fixed", "fixed", "new"]


def test_a_ticket_that_is_no_address_is_not_sent(visit, made, store):
    page = visit(f"/analyses/{made.snapshot}/modes/2")
    before = store.triage.get(mode_subject(made.snapshot, 2))
    form = page.locator("#triage")
    form.get_by_label("Ticket").fill("tickets/7")
    form.get_by_role("button", name="Save").click()
    expect(form.locator("input:invalid")).to_have_count(1)
    assert store.triage.get(mode_subject(made.snapshot, 2)) == before
