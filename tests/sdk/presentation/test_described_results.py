"""Results as a terminal, a page and a report word them, from values that are known."""

import numpy as np
import pytest
from example_values import NOTHING, make_findings
from msgspec.structs import replace

from eigenfail.presentation import analyses
from eigenfail.presentation.campaigns import (
    describe_comparison,
    tabulate_course,
    tabulate_sides,
)
from eigenfail.presentation.episodes import (
    list_episode_facts,
    list_measures,
    tabulate_episodes,
    tabulate_thresholds,
)
from eigenfail.testing.examples import spec
from eigenfail.values.analysis import (
    AnalysedCampaign,
    Behaviour,
    Diversity,
    FailureMode,
    InfluenceShare,
    Moment,
    Stability,
)
from eigenfail.values.campaign import Counts
from eigenfail.values.comparison import Comparison, Side
from eigenfail.values.disturbance import AXES, ChannelLikelihood, NoiseTrajectory
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Cost, Estimate, Interval, Rate
from eigenfail.values.measures import Measures
from eigenfail.values.proof import ExplainedStep, Proof, Reproduction
from eigenfail.values.records import Assessment, EpisodeDetail
from eigenfail.values.summary import CampaignCost, Course, Errored, TimeSplit
from eigenfail.worlds import find_robustness_unit
from eigenfail_api.dashboard.scene import find_moments

SAMPLED = Rate(0.25, 25, 100, Interval(0.175, 0.343))


def texts(table):
    return [tuple(cell.line for cell in row) for row in table.cells]


def moment(axis, step, before_collision_s):
    return Moment(axis=axis, step=step, before_collision_s=before_collision_s, influence=0.25)


def share_of(seconds, time, longitudinal, lateral, both):
    return InfluenceShare(
        seconds=seconds, time=time, longitudinal=longitudinal, lateral=lateral, both=both
    )


def analysis(**fields):
    mode = FailureMode(
        12,
        3,
        NOTHING,
        NOTHING,
        probability=Estimate(by="counting", episodes=9, problem="It drifted."),
    )
    bound = FailureMode(
        4,
        5,
        NOTHING,
        NOTHING,
        probability=Estimate(
            by="weights", episodes=9, probability=1e-4, bound="lower", note="One region."
        ),
    )
    given = {
        "episodes": (1, 2, 3),
        "modes": (mode, bound),
        "silhouette": 0.5,
        "noise_silhouette": 0.2,
    }
    return make_findings(**given | fields)


def test_remarks_on_an_analysis_tell_what_limits_it():
    found = analysis(
        diversity=Diversity(
            failures=16,
            modes=2,
            largest_share=0.75,
            effective_modes=1.8,
            spread=0.42,
            coverage=(1, 2),
            verdict="2 modes.",
            warning="One mode holds most.",
        ),
        stability=Stability(resamples=50, rows=16, median=0.871, interval=Interval(0.5511, 0.9999)),
        outliers=0.125,
        moments=(moment("lateral", 40, 2.5), moment("lateral", 7, None)),
        before_collision=(share_of(1.0, 0.12, 0.064, 0.0, 0.05),),
        notes=("An analyser's note.",),
        digest="abc",
    )
    assert list(analyses.describe_findings(found)) == [
        "Failures are grouped by the principal components of their noise.",
        (
            "The noise of the 16 failures has a standard deviation of 0.420 sigma about its mean; "
            "that of p(x) has 1."
        ),
        "Modes among the analysed failures after each tenth of the campaign: 1, 2.",
        (
            "Warning: Mode collapse: 75 % of the failures are of one mode. Try the method "
            "ensemble, the reward dissimilarity, or a distribution of scenarios."
        ),
        "An analyser's note.",
        (
            "Drawn again 50 times, the modes have an adjusted Rand index of 0.871 [0.551, 1.00]; "
            "1 is the same modes, 0 is chance."
        ),
        "12.5 % of the failures were near no mode.",
        "Lateral noise differs most between failures 2.50 s before the collision, at step 7.",
        (
            "The last 1 s before the collision, 12.0 % of the time, hold 5.00 % of the influence "
            "(longitudinal 6.40 %)."
        ),
        "Mode 1 has no probability: It drifted.",
        'Probabilities with "at least" are lower bounds: One region.',
        "Digest of every number (SHA-256): abc",
    ]


