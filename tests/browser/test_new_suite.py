"""The page of a new suite in a real browser: a file is uploaded, previewed and launched once."""

import re

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

SUITE = """
name = "uploaded"
[base]
method = "monte_carlo"
episodes = 20
simulator = "point_mass"
[grid]
seed = [1, 2, 3]
planner = ["idm", "rulebook"]
"""


def list_members(store, suite):
    found = [each.spec.name for each in store.campaigns.page(200).items]
    return sorted(name for name in found if name.startswith(f"{suite}: "))


def test_a_file_is_uploaded_previewed_and_launched_once(visit, store, tmp_path):
    file = tmp_path / "suite.toml"
    file.write_text(SUITE)
    page = visit("/suites")
    page.get_by_role("link", name="New suite").click()
    page.locator("#import-file").set_input_files(file)
    preview = page.locator("#preview")
    expect(preview.get_by_role("heading")).to_have_text("uploaded: 6 campaigns, 120 episodes")
    expect(preview.get_by_role("row")).to_have_count(7)
    assert list_members(store, "uploaded") == []
    page.evaluate(
        "() => { const button = document.querySelector('button[value=launch]');"
        " button.click(); button.click(); }"
    )
    expect(page).to_have_url(re.compile(r"/suites/uploaded$"))
    expect(page.get_by_role("heading", name="uploaded", exact=True)).to_be_visible()
    assert list_members(store, "uploaded") == [
        f"uploaded: seed={seed}, planner={planner}"
        for seed in (1, 2, 3)
        for planner in ("idm", "rulebook")
    ]


def test_a_file_that_is_chosen_before_the_scripts_run_is_previewed(visit, tmp_path):
    file = tmp_path / "suite.toml"
    file.write_text(SUITE.replace("uploaded", "early"))
    page = visit("/suites")
    held = []

    def hold(route):
        held.append(route)

    page.route("**/js/launch.js*", hold)
    page.get_by_role("link", name="New suite").click()
    page.locator("#import-file").set_input_files(file)
    page.wait_for_function("document.readyState !== 'loading'")
    held.pop().continue_()
    expect(page.get_by_role("heading", name="early: 6 campaigns, 120 episodes")).to_be_visible()


@pytest.mark.parametrize("scripts", [True, False])
def test_a_pasted_text_is_refused_by_line_and_previewed(visit, store, scripts):
    page = visit("/launch/suite", java_script_enabled=scripts)
    text = page.get_by_label("Or its text")
    pasted = SUITE.replace("uploaded", f"pasted {scripts}")
    text.fill(pasted.replace("episodes = 20", "episodes = "))
    page.get_by_role("button", name="Preview").click()
    expect(page.get_by_role("heading", name="1 problem: nothing was launched")).to_be_visible()
    expect(page.get_by_role("alert")).to_contain_text("line 5")
    expect(text).to_have_value(re.compile("episodes = \n"))
    text.fill(pasted)
    page.get_by_role("button", name="Preview").click()
    expect(page.get_by_text("Valid: 6 campaigns, 120 episodes.")).to_be_visible()
    assert list_members(store, f"pasted {scripts}") == []
