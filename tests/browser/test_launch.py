"""The launch form in a real browser: filled in, refused, launched once, without a mouse."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from eigenfail.cli.specs import read_spec
from eigenfail.values.campaign import CampaignState

pytestmark = pytest.mark.browser

EXAMPLE = Path(__file__).parents[2] / "examples" / "ast.toml"


def fill(page, name="from the form"):
    page.get_by_label("name").fill(name)
    page.locator("#field-episodes").fill("40")
    page.locator("#field-simulator").select_option("point_mass")


def test_a_campaign_is_launched_and_watched_to_its_end(visit, store, bring):
    page = visit("/launch")
    fill(page)
    page.locator("#field-method").select_option("cem")
    page.locator("#settings-method > summary").click()
    page.locator("#field-settings-batch").fill("8")
    page.get_by_label("distance_m, fixed or sampled").select_option("uniform")
    page.get_by_label("distance_m, smallest").fill("53")
    page.get_by_label("distance_m, largest").fill("60.5")
    page.get_by_role("button", name="Launch").click()
    expect(page.locator("h1")).to_have_text("from the form")
    campaign = int(page.url.rsplit("/", 1)[1])
    spec = store.campaigns.get(campaign).spec
    assert (spec.method, spec.episodes, spec.settings) == ("cem", 40, {"batch": 8})
    assert spec.scenario_parameters == {"distance_m": {"uniform": [53, 60.5]}}
    expect(page.locator("#live .badge").first).to_contain_text("queued")
    store.campaigns.move(campaign, CampaignState.RUNNING)
    bring(campaign, range(40), 1.0)
    expect(page.locator(".tiles").first).to_contain_text("40 of 40")
    store.campaigns.move(campaign, CampaignState.DONE)
    expect(page.locator("#live .badge").first).to_contain_text("done")


def test_a_file_fills_in_the_form_and_is_launched(visit, store):
    page = visit("/launch")
    assert "" not in page.get_by_role("button").all_inner_texts()
    page.locator("#import > summary").click()
    page.locator("#import-file").set_input_files(EXAMPLE)
    expect(page.locator("#field-method")).to_have_value("ast")
    page.get_by_role("button", name="Launch", exact=True).click()
    expect(page.locator("#live .badge").first).to_contain_text("queued")
    spec = store.campaigns.get(int(page.url.rsplit("/", 1)[1])).spec
    assert spec == read_spec(EXAMPLE)


def test_choosing_a_method_swaps_its_settings_and_keeps_the_rest(visit):
    page = visit("/launch")
    fill(page)
    method = page.locator("#field-method")
    method.focus()
    method.select_option("ast")
    expect(page.locator("#field-settings-alpha")).to_have_attribute("placeholder", "300.0")
    expect(page.locator("#field-settings-alpha")).to_have_attribute("max", "10000000.0")
    expect(page.locator("#field-name")).to_have_value("from the form")
    expect(method).to_be_focused()
    method.select_option("monte_carlo")
    expect(page.locator("#field-settings-alpha")).to_have_count(0)
    page.locator("#field-disturbance-shape-kind").select_option("student_t")
    expect(page.locator("#field-disturbance-shape-degrees_of_freedom")).to_be_visible()


def test_what_is_typed_while_the_form_is_drawn_stays(visit):
    page = visit("/launch")
    held = []

    def hold(route):
        held.append(route)

    page.route("**/launch/form", hold)
    page.locator("#field-method").select_option("cem")
    page.locator("#field-name").fill("typed meanwhile")
    while not held:
        page.wait_for_timeout(10)
    held[0].continue_()
    expect(page.locator("#field-settings-batch")).to_have_count(1)
    expect(page.locator("#field-name")).to_have_value("typed meanwhile")


def test_problems_stand_at_their_fields_and_nothing_is_lost(visit, store):
    before = store.campaigns.page(1).items[0].id
    page = visit("/launch")
    fill(page, "")
    page.locator("#settings-planner > summary").click()
    page.get_by_text("tracker", exact=True).click()
    page.locator("#field-planner_settings-tracker-gate").fill("-3")
    page.get_by_text("tracker", exact=True).click()
    page.get_by_role("button", name="Launch").click()
    expect(page.get_by_role("heading", name="2 problems: nothing was launched")).to_be_visible()
    expect(page.locator("#launch-word")).to_be_focused()
    wrong = page.locator("#field-planner_settings-tracker-gate")
    expect(wrong).to_be_visible()
    expect(wrong).to_have_value("-3")
    expect(wrong).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#field-planner_settings-tracker-gate-problem")).to_contain_text("above 0")
    page.get_by_role("link", name="planner_settings.tracker.gate").click()
    expect(wrong).to_be_in_viewport()
    assert store.campaigns.page(1).items[0].id == before


@pytest.mark.parametrize("width", [1280, 375])
def test_launch_check_and_what_was_found_are_side_by_side(visit, width):
    page = visit("/launch", viewport={"width": width, "height": 700})
    page.get_by_role("button", name="Check").click()
    problems = page.get_by_role("link", name="2 problems")
    expect(problems).to_be_in_viewport()
    launch, check = (
        page.get_by_role("button", name=name).bounding_box() for name in ("Launch", "Check")
    )
    assert launch["y"] == check["y"]
    assert 0 < check["x"] - launch["x"] - launch["width"] < 24
    page.mouse.wheel(0, 4000)
    expect(problems).to_be_in_viewport()
    problems.click()
    expect(page.get_by_role("heading", name="nothing was launched")).to_be_in_viewport()


def test_two_clicks_launch_one_campaign(visit, store):
    page = visit("/launch")
    fill(page, "once only")
    page.evaluate(
        "() => { const button = document.querySelector('button[value=launch]');"
        " button.click(); button.click(); }"
    )
    expect(page.locator("h1")).to_have_text("once only")
    names = [each.spec.name for each in store.campaigns.page(50).items]
    assert names.count("once only") == 1


def test_a_check_tells_what_it_would_be_and_how_programs_ask(visit, store):
    before = store.campaigns.page(1).items[0].id
    page = visit("/launch")
    fill(page, "checked <b>only</b>")
    page.get_by_role("button", name="Check").click()
    expect(page.get_by_text("Valid: 40 episodes can be launched.")).to_be_visible()
    page.get_by_text("Full specification").click()
    expect(page.get_by_role("cell", name="planner_settings.tracker.gate")).to_be_visible()
    page.get_by_text("Copy as curl").click()
    page.get_by_role("button", name="Copy").click()
    expect(page.get_by_role("alert").last).to_contain_text(re.compile("Copied|selected"))
    assert store.campaigns.page(1).items[0].id == before


def test_a_clone_marks_what_differs(visit, made, store):
    page = visit(f"/campaigns/{made.ast}")
    page.get_by_role("link", name="Clone").click()
    expect(page.locator("h1")).to_have_text(f"Clone campaign {made.ast}")
    expect(page.get_by_label("distance_m", exact=False).nth(1)).to_have_value("58.0")
    page.locator("#field-seed").fill("9")
    page.get_by_role("button", name="Check").click()
    expect(page.locator("#field-seed-box .before")).to_have_text(f"≠ campaign {made.ast} has 0")
    page.get_by_role("button", name="Launch").click()
    expect(page.locator("h1")).to_have_text("AST on cut-in")
    clone = store.campaigns.get(int(page.url.rsplit("/", 1)[1])).spec
    original = store.campaigns.get(made.ast).spec
    assert (clone.seed, clone.settings) == (9, original.settings)
    assert clone.scenario_parameters == original.scenario_parameters


def test_extending_offers_to_build_on_what_was_learnt(visit, made):
    page = visit(f"/campaigns/{made.ast}")
    page.get_by_role("link", name="Extend").click()
    expect(page.locator("h1")).to_have_text(f"Extend campaign {made.ast}")
    expect(page.locator("#field-episodes")).to_have_value("600")
    page.get_by_role("link", name="Start from the networks that it trained.").click()
    expect(page.locator("#field-settings-warm_start")).to_have_value(str(made.ast))
    expect(page.locator("#field-episodes")).to_have_value("600")


def test_the_form_works_without_a_mouse(visit, store):
    page = visit("/launch")
    page.locator("#field-name").focus()
    page.keyboard.type("typed")
    page.keyboard.press("Tab")
    page.keyboard.type("12")
    page.locator("#field-simulator").select_option("point_mass")
    page.locator("#field-name").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_text("Valid: 12 episodes can be launched.")).to_be_visible()
    page.get_by_role("button", name="Launch").focus()
    page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text("typed")
    assert store.campaigns.page(1).items[0].spec.episodes == 12


def test_the_form_can_be_checked_before_any_script_runs(visit):
    page = visit("/launch", java_script_enabled=False)
    page.locator("#field-method").select_option("cem")
    page.get_by_role("button", name="Show its settings").first.click()
    page.locator("#settings-method > summary").click()
    page.locator("#field-settings-batch").fill("1")
    page.get_by_label("name").fill("plain")
    page.locator("#field-episodes").fill("40")
    page.locator("#field-simulator").select_option("point_mass")
    page.get_by_role("button", name="Check").click()
    expect(page.locator("#field-settings-batch-problem")).to_contain_text("from 2 to")
    expect(page.get_by_role("button", name="Launch", exact=True)).to_be_hidden()
    page.locator("#field-settings-batch").fill("8")
    page.get_by_role("button", name="Check").click()
    expect(page.get_by_text("curl http://").first).to_be_attached()


def test_what_is_too_large_is_told_in_words(visit):
    page = visit("/launch")
    fill(page)
    page.locator("#field-name").fill("x" * 2_000_000)
    page.get_by_role("button", name="Launch").click()
    expect(page.get_by_role("alert")).to_contain_text("exceeds the size limit")
    expect(page.locator("#field-episodes")).to_have_value("40")


def test_a_service_that_is_gone_is_told_in_words_and_may_come_back(visit):
    visit.tolerate("htmx:error: Failed to fetch")
    page = visit("/launch")
    fill(page)
    expect(page.locator("#launch")).to_have_attribute("data-key", "")
    page.route("**/launch/form", lambda route: route.abort())
    page.get_by_role("button", name="Check").click()
    expect(page.get_by_role("alert")).to_contain_text("The service did not respond")
    page.unroute("**/launch/form")
    page.get_by_role("button", name="Check").click()
    expect(page.get_by_text("Valid: 40 episodes can be launched.")).to_be_visible()