def test_an_analysis_of_an_earlier_release_has_no_remarks_on_what_it_did_not_measure():
    assert list(analyses.describe_diversity(analysis())) == []
    grouped, *rest = analyses.describe_findings(analysis())
    assert grouped == "Failures are grouped by the principal components of their noise."
    assert rest[0] == "Mode 1 has no probability: It drifted."


def test_what_failures_are_grouped_by_is_told():
    assert analyses.describe_grouping(analysis(features="energy")) == (
        "the energy of their noise in windows of 0.5 s"
    )
    for origin, words in (("collision", "before the collision"), ("start", "from the start on")):
        behaviour = Behaviour(origin, NOTHING, NOTHING, NOTHING, ())
        found = analyses.describe_grouping(analysis(features="behaviour", behaviour=behaviour))
        assert found == f"the acceleration of the ego {words}"


def test_no_influence_at_all_is_said_and_its_shares_are_dashes():
    nothing = share_of(2.0, 0.2, None, None, None)
    words = "Failures differ in no step of the last 2 s or before."
    assert analyses.describe_influence(nothing, AXES) == words
    table = analyses.tabulate_last_influence(analysis(before_collision=(nothing,)))
    assert texts(table) == [("Last 2 s", "20.0 %", "–", "–", "–")]


@pytest.mark.parametrize("count", [1, 3, 5])
def test_tables_and_findings_have_the_names_of_the_channels(count):
    channels = ("gust", "drift", "bias", "glare", "delay")[:count]
    z = np.zeros((9, count), np.float32)
    z[4, -1] = -2.0
    share = InfluenceShare(
        seconds=1.0,
        time=0.1,
        longitudinal=None,
        lateral=None,
        both=0.5,
        channels=(None,) * (count - 1) + (0.25,),
    )
    mode = FailureMode(3, 1, NOTHING, z)
    found = replace(
        analysis(moments=(moment(channels[-1], 4, None),), before_collision=(share,)),
        channels=channels,
        modes=(mode,),
    )
    labels = [column.heading for column in analyses.tabulate_modes(1, found).columns]
    (row,) = texts(analyses.tabulate_modes(1, found))
    if count > 3:  # columns of each channel would not fit beside each other
        assert labels[3:-1] == ["Strongest channel", "Peak"]
        assert row[3:-1] == (channels[-1], "−2.00 at step 4")
    else:
        assert labels[3:-1] == [
            *(f"Mean {name} [sigma]" for name in channels),
            *(f"Peak {name}" for name in channels),
        ]
        assert row[3 + count : -1] == ("0 at step 0",) * (count - 1) + ("−2.00 at step 4",)
    name = channels[-1].capitalize()
    assert texts(analyses.tabulate_moments(found)) == [(name, "at step 4", "0.250")]
    assert analyses.tabulate_moments(found).columns[0].title == "Channel"
    titles = [column.title for column in analyses.tabulate_last_influence(found).columns]
    assert titles == ["Time", "Of the time", *(each.capitalize() for each in channels), "All"]
    dashes = ("–",) * (count - 1)
    assert texts(analyses.tabulate_last_influence(found)) == [
        ("Last 1 s", "10.0 %", *dashes, "25.0 %", "50.0 %")
    ]
    told = list(analyses.describe_findings(found))
    assert f"{name} noise differs most between failures at step 4." in told
    assert any(sentence.endswith(f"({channels[-1]} 25.0 %).") for sentence in told)


def test_moments_and_sources_are_tables():
    last = moment("longitudinal", 40, 2.5)
    found = analysis(
        moments=(last,),
        sources=(
            AnalysedCampaign(campaign=3, episodes=1200, failures=40),
            AnalysedCampaign(campaign=4, episodes=90, failures=1, running=True),
        ),
    )
    assert analyses.format_moment(last) == "2.50 s before the collision"
    assert texts(analyses.tabulate_moments(found)) == [
        ("Longitudinal", "2.50 s before the collision", "0.250")
    ]
    assert texts(analyses.tabulate_sources(found)) == [
        ("3", "40", "1,200", "ended"),
        ("4", "1", "90", "running: a snapshot"),
    ]


