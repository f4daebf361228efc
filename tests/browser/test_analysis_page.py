"""The analysis page, in a real browser."""

import re
from collections import Counter

import pytest
from playwright.sync_api import expect
from store_checks.examples import analyse_function

pytestmark = pytest.mark.browser

SERIES = "element => echarts.getInstanceByDom(element).getOption().series"


@pytest.fixture
def analysis(visit, made):
    def open_page(**options):
        return visit(f"/analyses/{made.snapshot}", **options)

    return open_page


def read_noun(page):
    """What the cards call their clusters: charts call them the same."""
    return page.locator(".modes h3 a").first.inner_text().split()[0]


def test_each_mode_has_a_band_of_its_failures_noise(analysis):
    page = analysis()
    plot = page.locator("#eigenfailure-chart .plot")
    plot.scroll_into_view_if_needed()
    expect(plot.locator("canvas").first).to_be_visible()
    bands = [one for one in plot.evaluate(SERIES) if one.get("areaStyle", {}).get("opacity")]
    assert len(bands) == 2 * page.locator(".modes article").count()
    page.locator("#eigenfailure-chart summary").click()
    head = page.locator("#eigenfailure-chart thead")
    expect(head).to_contain_text(f"{read_noun(page)} 1 lateral 90 %")


def test_a_chart_is_laid_out_anew_in_a_window_that_becomes_narrow(analysis):
    page = analysis()
    plot = page.locator("#eigenfailure-chart .plot")
    plot.scroll_into_view_if_needed()
    lefts = "element => echarts.getInstanceByDom(element).getOption().grid.map(({ left }) => left)"
    assert len({*plot.evaluate(lefts)}) > 1
    page.set_viewport_size({"width": 375, "height": 900})
    page.wait_for_function(
        """() => {
          const plot = document.querySelector("#eigenfailure-chart .plot");
          const { grid } = echarts.getInstanceByDom(plot).getOption();
          return new Set(grid.map(({ left }) => left)).size === 1;
        }"""
    )


def test_each_mode_has_a_panel_of_what_the_ego_did(analysis):
    page = analysis()
    plot = page.locator("#behaviour-chart .plot")
    plot.scroll_into_view_if_needed()
    expect(plot.locator("canvas").first).to_be_visible()
    modes = page.locator(".modes article").count()
    assert modes > 1
    names = [f"{read_noun(page)} {place + 1} [m/s²]" for place in range(modes)]
    assert plot.evaluate(Y_NAMES) == names
    widths = [one["lineStyle"]["width"] for one in plot.evaluate(SERIES)]
    assert (widths.count(3), widths.count(1) > modes) == (modes, True)
    page.locator("#behaviour-chart summary").click()
    head = page.locator("#behaviour-chart thead")
    expect(head).to_contain_text("Time from the collision [s]")


Y_NAMES = "element => echarts.getInstanceByDom(element).getOption().yAxis.map(one => one.name)"


def test_a_panel_of_the_training_says_which_way_and_how_much(analysis):
    page = analysis()
    for chart, scale in (("mean", r"[\d.]+ sigma"), ("components", r"[\d.]+")):
        names = draw(page, f"training-{chart}").evaluate(Y_NAMES)
        for name, way in zip(names, ("Longitudinal", "Lateral"), strict=True):
            assert re.fullmatch(f"{way}: a row is {scale} high", name)


def test_the_medoid_plays_in_its_card_once_it_is_opened(analysis):
    page = analysis()
    card = page.locator(".modes article").first
    expect(card.locator("canvas")).to_have_count(0)
    card.get_by_text("Watch the medoid").click()
    readout = card.locator("[data-readout]")
    expect(readout).to_contain_text("t = 0.0 s")
    card.locator("[data-step='1']").click()
    expect(readout).to_contain_text("t = 0.1 s")
    card.locator("[data-scrub]").focus()
    page.keyboard.press("Shift+ArrowRight")
    expect(readout).to_contain_text("t = 1.1 s")
    assert "?t=" not in page.url


def test_what_plays_outlives_a_refresh(analysis):
    page = analysis()
    expect(page.locator("#feed")).to_have_text("live")
    card = page.locator(".modes article").first
    card.get_by_text("Watch the medoid").click()
    card.locator("[data-step='1']").click()
    with page.expect_response(lambda response: "/analyses/" in response.url):
        page.evaluate("htmx.trigger(document.body, 'eigenfail:refresh')")
    expect(card.locator("[data-readout]")).to_contain_text("t = 0.1 s")
    card.locator("[data-step='1']").click()
    expect(card.locator("[data-readout]")).to_contain_text("t = 0.2 s")


