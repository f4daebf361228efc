"""The page of webhooks in a browser: made, tested, deactivated and deleted."""

from playwright.sync_api import expect

from eigenfail.signatures import make_secret


def test_a_webhook_is_made_tested_and_deleted(visit, bare_address):
    page = visit("/webhooks", server=bare_address)
    expect(page.get_by_text("No webhooks yet.")).to_be_visible()
    page.get_by_label("URL").fill("https://hooks.example/<i>")
    page.get_by_label("Events").select_option("gate.failed")
    page.get_by_role("button", name="Create webhook").click()
    expect(page.get_by_text("The secret of webhook 1.")).to_be_visible()
    secret = page.get_by_label("The new secret").text_content()
    assert secret.startswith("whsec_")
    assert len(secret) == len(make_secret())
    row = page.get_by_label("Table of webhooks").get_by_role("row", name="hooks.example")
    expect(row).to_contain_text("gate.failed")
    page.get_by_role("button", name="Send a test event to webhook 1").click()
    expect(page.get_by_role("row", name="webhook.test")).to_contain_text("pending")
    page.get_by_role("button", name="Deactivate webhook 1").click()
    expect(row).to_contain_text("inactive")
    expect(page.get_by_role("button", name="Activate webhook 1", exact=True)).to_be_visible()
    page.reload()
    assert secret not in page.content()
    page.once("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Delete webhook 1").click()
    expect(page.get_by_text("No webhooks yet.")).to_be_visible()