def side(*campaigns, rate=SAMPLED):
    cost = Cost(1.2, 1.0, 0.048, Interval(0.0351, 0.0681), 0.0351)
    return Side(
        campaigns=campaigns,
        completed=100,
        failures=25,
        failure_rate=rate,
        rates=(0.25,),
        log_probability_per_step=-2.5,
        mean_severity=80.0,
        cost=cost,
    )


def comparison(**fields):
    given = {"sentences": ("A fails less.",), "warnings": ("One seed.",), **fields}
    return Comparison(
        a=side(1),
        b=side(2, 3),
        difference=None,
        pairs=None,
        unpaired_because="other seeds",
        effect=None,
        distinctions=(),
        **given,
    )


def bill(spent, lost_s, per_mode=0.4):
    time = TimeSplit(
        active_s=100.0,
        worker_s=90.0,
        simulation_s=60.0,
        startup_s=0.0,
        learning_s=25.0,
        waiting_s=15.0,
        lost_s=lost_s,
        lost_worker_s=0.0,
    )
    cost = Cost(spent, 1.0, None, None, None)
    return CampaignCost(
        campaign=1,
        name="a",
        method="ast",
        price_usd_per_hour=1.2,
        instances=1,
        completed=100,
        failures=25,
        cost=cost,
        analysis=None,
        modes=3,
        per_mode_usd=per_mode,
        modes_in_words="3 modes",
        curve=(),
        time=time,
    )


def test_sides_of_a_comparison_are_a_row_each_with_what_they_cost():
    alone = tabulate_sides(comparison())
    assert texts(alone)[1] == (
        *("B", "2, 3", "100", "25", "25.0 % [17.5, 34.3]", "−2.50", "80.0"),
        "0.0480 [0.0351, 0.0681]",
    )
    billed = tabulate_sides(comparison(), [[bill(1.0, 0.0)], [bill(1.0, 5.0), bill(2.0, None)]])
    a, b = (row[len(alone.columns) :] for row in texts(billed))
    assert a[:3] == ("1.00", "0.400", "60.0 % (1 min)")
    assert b[:3] == ("3.00", "of one campaign at a time", "60.0 % (2 min)")
    assert (a[-1], b[-1]) == ("0 % (0 s)", "–"), "a part that one did not measure is unknown"


def test_a_comparison_ends_with_what_speaks_against_it():
    _, *said = describe_comparison(comparison())
    assert said == ["A fails less.", "Warning: One seed."]


def test_measures_of_an_episode_say_when_a_threshold_was_passed():
    now = Measures(
        robustness_m=0.0,
        severity=90.0,
        min_ttc_s=0.2,
        max_drac_mps2=12.0,
        ttc_violated_s=3.0,
        drac_at_warning_mps2=5.0,
        collided_s=4.2,
        clipped_steps=0,
    )
    table = tabulate_thresholds(now, Assessment(ttc_lead_s=1.2))
    assert texts(table) == [
        ("MinTTC", "0.200 s", "< 1.5 s", "3.00 s", "1.20 s"),
        ("DRAC, largest", "12.0 m/s²", "> 7 m/s²", "never", "–"),
        ("Footprints apart", "0 m", "0 m", "4.20 s", "–"),
    ]
    assert table.notes == (
        "When the time to collision first fell below 1.5 s, DRAC was 5.00 m/s².",
    )


def test_an_episode_of_an_earlier_release_does_not_claim_that_nothing_was_passed():
    old = Measures(robustness_m=2.0, min_ttc_s=0.2)
    table = tabulate_thresholds(old, Assessment())
    assert [row[3] for row in texts(table)] == ["–", "–", "never"]
    assert table.notes == ()
    assert "never" not in dict(list_measures(old, Assessment())).values()


def step(time_s, **account):
    return ExplainedStep(time_s, 0.0, 0.0, account, (0.0, 0.0))


