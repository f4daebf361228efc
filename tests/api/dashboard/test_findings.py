"""What an analysis found, as its page tells it."""

import re
from html import unescape

import msgspec
import numpy as np
import pytest
from accepted import accept_spec
from msgspec.structs import replace
from store_checks.examples import analyse_function
from tests.support.chart_tables import read_headings, read_rows

from eigenfail.values.analysis import (
    AnalysedCampaign,
    AnalysisSettings,
    Behaviour,
    Diversity,
    ModeBehaviour,
    Stability,
    TrainingInterval,
)
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Estimate, Interval
from eigenfail_api.dashboard.analysis_charts import (
    MOST_STEPS,
    make_mode_charts,
    make_scores_chart,
    make_training_charts,
)
from eigenfail_api.dashboard.analysis_page import (
    make_finding_tiles,
)
from eigenfail_services.campaigns.analysis_jobs import leaves_early_out

OF_MODES, SEEN = ("Effective modes", "Largest mode"), "All modes seen after"


@pytest.fixture
def found(store, finished):
    """What a small analysis of two modes found."""
    return store.analyses.get(finished(2)).result


@pytest.fixture
def check_finding(store, campaign, check_page):
    """Compares the page of an analysis with a result with a golden file."""

    def check(name, result):
        analysis = store.analyses.create(campaign, AnalysisSettings()).id
        store.analyses.start(analysis)
        store.analyses.finish(analysis, result)
        check_page(name, f"/analyses/{analysis}", "analysis")

    return check


def interval(place, failures, steps=4, components=2):
    shapes = np.full((components if failures else 0, steps, 2), 0.5, np.float32)
    return TrainingInterval(
        start=place / 10.0,
        end=(place + 1) / 10.0,
        failures=failures,
        mean=np.full((steps, 2), float(place), np.float32),
        components=shapes,
        explained=np.full(len(shapes), 0.25, np.float32),
        likeness=np.full(len(shapes), 0.5, np.float32),
    )


def test_modes_that_come_back_are_told_with_their_interval(found):
    stability = Stability(resamples=20, rows=40, median=0.91, interval=Interval(0.75, 1.0))
    tile = dict(make_finding_tiles(replace(found, stability=stability)))["Adjusted Rand index"]
    assert (tile.value, *tile.notes[:2]) == ("0.910", "[0.750, 1.00]", "20 draws of 40 failures")


def test_why_there_is_no_stability(found):
    tiles = dict(make_finding_tiles(found))
    assert tiles["Adjusted Rand index"].notes == ("not tried: no bootstrap",)
    single = replace(found, modes=found.modes[:1])
    assert dict(make_finding_tiles(single))["Adjusted Rand index"].notes == (
        "not tried: a single group",
    )


def test_outliers_stand_there_only_if_there_are_any(found):
    assert "Near no mode" not in dict(make_finding_tiles(found))
    assert (
        dict(make_finding_tiles(replace(found, outliers=0.125)))["Near no mode"].value == "12.5 %"
    )


DIVERSITY = Diversity(
    failures=40,
    modes=2,
    largest_share=0.75,
    effective_modes=1.75,
    spread=0.9,
    coverage=(0,) * 5 + (2,) * 5,
    verdict="2 modes",
)


def test_how_modes_spread_is_told_only_of_modes_that_are_distinct(found):
    groups = replace(found, diversity=DIVERSITY, silhouette=0.1, noise_silhouette=0.2)
    assert not {*OF_MODES, SEEN} & dict(make_finding_tiles(groups)).keys()
    modes = replace(groups, silhouette=0.5)
    assert {*OF_MODES, SEEN} <= dict(make_finding_tiles(modes)).keys()
    # Without the early failures the first tenths hold no mode by construction.
    latest = dict(make_finding_tiles(modes, is_whole=False))
    assert set(OF_MODES) <= latest.keys()
    assert SEEN not in latest
    assert all("Spread [sigma]" in dict(make_finding_tiles(each)) for each in (groups, modes))


@pytest.mark.parametrize(
    ("method", "failures", "is_left_out"),
    [("ast", "latest", True), ("ast", "all", False), ("monte_carlo", "latest", False)],
)
def test_an_analysis_omits_early_failures_of_methods_that_learn(
    store, method, failures, is_left_out
):
    made = store.campaigns.create(
        accept_spec(CampaignSpec(name="one", method=method, episodes=100))
    )
    settings = AnalysisSettings(failures=failures)
    assert leaves_early_out(settings, [made]) == is_left_out