@pytest.mark.parametrize("channels", [("gust",), ("gust", "drift", "bias")])
def test_every_channel_of_a_function_has_its_line(visit, store, channels):
    campaign, analysis = analyse_function(store, channels)
    page = visit(f"/analyses/{analysis}")
    modes = len(store.analyses.get(analysis).result.modes)
    eigenfailures = draw(page, "eigenfailure")
    names = [f"{read_noun(page)} {n + 1} [sigma]" for n in range(modes)]
    assert eigenfailures.evaluate(Y_NAMES) == names
    lines = [one for one in eigenfailures.evaluate(SERIES) if "stack" not in one]
    assert Counter(one["name"] for one in lines) == dict.fromkeys(channels, modes)
    panels = draw(page, "training-mean").evaluate(Y_NAMES)
    assert [name.partition(":")[0].lower() for name in panels] == [*channels]
    lines = [one for one in draw(page, "influence").evaluate(SERIES) if one["type"] == "line"]
    assert [one["name"] for one in lines] == [*channels]
    assert [one["data"][4][1] for one in lines] == pytest.approx(
        store.analyses.get(analysis).result.influence[4].tolist(), rel=1e-3
    )
    lines = draw(visit(f"/campaigns/{campaign}/episodes/3"), "noise").evaluate(SERIES)
    assert [one["name"] for one in lines] == [*channels]
    assert [one["data"][4][1] for one in lines] == pytest.approx(
        store.episodes.get(campaign, 3).noise.z[4].tolist(), abs=0.01
    )


LOOKS = """element => {
  const names = {};
  for (const {name, type, lineStyle} of echarts.getInstanceByDom(element).getOption().series) {
    if (type === 'line' && lineStyle.type) names[name] = `${lineStyle.color} ${lineStyle.type}`;
  }
  return names;
}"""
BOXES = """element => {
  const chart = echarts.getInstanceByDom(element);
  const boxOf = (one) => one.group.getBoundingRect();
  const legend = chart._componentsViews.find(({type}) => type === 'legend.plain');
  const {y, height} = legend.group.getBoundingRect();
  const {y: top} = chart.getModel().getComponent('grid').coordinateSystem.getRect();
  return [legend.group.y + y + height, top];
}"""


@pytest.mark.parametrize("width", [1440, 375])
def test_of_many_channels_three_are_drawn_and_all_on_demand(visit, store, width):
    channels = tuple(f"channel_{letter}_longitudinal" for letter in "abcdefghijkl")
    campaign, analysis = analyse_function(store, channels)
    page = visit(f"/analyses/{analysis}")
    page.set_viewport_size({"width": width, "height": 900})
    for chart in ("eigenfailure", "influence"):
        check_channels(page, chart, channels)
    check_channels(visit(f"/campaigns/{campaign}/episodes/3"), "noise", channels)


def check_channels(page, chart, channels):
    """Check that the most influential channel is first, and that no line is drawn as another."""
    plot = draw(page, chart)
    first = plot.evaluate(LOOKS)
    assert len(first) == len({*first.values()}) == 3
    assert next(iter(first)) == channels[-1]  # half of the failures have a push in it
    assert_legend_above(plot)
    button = page.locator(f"#{chart}-chart-channels")
    button.click()
    every = draw(page, chart).evaluate(LOOKS)
    assert {*every} == {*channels}
    assert len({*every.values()}) == len(channels)
    assert_legend_above(plot)
    expect(button).to_have_text("Show 3 channels")
    button.click()
    assert draw(page, chart).evaluate(LOOKS) == first
    expect(button).to_have_text(f"Show all {len(channels)} channels")


def assert_legend_above(plot):
    bottom, top = plot.evaluate(BOXES)
    assert bottom <= top


def draw(page, chart):
    """The chart, scrolled to and drawn."""
    plot = page.locator(f"#{chart}-chart .plot")
    plot.scroll_into_view_if_needed()
    expect(plot.locator("canvas").first).to_be_visible()
    return plot


def test_failures_of_a_mode_play_side_by_side(visit, made):
    page = visit(f"/analyses/{made.snapshot}/modes/1")
    wanted = page.locator(".film").count()
    films = page.locator("[data-films] [data-player]")
    expect(films).to_have_count(wanted)
    assert wanted > 1
    page.get_by_role("button", name="Play all").click()
    for scrub in page.locator("[data-films] [data-scrub]").all():
        expect(scrub).not_to_have_value("0")


def test_a_mode_gets_a_name(visit, made):
    page = visit(f"/analyses/{made.snapshot}/modes/2")
    page.get_by_label("Name of the").fill("late & braking")
    page.get_by_role("button", name="Rename").click()
    expect(page.locator("h1")).to_contain_text("late & braking")
    page.get_by_role("link", name="Mode 1").or_(page.get_by_role("link", name="Group 1")).click()
    expect(page.locator("h1")).not_to_contain_text("late & braking")
