"""From stored values to text and numbers."""

import numpy as np
import pytest
from example_values import make_row
from msgspec.structs import replace
from tests.support.chart_tables import read_data, read_headings, read_rows

from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.records import Page, Totals
from eigenfail.values.scene import Scene
from eigenfail.values.summary import Course, CourseBlock
from eigenfail_api.dashboard import charts
from eigenfail_api.dashboard.analysis_charts import pick_evenly
from eigenfail_api.dashboard.campaign_page import group_settings, list_times
from eigenfail_api.dashboard.charts import make_curve_chart, make_robustness_chart
from eigenfail_api.dashboard.cost_charts import make_cost_chart
from eigenfail_api.dashboard.episodes_page import make_headings
from eigenfail_api.dashboard.overlays import Compared, make_distance_chart
from eigenfail_api.dashboard.rendering import TEMPLATES, describe_remaining
from eigenfail_api.dashboard.scene import find_nearest_actors
from eigenfail_services.campaigns.summary import summarise
from eigenfail_services.statistics.intervals import rate


def row(index):
    return make_row(index, robustness_m=5.0, log_probability=-200.0)


def campaign(counts, state=CampaignState.RUNNING, active_s=0.0, method="ast"):
    spec = CampaignSpec(name="n", method=method, episodes=counts.planned)
    return Campaign(id=1, spec=spec, state=state, counts=counts, created_ms=0, active_s=active_s)


def blocks(*counts):
    made = (
        CourseBlock(
            first=100 * place,
            last=100 * place + 99,
            failure_rate=rate(k, 100),
            log_probability_per_step=-2.5 if k else None,
            smallest_robustness_m=0.25,
            median_robustness_m=4.5,
        )
        for place, k in enumerate(counts)
    )
    return Course(campaign=1, method="ast", heading="Learning curve", per=100, blocks=tuple(made))


def test_the_curve_draws_the_course():
    chart = make_curve_chart(blocks(0, 53))
    assert chart.title == "Learning curve"
    data = read_data(chart)
    assert (data["middle"], data["rate"]) == ([49.5, 149.5], [0.0, 53.0])
    assert data["low"][1] < 53.0 < data["high"][1]
    assert read_rows(chart.table)[0] == ("0 – 99", "0", "100", "0 %", "[0, 2.96] %", "–", "4.50")
    assert read_rows(chart.table)[1][-2:] == ("−2.50", "4.50")
    assert len(read_headings(chart.table)) == len(read_rows(chart.table)[0])


def test_the_share_of_a_search_is_not_called_a_failure_rate():
    drawn, counted = make_curve_chart(blocks(0, 53)), blocks(0, 53)
    chosen = tuple(
        replace(block, failure_rate=replace(block.failure_rate, interval=None, sampled=False))
        for block in counted.blocks
    )
    searched = make_curve_chart(replace(counted, blocks=chosen))
    assert (drawn.data["what"], read_headings(drawn.table)[3]) == ("Failure rate", "Failure rate")
    assert (
        searched.data["what"] == read_headings(searched.table)[3] == "Share of episodes that failed"
    )
    assert searched.caption.startswith(
        "Share of episodes that failed by blocks of 100 episodes that the method chose, which is "
        "no failure rate under p(x);"
    )


def test_what_is_left_out_is_said():
    course = blocks(0)
    assert (
        "A sample of 2 of 9,000." in make_robustness_chart([row(0), row(1)], course, 9000).caption
    )
    whole = make_robustness_chart([row(0), row(1)], course, 2)
    assert "sample" not in whole.caption
    assert read_rows(whole.table) == (("0 – 99", "100", "0.250", "4.50"),)


def test_the_robustness_of_a_function_is_no_distance():
    course = blocks(0)
    for unit in ("m", ""):
        curve = make_curve_chart(course, unit)
        chart = make_robustness_chart([row(0)], course, 1, unit)
        texts = (*read_headings(curve.table), *read_headings(chart.table), chart.caption)
        assert any("[m]" in text for text in texts) is bool(unit)
        assert ("footprints" in chart.caption) is bool(unit)
        assert chart.data["unit"] == unit


@pytest.mark.parametrize(
    ("simulators", "unit"),
    [
        (["highway"], " [m]"),
        (["function"], ""),
        (["highway", "function"], " [m for distances]"),
    ],
)
def test_columns_and_axes_name_metres_only_of_a_road(simulators, unit):
    compared = [
        Compared(campaign=run_on(simulator), course=blocks(0), cost=None, rows=[row(0)])
        for simulator in simulators
    ]
    chart = make_distance_chart(compared)
    assert chart.data["x"] == f"Robustness{unit}"
    assert chart.table.notes == (f"Quantiles of robustness{unit}.",)
    assert chart.caption.endswith("; 0 m is a failure." if unit == " [m]" else "; 0 is a failure.")
    units = [
        next(
            head.column.unit
            for head in make_headings(one.campaign.spec, str, None)
            if head.column.name == MEASURE
        )
        for one in compared
    ]
    assert units == ["" if each == "function" else "m" for each in simulators]