def test_a_verdict_with_something_against_it_is_not_marked_as_sure(store, campaign, look, found):
    stability = Stability(resamples=20, rows=15, median=1.0, interval=Interval(0.0, 1.0))
    sizes = [(14, 1.0), (14, 0.0), (1, 1.0)]
    for count, low in sizes:
        modes = (replace(found.modes[0], failures=5), replace(found.modes[1], failures=count))
        again = replace(stability, interval=Interval(low, 1.0))
        result = replace(found, silhouette=0.5, noise_silhouette=0.3, modes=modes, stability=again)
        analysis = store.analyses.create(campaign, AnalysisSettings()).id
        store.analyses.start(analysis)
        store.analyses.finish(analysis, result)
        mark = "✓" if (count, low) == sizes[0] else "?"
        counted = "2 distinct modes"
        if count == 1:
            counted = "1 distinct mode, 1 more with too few failures"
        assert f"{mark} {counted} (silhouette 0.50" in look(f"/analyses/{analysis}")


def test_charts_call_groups_what_cards_call_groups(found):
    modes = replace(found, silhouette=0.5, noise_silhouette=0.3)
    groups = replace(modes, noise_silhouette=0.6)
    for result, noun, other in ((modes, "mode", "group"), (groups, "group", "mode")):
        for chart in make_mode_charts(result, 1):
            assert chart.data["noun"] == noun
            words = " ".join((chart.caption, *read_headings(chart.table))).lower()
            assert noun in words
            assert other not in words


def test_a_snapshot_says_so(found, check_finding):
    source = AnalysedCampaign(campaign=1, episodes=7, failures=2, running=True)
    notes = ("A snapshot: more episodes were to come in campaign 1.",)
    check_finding("dashboard/analysis/snapshot", replace(found, sources=(source,), notes=notes))


def test_distinct_modes_are_called_so(found, check_finding):
    distinct = replace(found, silhouette=0.5, noise_silhouette=0.2)
    check_finding("dashboard/analysis/distinct", distinct)


def test_a_mode_has_its_words_once_its_probability_and_its_medoid(found, check_finding):
    told = Estimate(
        by="subset simulation", episodes=900, probability=3e-6, interval=Interval(1e-6, 9e-6)
    )
    refused = Estimate(by="subset simulation", episodes=900, problem="Too few lineages.")
    first, second = found.modes
    modes = (
        replace(first, probability=told, medoid=7, medoid_campaign=9),
        replace(second, probability=refused),
    )
    words = ("Mode 1: It pushes.", "Mode 2: It pulls.")
    check_finding("dashboard/analysis/probabilities", replace(found, modes=modes, words=words))


def test_what_the_ego_did_in_each_mode_stands_first(found, check_finding):
    times_s = np.array([-0.2, -0.1, 0.0], np.float32)
    behaviours = tuple(
        ModeBehaviour(mean * np.ones(3, np.float32), mean * np.ones((1, 3), np.float32), words)
        for mean, words in ((-7.0, "The ego brakes."), (0.0, "The ego does not brake."))
    )
    scores = np.array([[-7.0], [0.0]], np.float32)
    behaviour = Behaviour("collision", times_s, np.ones(1, np.float32), scores, behaviours)
    modes = tuple(
        replace(mode, components=found.components, explained=found.explained)
        for mode in found.modes
    )
    told = replace(
        found,
        features="behaviour",
        behaviour=behaviour,
        modes=modes,
        words=tuple(f"Mode {n}: {one.words} It pushes." for n, one in enumerate(behaviours, 1)),
    )
    check_finding("dashboard/analysis/behaviour", told)


def test_failures_of_several_campaigns_lead_to_their_own(found):
    chart = make_scores_chart(replace(found, campaigns=(4, 5)), 4)
    assert chart.data["episode"] == ["4/0", "5/1"]
    assert make_scores_chart(found, 3).data["episode"] == ["3/0", "3/1"]


