"""The player of an episode: time, keys, address, strips, the planner's account, replays."""

import re
from itertools import product

import numpy as np
import pytest
from accepted import accept_spec
from msgspec.structs import replace
from playwright.sync_api import expect

from eigenfail import plugins
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, EpisodeTask, Outcome, TrajectorySource
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail.values.scene import Scene

pytestmark = pytest.mark.browser

SIGN = np.where((np.arange(100) // 20) % 2 == 0, 2.0, -2.0)
WAVE = np.stack([SIGN, 0.0 * SIGN], axis=1).astype(np.float32)


@pytest.fixture(scope="module")
def real(store):
    """A campaign whose episode 3 is a collision of the rulebook, and 4 is safe without a scene."""
    spec = CampaignSpec(name="Wave on cut-in", method="monte_carlo", episodes=9)
    campaign = store.campaigns.create(accept_spec(spec)).id
    store.campaigns.move(campaign, "running")
    tasks = [
        EpisodeTask(3, 5, TrajectorySource(WAVE)),
        EpisodeTask(4, 5, TrajectorySource(0.3 * WAVE)),
    ]
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    store.episodes.commit(campaign, [Delivery(result, "w") for result in engine.run(tasks)])
    return campaign


@pytest.fixture
def crash(visit, real):
    """Opens the collision at a time; a page whose player has been drawn."""

    def open_page(query="", **options):
        page = visit(f"/campaigns/{real}/episodes/3{query}", **options)
        expect(page.locator("[data-readout]")).to_contain_text("t = ")
        return page

    return open_page


def at(page, seconds):
    expect(page.locator("[data-readout]")).to_contain_text(f"t = {seconds} s")


def test_it_plays_steps_and_scrubs_by_buttons(crash):
    page = crash()
    scrub = page.locator("[data-scrub]")
    at(page, "0.0")
    page.get_by_role("button", name="One step forward").press("Enter")
    at(page, "0.1")
    page.get_by_role("button", name="One step back").click()
    at(page, "0.0")
    page.locator("[data-speed]").select_option("4")
    scrub.fill(str(int(scrub.get_attribute("max")) - 20))
    page.locator("[data-play]").press("Enter")
    # It stops by itself at the end.
    expect(scrub).to_have_value(scrub.get_attribute("max"))
    expect(page.locator("[data-play]")).to_have_text("Play")


def test_the_account_leaves_the_title_of_the_page_alone(crash):
    page = crash()
    expect(page.get_by_role("heading", name="What happened")).to_be_visible()
    page.locator("details.copy summary").click()
    expect(page.locator("#copies-here pre")).to_have_count(1)
    expect(page).to_have_title("Episode 3 of Wave on cut-in · eigenfail")


def test_it_obeys_keys(crash):
    page = crash()
    for keys, seconds in (
        (["ArrowRight"], "0.1"),
        (["Shift+ArrowRight"], "1.1"),
        (["ArrowLeft", "ArrowLeft"], "0.9"),
        (["Shift+ArrowLeft"], "0.0"),
    ):
        for key in keys:
            page.keyboard.press(key)
        at(page, seconds)
    page.locator("[data-scrub]").focus()
    page.keyboard.press("ArrowRight")
    at(page, "0.1")
    page.keyboard.press("End")
    at(page, "8.8")
    page.keyboard.press("Home")
    at(page, "0.0")
    page.keyboard.press("Space")
    expect(page.locator("[data-play]")).to_have_text("Pause")
    page.keyboard.press("Space")
    expect(page.locator("[data-play]")).to_have_text("Play")


def test_a_field_keeps_its_keys(crash):
    page = crash()
    scale = page.get_by_label("Scale of the noise")
    scale.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowUp")
    at(page, "0.0")
    expect(scale).to_have_value("0.55")


def test_the_address_names_a_moment_and_follows(crash):
    page = crash("?t=4.2")
    at(page, "4.2")
    page.keyboard.press("ArrowRight")
    expect(page).to_have_url(re.compile(r"\?t=4\.3$"))
    page.reload()
    at(page, "4.3")


def test_a_moment_outside_the_episode_is_its_end(crash):
    at(crash("?t=1e5"), "8.8")


def test_the_link_to_a_moment_is_told_where_it_cannot_be_copied(crash):
    page = crash("?t=2.5")
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(new Error()); }")
    page.get_by_role("button", name="Copy link to this moment").click()
    expect(page.get_by_role("alert")).to_contain_text("/episodes/3?t=2.5")


def test_one_cursor_for_all_strips_which_set_the_time(crash):
    page = crash("?t=4.4")
    cursors = page.locator("[data-cursor]")
    expect(cursors).to_have_count(5)
    lefts = [cursor.bounding_box()["x"] for cursor in cursors.all()]
    assert lefts == pytest.approx([lefts[0]] * 5, abs=1.0)
    strip = page.locator("#clearance-chart [data-strip]")
    strip.scroll_into_view_if_needed()
    box = strip.bounding_box()
    strip.click(position={"x": 62 + 0.25 * (box["width"] - 80), "y": 60})
    at(page, "2.2")
    moved = page.locator("#noise-chart-cursor").bounding_box()["x"]
    assert moved == pytest.approx(box["x"] + 62 + 0.25 * (box["width"] - 80), abs=6.0)


GRID = """plot => {
  const chart = echarts.getInstanceByDom(plot);
  const {x, width} = chart.getModel().getComponent('grid').coordinateSystem.getRect();
  return [x, chart.getWidth() - x - width];
}"""


def test_all_strips_have_the_margins_that_the_cursor_has(crash):
    page = crash("?t=4.4")
    names = ("noise", "clearance", "ttc", "speed", "acceleration")
    for width, name in product((1440, 375), names):
        page.set_viewport_size({"width": width, "height": 900})
        plot = page.locator(f"#{name}-chart .plot")
        plot.scroll_into_view_if_needed()
        expect(plot.locator("canvas").first).to_be_visible()
        assert plot.evaluate(GRID) == pytest.approx([62.0, 18.0], abs=1.0), name


def test_the_planner_accounts_for_the_moment(crash):
    page = crash("?t=4.2")
    field = page.locator("[data-field]")
    expect(page.locator("[data-field=mode]")).to_have_text("highway")
    expect(field.nth(1)).not_to_have_text("–")
    expect(page.get_by_text("bit for bit")).to_be_visible()
    expect(page.locator(".story li").last).to_contain_text("collision")
    page.get_by_role("button", name=re.compile("emergency brake")).click()
    at(page, "8.7")
    expect(page.locator("[data-field=override]")).to_have_text("emergency brake")
    expect(page.locator("[data-field=override]")).to_have_class("is-alarm")
    page.get_by_role("button", name=re.compile("collision")).click()
    at(page, "8.8")


TIME_AXIS = """async end => {
  const strips = await import('/static/js/charts_noise.js');
  const channels = {longitudinal: [], lateral: []};
  const ticks = [0, 3, 1];
  const values = {axis: 'Time [s]', end, time: [], values: [], unit: '', ticks, channels};
  return ['noise', 'course'].map(name => {
    const {xAxis} = strips[name](values, 600);
    return [xAxis.max, xAxis.axisLabel.formatter(end)];
  });
}"""


def test_the_last_tick_of_a_strip_tells_no_error_of_rounding(crash):
    assert crash().evaluate(TIME_AXIS, 179 * 0.1) == [[17.9, "17.9"]] * 2


FIXED = "async value => (await import('/static/js/parts.js')).fixed(value)"


def test_a_figure_of_the_moment_has_a_true_minus(crash):
    page = crash()
    for value, told in ((-40.52, "−40.5"), (-0.04, "0.0"), (1.44, "1.4")):
        assert page.evaluate(FIXED, value) == told


PIXELS = """canvas => {
  const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const isGreen = (at) => Math.hypot(data[at], data[at + 1] - 132, data[at + 2] - 95) < 12;
  let found = 0;
  for (let at = 0; at < data.length; at += 4) found += isGreen(at);
  return found;
}"""


def test_the_path_that_it_means_to_drive_is_drawn(crash):
    page = crash("?t=4.2")
    expect(page.locator("[data-field=mode]")).to_have_text("highway")
    assert page.locator("canvas.road").evaluate(PIXELS) > 20


@pytest.fixture(scope="module")
def curved(store):
    """A campaign on a bridge whose episode 0 is a drive on a curve, and 1 the same without road."""
    parameters = {"steps": 40, "dt_s": 0.1}
    spec = CampaignSpec(
        name="Curve",
        method="monte_carlo",
        episodes=2,
        simulator="bridge",
        scenario_parameters=parameters,
    )
    campaign = store.campaigns.create(accept_spec(spec)).id
    store.campaigns.move(campaign, "running")
    x_m = np.stack([np.arange(41.0) * 3.0, 20.0 + np.arange(41.0) * 3.0], axis=1)
    y_m = x_m**2 / 300.0
    rest = np.broadcast_to([[0.5, 30.0]], (41, 2, 2))
    vehicles = np.concatenate([np.stack([x_m, y_m], axis=-1), rest], axis=-1).astype(np.float32)
    nothing = np.zeros((40, 2), np.float32)
    sizes = np.array([[12.0, 2.5], [1.8, 0.6]], np.float32)
    scene = Scene(0.1, vehicles, sizes, vehicles[:-1, 1, :2], nothing)
    points = np.arange(-50.0, 250.0, 5.0, np.float32)
    borders = (np.stack([points, points**2 / 300.0 + side], axis=1) for side in (-2.0, 2.0))
    shown = replace(scene, road=tuple(borders), kinds=("unknown", "bicycle"))
    noise = NoiseTrajectory(nothing, np.ones((40, 2), np.float32))
    results = [
        EpisodeResult(
            index, 1, Outcome.SAFE, 40, noise, "prior", Measures(6.0), scene=each, wall_s=1.0
        )
        for index, each in enumerate((shown, scene))
    ]
    store.episodes.commit(campaign, [Delivery(result, "w") for result in results])
    return campaign


LINES = """canvas => {
  const pen = canvas.getContext('2d');
  const {data} = pen.getImageData(0, 0, canvas.width, Math.floor(canvas.height / 4));
  let found = 0;
  for (let at = 3; at < data.length; at += 4) found += data[at] > 0;
  return found;
}"""
"""How many points are drawn in the upper quarter, where no vehicle is."""


def test_a_road_that_bends_is_drawn_and_the_view_follows_it(visit, curved):
    drawn = []
    for episode, name in ((0, "bicycle"), (1, "actor")):
        page = visit(f"/campaigns/{curved}/episodes/{episode}?t=3.0")
        expect(page.locator("[data-readout]")).to_contain_text(f"{name} 30.0 m/s")
        drawn.append(page.locator("canvas.road").evaluate(LINES))
    # Without a road the view stays at y = 0, which the vehicles have left.
    assert drawn[0] > 20
    assert drawn[1] == 0


def test_an_account_of_another_course_is_told_as_such(visit, made):
    """The made-up episode is none that the planner would drive."""
    page = visit(f"/campaigns/{made.ast}/episodes/{made.failures[3]}")
    expect(page.get_by_text("DIFFERENT")).to_be_visible()
    expect(page.locator("[data-account]")).to_have_count(0)
    assert page.locator("canvas.road").evaluate(PIXELS) == 0


def test_without_a_scene_it_says_why_and_plays_that_of_the_replay(visit, real):
    page = visit(f"/campaigns/{real}/episodes/4?t=1.0")
    expect(page.get_by_text("was not kept")).to_be_visible()
    at(page, "1.0")
    expect(page.locator("[data-field=mode]")).to_have_text("highway")
    expect(page.get_by_text("bit for bit")).to_be_visible()


def test_a_replay_is_awaited_and_opens_by_itself(visit, store, real, bring):
    page = visit(f"/campaigns/{real}/episodes/3")
    page.get_by_role("button", name="Replay now").click()
    expect(page.locator("h1")).to_have_text("Replay")
    campaign = int(page.url.rsplit("/", 1)[-1])
    assert store.campaigns.get(campaign).spec.settings["episodes"] == [3]
    expect(page.locator("#feed")).to_have_text("live")
    store.campaigns.move(campaign, "running")
    bring(campaign, [0], 1.0)
    expect(page.locator("h1")).to_have_text("Episode 0")
    assert page.url.endswith(f"/campaigns/{campaign}/episodes/0")


def test_a_scaled_replay_is_a_campaign_of_its_own(visit, store, real):
    page = visit(f"/campaigns/{real}/episodes/3")
    page.get_by_label("Scale of the noise").fill("0.75")
    page.get_by_role("button", name="Replay scaled").click()
    expect(page.locator("h1")).to_have_text("Replay")
    campaign = int(page.url.rsplit("/", 1)[-1])
    assert store.campaigns.get(campaign).spec.settings["scale"] == 0.75


def test_an_episode_is_downloaded(visit, real):
    page = visit(f"/campaigns/{real}/episodes/3")
    for name, file in (("JSON", "json"), ("Steps (CSV)", "csv")):
        with page.expect_download() as download:
            page.get_by_role("link", name=name, exact=True).click()
        assert download.value.suggested_filename == f"episode-{real}-3.{file}"
        assert download.value.path().read_text()


def test_in_the_last_moment_nothing_is_seen_any_more(crash):
    page = crash("?t=8.7")
    expect(page.locator("[data-readout]")).to_contain_text("m off")
    page.keyboard.press("ArrowRight")
    at(page, "8.8")
    expect(page.locator("[data-readout]")).to_contain_text("collision")
    expect(page.locator("[data-readout]")).not_to_contain_text("m off")