def test_moments_of_an_episode_are_the_beginnings_of_what_went_wrong():
    steps = (
        step(0.0, lost_tracks=0.0, override="none", qp_status="solved"),
        step(0.1, lost_tracks=1.0, override="none", qp_status="solved"),
        step(0.2, lost_tracks=1.0, override="emergency_brake", qp_status="max_iterations"),
        step(0.3, lost_tracks=1.0, override="emergency_brake", qp_status="max_iterations"),
        step(0.4),
    )
    assert [(each.time_s, each.words) for each in find_moments(steps)] == [
        (0.1, "track lost"),
        (0.2, "emergency brake"),
        (0.2, "program not solved"),
    ]
    lost = [step(k / 10, lost_tracks=float(k)) for k in range(40)]
    assert len(find_moments(lost)) == 12


def test_errored_episodes_are_told_with_their_most_frequent_reason():
    some = Errored(count=3, kind="planner", reason="It divided by zero.", times=2, first=7)
    assert some.words(Counts(planned=10, completed=7, errored=3)) == (
        "3 of 10 episodes errored: the rate leaves them out, and an upper bound counts them as "
        "failures. Most frequent reason (planner, 2 times): It divided by zero."
    )
    only = Errored(count=1, kind="", reason="", times=0)
    assert only.words(Counts(planned=1, errored=1)) == (
        "The only episode errored, so there is no result."
    )
    assert only.words(Counts(planned=3, errored=1)).startswith("The only episode so far errored")
    assert Errored().words(Counts(planned=3, completed=3)) == ""


def test_the_replays_and_the_course_of_a_function_have_no_metres():
    none = Reproduction(Rate(0.0, 0, 2, None), 0.5)
    proof = Proof(
        analysis=1,
        done=True,
        reproduced=none,
        eigenfailures=none,
        medoids=none,
        modes=(),
        scenarios=(),
    )
    texts_of = [analyses.describe_proof(proof, unit=unit) for unit in ("m", "")]
    headings = [[column.heading for column in table.columns] for table, *_ in texts_of]
    assert ["Robustness [m]" in each for each in headings] == [True, False]
    assert [sentences[0].partition("(")[2] for _, *sentences in texts_of] == [
        "smallest robustness 0.500 m) in the same scenario.",
        "smallest robustness 0.500) in the same scenario.",
    ]
    course = Course(campaign=1, method="cem", heading="Learning curve", per=10, blocks=())
    last = [tabulate_course(course, unit)[1].columns[-1].heading for unit in ("m", "")]
    assert last == ["Median robustness [m]", "Median robustness"]


def test_an_episode_of_a_function_lists_its_robustness_alone():
    z = np.zeros((3, 2), np.float32)
    result = EpisodeDetail(
        index=4,
        seed=1,
        outcome=Outcome.COLLISION,
        steps=3,
        noise=NoiseTrajectory(z, np.ones_like(z)),
        source="prior",
        measures=Measures(0.0),
        likelihoods=(ChannelLikelihood("gust", -2.7568, -0.25), ChannelLikelihood("x", None, None)),
    )
    driven = spec()
    called = spec(simulator="function", scenario="function", planner="m:f")
    names = [dict(list_episode_facts("1/0", result, each).rows) for each in (driven, called)]
    assert "severity [m²/s²]" in names[0]
    assert set(names[1]) == {
        *("episode", "outcome", "steps", "disturbances", "robustness", "scene", "digest"),
        *("log p of gust", "log p of x"),
    }
    assert names[1]["log p of gust"] == "−2.7568, −0.25000 relative to z = 0"
    assert names[1]["log p of x"] == "–, – relative to z = 0"
    assert names[1]["robustness"] == "0"


def test_the_unit_of_robustness_is_that_of_its_campaign():
    columns = [
        tabulate_episodes([], unit).columns[4].heading
        for unit in (find_robustness_unit(spec()), "")
    ]
    assert columns == ["Robustness [m]", "Robustness"]
    plain, judged = Measures(2.0), Measures(0.4, nearest_m=2.0, violated=0)
    found = [dict(list_measures(each, Assessment())) for each in (plain, judged)]
    assert [each.get("robustness [m]") for each in found] == ["2.00", None]
    assert found[1]["robustness"] == "0.400"
