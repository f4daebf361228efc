"""The form of a new suite in a real browser: filled in, previewed, launched once, downloaded."""

import re
import tomllib
from pathlib import Path

import pytest
from playwright.sync_api import expect

from eigenfail.suites import Suite

pytestmark = pytest.mark.browser

EXAMPLE = Path(__file__).parents[2] / "examples" / "suite.toml"


def fill(page, name):
    page.locator("#field-suite").fill(name)
    page.locator("#field-axis-1-field").select_option("seed")
    page.locator("#field-axis-1-start").fill("1")
    page.locator("#field-axis-1-stop").fill("3")
    page.locator("#field-axis-1-number").fill("3")
    page.locator("#field-axis-2-field").select_option("planner")
    page.locator("#field-axis-2-values").fill("idm, rulebook")
    page.locator("#field-episodes").fill("20")
    page.locator("#field-simulator").select_option("point_mass")


def members(store, suite):
    found = [each.spec.name for each in store.campaigns.page(200).items]
    return sorted(name for name in found if name.startswith(f"{suite}: "))


def test_a_suite_is_previewed_and_launched_once(visit, store):
    page = visit("/suites")
    page.get_by_role("link", name="New suite").click()
    fill(page, "from the form")
    preview = page.locator("#preview")
    expect(preview.get_by_role("heading")).to_have_text("6 campaigns, 120 episodes")
    expect(preview.get_by_role("columnheader").nth(2)).to_have_text("planner rulebook")
    page.evaluate(
        "() => { const button = document.querySelector('button[value=launch]');"
        " button.click(); button.click(); }"
    )
    expect(page.get_by_role("heading", name="from the form", exact=True)).to_be_visible()
    expect(page).to_have_url(re.compile(r"/suites/from%20the%20form$"))
    found = members(store, "from the form")
    assert found == [
        f"from the form: seed={seed}, planner={planner}"
        for seed in (1, 2, 3)
        for planner in ("idm", "rulebook")
    ]


def test_the_form_works_without_a_mouse_and_says_what_is_refused(visit, store):
    page = visit("/suites/new")
    fill(page, "typed")
    page.locator("#field-axis-1-stop").fill("-1")
    page.locator("#field-axis-1-stop").press("Enter")
    expect(page.get_by_role("heading", name="1 problem: nothing was launched")).to_be_visible()
    expect(page.locator("#launch-word")).to_be_focused()
    values = page.locator("#field-axis-1-values")
    expect(values).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#preview")).to_contain_text("refused")
    page.locator("#field-axis-1-stop").fill("3")
    page.get_by_role("button", name="Check").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_text("Valid: 6 campaigns with 120 episodes")).to_be_visible()
    assert members(store, "typed") == []


@pytest.mark.parametrize("scripts", [True, False])
def test_a_suite_is_checked_and_downloaded_as_a_file(visit, tmp_path, scripts):
    page = visit("/suites/new", java_script_enabled=scripts)
    fill(page, "as a file")
    page.get_by_role("button", name="Check").click()
    with page.expect_download() as downloading:
        page.get_by_role("link", name="Download suite.toml").click()
    file = tmp_path / downloading.value.suggested_filename
    downloading.value.save_as(file)
    assert tomllib.loads(file.read_text())["grid"]["seed"] == [1, 2, 3]
    assert len(Suite.read(file).members) == 6


def test_a_file_fills_in_the_form(visit):
    page = visit("/suites/new")
    page.locator("#import > summary").click()
    page.locator("#import-file").set_input_files(EXAMPLE)
    table = tomllib.loads(EXAMPLE.read_text())
    expect(page.locator("#field-episodes")).to_have_value(str(table["base"]["episodes"]))
    expect(page.locator("#field-axis-1-field")).not_to_have_value("")


def test_a_campaign_is_the_base(visit, made):
    page = visit("/suites/new")
    page.locator("#import > summary").click()
    page.get_by_label("campaign", exact=True).fill(str(made.ast))
    page.get_by_role("button", name="Use as the base").click()
    expect(page.locator("#field-method")).to_have_value("ast")
    page.locator("#field-seed").fill("9")
    page.get_by_role("button", name="Check").click()
    expect(page.locator("#field-seed-box .before")).to_have_text(f"≠ campaign {made.ast} has 0")