def test_training_is_drawn_by_interval_with_its_table(found):
    intervals = (interval(0, 0), *(interval(place, 3) for place in range(1, 10)))
    mean, components = make_training_charts(replace(found, training=intervals))
    assert mean.data["channels"]["lateral"][0] == []
    assert [line.tolist() for line in mean.data["channels"]["lateral"][3]] == [[3.0] * 4]
    assert read_headings(mean.table)[:2] == ("Step", "longitudinal 0 – 10 %")
    assert len(read_rows(mean.table)[0]) == len(read_headings(mean.table)) == 21
    assert read_rows(mean.table)[2][4] == "3.00"
    assert components.data["names"] == ("component 1", "component 2")
    assert read_rows(components.table)[0] == ("0 – 10 %", "0", "–", "–", "–")
    assert read_rows(components.table)[1] == ("10 – 20 %", "3", "1", "25.0 %", "0.500")


def test_long_episodes_are_thinned_for_the_screen(found):
    long = tuple(interval(place, 3, steps=5_000) for place in range(10))
    mean, _ = make_training_charts(replace(found, training=long))
    assert len(mean.data["steps"]) == len(mean.data["channels"]["lateral"][0][0]) == MOST_STEPS
    assert len(read_rows(mean.table)) == 5_000


def test_nothing_is_drawn_of_training_that_was_not_looked_at(found):
    assert make_training_charts(found) == ()


def test_the_form_has_every_setting_and_the_analysis_its_own_in_it(http, campaign, store):
    settings = AnalysisSettings(axes="lateral", clusterer="hdbscan", bootstrap=7, campaigns=(8,))
    again = store.analyses.create(campaign, settings).id
    for address in (f"/campaigns/{campaign}", f"/analyses/{again}"):
        html = http.get(address).text
        names = re.findall(r' name="(\w+)"', html.partition('action="/api/v1/campaigns/1/ana')[2])
        assert set(names) == {field.name for field in msgspec.structs.fields(AnalysisSettings)}
    assert '<option value="hdbscan" selected>' in html
    assert '<option value="lateral" selected>' in html
    assert 'data-numbers pattern="[0-9]+( *, *[0-9]+)*" value="8"' in html


CHANNELS = ("gust", "drift", "bias", "glare", "delay")


@pytest.mark.parametrize("count", [1, 3, 5])
def test_the_pages_of_a_function_have_the_names_of_its_channels(http, store, count):
    channels = CHANNELS[:count]
    campaign, analysis = analyse_function(store, channels, axes=channels[-1])
    found = store.analyses.get(analysis).result
    assert found is not None, store.analyses.get(analysis).problem
    assert found.channels == channels
    pages = {
        address: http.get(address).text
        for address in (f"/analyses/{analysis}", f"/campaigns/{campaign}")
    }
    episode = http.get(f"/campaigns/{campaign}/episodes/0").text
    for html in pages.values():
        assert '<option value="start"' in html
        assert '<option value="collision"' not in html
        options = re.findall(r'<option value="(\w+)"[^>]*>\w+ only</option>', html)
        assert options == [*channels]
        assert re.search('<option value="joint"(?: selected)?>all</option>', html)
        assert f"the {channels[-1]} channel alone" in html
    charts = re.findall(r'"channels": ?\{"(\w+)"', unescape(pages[f"/analyses/{analysis}"]))
    # Eigenfailures, influence, and two of the training: of many channels the most influential one.
    assert charts == [channels[0] if count <= 3 else channels[-1]] * 4
    assert f"Mode 1 {channels[-1]} 90 %" in pages[f"/analyses/{analysis}"]
    assert f"<dd>{', '.join(channels)}</dd>" in pages[f"/campaigns/{campaign}"]
    assert f"{channels[-1].capitalize()} injected" in episode
    assert not re.search("longitudinal|lateral", "".join([*pages.values(), episode]), re.IGNORECASE)


def test_a_channel_that_a_campaign_has_not_is_refused_and_the_nearest_named(
    http, store, campaign, problem
):
    function, _ = analyse_function(store, CHANNELS[:3])
    for number, axes, near in ((campaign, "gust", "lateral"), (function, "gusts", "gust")):
        told = problem(http.post(f"/api/v1/campaigns/{number}/analyses", json={"axes": axes}), 422)
        assert told["field"] == "axes"
        assert near in told["remedy"]
    both = {"campaigns": [campaign]}
    told = problem(http.post(f"/api/v1/campaigns/{function}/analyses", json=both), 422)
    assert told["field"] == "campaigns"
