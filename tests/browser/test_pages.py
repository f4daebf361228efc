"""Pages in a real browser: themes, charts, names, and their use without a mouse or a script."""

import pytest
from playwright.sync_api import expect

from eigenfail_api.dashboard import campaign_page

pytestmark = pytest.mark.browser

GROUND = "getComputedStyle(document.body).backgroundColor"


@pytest.mark.parametrize(("height", "drawn"), [(6_000, 4), (200, 0)])
def test_charts_in_view_are_drawn_before_the_observer_reports(visit, address, made, height, drawn):
    page = visit("/glossary", viewport={"width": 1280, "height": height})
    page.add_init_script("window.IntersectionObserver = class { observe() {} };")
    page.goto(f"{address}/campaigns/{made.ast}")
    expect(page.locator("html.js .plot")).to_have_count(4)
    expect(page.locator(".plot:has(canvas)")).to_have_count(drawn)


DRAWN = "element => echarts.getInstanceByDom(element).getOption().xAxis[0].nameTextStyle.color"


def test_the_theme_that_is_chosen_holds_for_every_page_and_chart(visit, address, made):
    page = visit(f"/campaigns/{made.ast}", color_scheme="light")
    plot = page.locator("#curve-chart .plot")
    expect(plot.locator("canvas").first).to_be_visible()
    ground, axis = page.evaluate(GROUND), plot.evaluate(DRAWN)
    page.get_by_role("button", name="Switch between the light and the dark theme").click()
    dark = page.evaluate(GROUND)
    assert dark != ground
    assert plot.evaluate(DRAWN) != axis
    page.goto(f"{address}/glossary")
    assert page.evaluate(GROUND) == dark
    page.get_by_role("button", name="Switch between the light and the dark theme").click()
    assert page.evaluate(GROUND) == ground


def test_pages_can_be_read_before_any_script_runs(visit, made, monkeypatch):
    # What is known already comes with the page.
    monkeypatch.setattr(campaign_page.costs, "is_prefetched", lambda begun: False)
    page = visit("/", java_script_enabled=False)
    expect(page.locator(f"#campaign-{made.ast}")).to_contain_text("160 of 300")
    page.locator("details.data summary").first.click()
    expect(page.locator("details.data tbody tr").first).to_be_visible()
    page.goto(page.url + f"campaigns/{made.queued}")
    expect(page.get_by_role("button", name="Cancel")).to_be_hidden()
    expect(page.get_by_text(f"eigenfail campaign pause {made.queued}")).to_be_visible()
    page.get_by_role("link", name="Safety and cost on a separate page").click()
    expect(page.get_by_text("after the first episode")).to_be_visible()


LOOKS = """element => echarts.getInstanceByDom(element).getOption().series
  .filter(one => one.type === 'scatter')
  .map(one => [one.name, one.itemStyle.color + ' ' + one.symbol])"""
LOOKS_OF = """async names => {
  const {looksOf} = await import('/static/js/charts_cost.js');
  return names.map(looksOf).map(({itemStyle, symbol}) => itemStyle.color + ' ' + symbol);
}"""


def test_a_method_looks_the_same_in_every_chart(visit):
    page = visit("/")
    plots = page.locator("[data-chart=cost] .plot")
    expect(plots).to_have_count(2)
    for plot in plots.all():
        plot.scroll_into_view_if_needed()
        expect(plot.locator("canvas").first).to_be_visible()
        names, looks = zip(*plot.evaluate(LOOKS), strict=True)
        assert len(names) > 1
        assert list(looks) == page.evaluate(LOOKS_OF, names)


def test_methods_of_plugins_take_looks_that_no_other_has(visit):
    known = ["monte_carlo", "ast", "difs", "cem", "subset", "evaluate", "minimal", "ensemble"]
    looks = visit("/").evaluate(LOOKS_OF, [*known, "replay", "mine", "cma"])
    assert len(set(looks)) == len(looks)


def test_the_keyboard_reaches_everything(visit, made):
    page = visit("/")
    expect(page.locator("html.js")).to_be_attached()
    page.keyboard.press("Tab")
    expect(page.locator(".skip")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#main")).to_be_focused()
    link = page.get_by_role("link", name="AST on cut-in", exact=True)
    for _ in range(40):
        page.keyboard.press("Tab")
        if link.evaluate("element => element === document.activeElement"):
            break
    expect(link).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text("AST on cut-in")


# The point that is farthest from all others: no other hides it.
LONELY_POINT = """element => {
  const chart = echarts.getInstanceByDom(element);
  const points = chart.getOption().series.flatMap(({data}, seriesIndex) => data.map(one => ({
    link: one.link ?? one[2],
    at: chart.convertToPixel({seriesIndex}, (one.value ?? one).slice(0, 2)),
  })));
  const apart = ({at}, other) => Math.hypot(at[0] - other.at[0], at[1] - other.at[1]);
  const others = point => points.filter(one => one !== point);
  const room = point => Math.min(...others(point).map(one => apart(point, one)));
  const linked = points.filter(({link}) => link !== undefined);
  const {at, link} = linked.sort((a, b) => room(b) - room(a))[0];
  return [...at, link];
}"""


@pytest.mark.parametrize(
    ("path", "chart"),
    [("/campaigns/{replay}", "likelihood"), ("/analyses/{snapshot}", "scores")],
)
def test_a_chart_leads_to_its_episode(visit, made, path, chart):
    page = visit(path.format(**vars(made)))
    plot = page.locator(f"#{chart}-chart .plot")
    plot.scroll_into_view_if_needed()
    expect(plot.locator("canvas").first).to_be_visible()
    x, y, episode = plot.evaluate(LONELY_POINT)
    plot.click(position={"x": x, "y": y})
    expect(page.locator("h1")).to_have_text(f"Episode {str(episode).rsplit('/', 1)[-1]}")
    # A campaign's own failures carry their index; those of several say whose they are.
    assert page.url.endswith(f"/{episode}")


def test_measures_are_made_once_for_a_page_of_their_own(visit, made):
    page, asked = visit(f"/campaigns/{made.ast}/measures"), []
    page.on("request", lambda request: asked.append(request.url.rsplit("/", 1)[-1]))
    page.reload(wait_until="networkidle")
    assert asked.count("measures") == 1