MEASURE = "robustness_m"


def run_on(simulator):
    spec = CampaignSpec(name="c", method="monte_carlo", episodes=1, simulator=simulator)
    return Campaign(id=1, spec=spec, state=CampaignState.DONE, counts=Counts(1, 1, 0), created_ms=1)


class Rows:
    """A store's episodes, counted as they are asked for."""

    def __init__(self, count):
        self.count, self.asked = count, 0

    def page(self, campaign, limit, after=None, where=()):
        self.asked += 1
        bounds = {each.operator: each.value for each in where}
        first, last = bounds.get(">=", 0), bounds.get("<", self.count)
        items = tuple(row(index) for index in range(first, min(last, first + limit)))
        return Page(items, items[-1].index if items and first + limit < last else None)


class Kept:
    def __init__(self, count):
        self.episodes = Rows(count)


@pytest.mark.parametrize(("count", "drawn"), [(0, 0), (1, 1), (5_000, 5_000), (1_000_000, 5_000)])
def test_a_sample_is_bounded_and_reaches_over_the_whole_campaign(count, drawn):
    store = Kept(count)
    found = charts.spread(store, campaign(Counts(count or 1, completed=count)), (), 5_000)
    assert (len(found.rows), found.is_all) == (drawn, count <= 5_000)
    assert store.episodes.asked <= 50
    indices = [each.index for each in found.rows]
    assert indices == sorted(set(indices))
    assert not count or max(indices) >= 0.97 * count - 1


def test_bounds_of_nothing_are_not_drawn_on_a_log_axis():
    unpaid = campaign(Counts(10, completed=10))
    paid = campaign(Counts(10, completed=10, failures=5), active_s=3000.0)
    nothing = summarise(unpaid, totals(0))
    assert make_cost_chart([nothing]) is None
    (point,) = make_cost_chart([nothing, summarise(paid, totals(5))]).data["campaigns"]
    assert point["value"] == pytest.approx(0.2)
    assert (point["low"], point["high"], point["at_least"]) == (None, None, None)
    drawn = replace(paid, spec=replace(paid.spec, method="monte_carlo"))
    (point,) = make_cost_chart([summarise(drawn, totals(5))]).data["campaigns"]
    assert point["value"] == pytest.approx(0.2)
    assert point["low"] < 0.2 < point["high"]


def test_what_a_replay_cost_is_no_price_of_finding_failures():
    counts = Counts(10, completed=10, failures=5)
    replay = campaign(counts, method="replay", active_s=3000.0)
    found = campaign(counts, active_s=3000.0)
    summaries = [summarise(each, totals(5)) for each in (replay, found)]
    (point,) = make_cost_chart(summaries).data["campaigns"]
    assert point["method"] == found.spec.method


def totals(failures):
    return Totals(failures, -200.0 * failures, 100 * failures, 25.0 * failures)


def test_the_nearest_vehicle_may_change():
    places = np.zeros((2, 3, 4), np.float32)
    places[0, 1:, 0] = [10.0, -4.0]
    places[1, 1:, 0] = [3.0, -4.0]
    sizes, pair = np.ones((3, 2), np.float32), np.zeros((1, 2), np.float32)
    assert find_nearest_actors(Scene(0.1, places, sizes, pair, pair)) == [2, 1]


@pytest.mark.parametrize(("count", "most"), [(0, 5), (3, 5), (12, 5)])
def test_evenly_spread_positions_are_distinct(count, most):
    chosen = pick_evenly(count, most)
    assert len(chosen) == len(set(chosen)) == min(count, most)
    assert all(0 <= place < count for place in chosen)


def test_a_campaign_that_stopped_early_is_full_and_says_what_was_left_unrun():
    counts = Counts(400, completed=36, failures=10, errored=1, cancelled=363)
    stopped = campaign(counts, CampaignState.DONE, active_s=10.0)
    remaining = describe_remaining(stopped, summarise(stopped, Totals(10, -1.0, 1, 1.0)))
    assert remaining == "363 not run"
    bar = TEMPLATES.get_template("macros.html").module.progress(counts, remaining)
    assert '<progress max="37" value="37"' in bar
    assert "37 / 400, 363 not run" in bar


def test_how_many_episodes_were_trained_with_stands_where_it_is_known():
    silent = campaign(Counts(5))
    assert (
        dict(list_times(replace(silent, trained_episodes=1170)))["Trained with"] == "1,170 episodes"
    )
    assert "Trained with" not in dict(list_times(silent))


def test_stop_rules_stand_among_the_settings():
    asked = campaign(Counts(5))
    asked = replace(asked, spec=replace(asked.spec, stop=StopRules(failures=10)))
    assert ("stops at failures", "10") in dict(group_settings(asked))["Campaign"]
