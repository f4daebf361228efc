"""Releases are found by what was asked of a planner, and compared by failure modes."""

import pytest
from store_checks.releases import release

from eigenfail.errors import NotFound
from eigenfail.intervals import ERROR, find_upper_bound, wilson
from eigenfail.presentation.figures import format_percent_interval
from eigenfail.presentation.releases import compare_newest
from eigenfail.values.analysis import AnalysedCampaign, AnalysisSettings
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.release import ModeStatus
from eigenfail.values.triage import TriageChange, TriageState
from eigenfail_services.comparison import releases
from eigenfail_services.comparison.releases import (
    find_history,
    list_tested_worlds,
    make_release_table,
)
from eigenfail_services.statistics.intervals import confidence_sequence

FIRST, STILL, GONE, BACK, OPEN = (
    ModeStatus.FIRST_SEEN,
    ModeStatus.STILL_THERE,
    ModeStatus.NOT_FOUND_AGAIN,
    ModeStatus.REGRESSED,
    ModeStatus.UNDECIDED,
)


def statuses(table):
    return {mode.name: [each.status for each in mode.sightings] for mode in table.modes}


# Only episodes with failures are stored: in each release all completed episodes fail.
def test_modes_come_go_and_come_back_under_their_names(store):
    release(store, "v1", {"late": 20})
    release(store, "v2", {"late": 20, "hard": 20}, seed=1)
    release(store, "v3", {"hard": 40}, seed=2)
    newest = release(store, "v4", {"hard": 20, "late": 20}, seed=3)
    table = make_release_table(store, newest.id)
    assert [each.version for each in table.releases] == ["v1", "v2", "v3", "v4"]
    assert statuses(table) == {
        "late": [FIRST, STILL, GONE, BACK],
        "hard": [None, FIRST, STILL, STILL],
    }
    last = table.modes[1].newest
    assert (last.analysis, last.mode, last.failures) == (4, 1, 20)
    store.analyses.rename_mode(4, 1, "hard braking")
    assert make_release_table(store, newest.id).modes[1].name == "hard braking"


def test_a_mode_has_its_history(store):
    release(store, "v1", {"late": 20})
    release(store, "v2", {"hard": 30, "late": 9}, seed=1)
    campaign, history = find_history(store, 2, 2)
    assert campaign == 2
    assert [each.status for each in history.sightings] == [FIRST, STILL]
    plain = release(store, "v3", {"late": 3}, planner_version="v3", method="replay")
    assert find_history(store, 3, 1) is None, plain


def test_other_questions_are_other_releases(store):
    first = release(store, "v1", {"late": 6})
    others = [
        release(store, "v2", {"late": 6}, **changes)
        for changes in (
            {"planner": "rulebook"},
            {"method": "ast"},
            {"scenario": "merge_in"},
            {"scenario_parameters": {"distance_m": 54.0}},
        )
    ]
    alike = [
        release(store, "v3", {"late": 6}, **changes)
        for changes in (
            {"seed": 4, "episodes": 900, "project": "x", "tags": ("y",)},
            {"planner_settings": {"time_headway_s": 2.0}, "seed": 5},
            {"scenario_parameters": {"distance_m": 53}, "seed": 6},
        )
    ]
    questions = list_tested_worlds(store)
    assert len(questions) == 1 + len(others)
    assert questions[0].versions == ("v1", "v3")
    table = make_release_table(store, first.id)
    assert table.releases[1].campaigns == tuple(each.id for each in alike)
    assert table.releases[1].failures == 18
    assert [each.campaign for each in list_tested_worlds(store, "x")] == [alike[0].id]


def test_a_repeated_campaign_counts_once(store):
    release(store, "v1", {"late": 6})
    again = release(store, "v1", {"late": 6})
    table = make_release_table(store, again.id)
    assert table.releases[0].campaigns == (again.id,)
    assert table.releases[0].episodes == 6


def test_what_is_not_analysed_or_not_done_is_not_compared(store):
    release(store, "v1", {"late": 20})
    waiting = release(store, "v2", {"hard": 20}, analyse=False, seed=1)
    table = make_release_table(store, waiting.id)
    assert statuses(table) == {"late": [FIRST, None]}
    assert f"`eigenfail analyze {waiting.id}`" in table.releases[1].problem
    assert any("v2 are not compared" in note for note in table.notes)
    without = release(store, "v3", {}, passes=20, seed=2)
    assert make_release_table(store, without.id).releases[2].problem == ""


def test_version_without_completed_episode_is_not_compared(store):
    release(store, "v1", {"late": 20})
    empty = release(store, "v2", {}, seed=1)
    table = make_release_table(store, empty.id)
    assert statuses(table) == {"late": [FIRST, None]}
    assert table.releases[1].problem == f"Campaign {empty.id} completed no episode."
    assert compare_newest(table).words == f"v2 is not compared. {table.releases[1].problem}"


def test_version_that_is_not_analysed_is_named_beside_its_successor(store):
    release(store, "1.4.2", {}, passes=40)
    middle = release(store, "1.5.0", {"late": 20}, analyse=False, passes=20, seed=1)
    newest = release(store, "1.5.1", {}, passes=40, seed=2)
    assert compare_newest(make_release_table(store, newest.id)).words == (
        "1.5.0, with 20 failures in 40 episodes, is not compared. "
        f"Campaign {middle.id} is not analysed: run `eigenfail analyze {middle.id}`. "
        "1.5.1 against 1.4.2: no failure mode in either version."
    )


def test_table_notes_campaigns_beyond_the_newest_that_are_read(store, monkeypatch):
    for place in range(3):
        newest = release(store, f"v{place}", {"late": 6}, seed=place)
    monkeypatch.setattr(releases.release_reading, "MOST_CAMPAIGNS", 2)
    table = make_release_table(store, newest.id)
    assert [each.version for each in table.releases] == ["v1", "v2"]
    assert table.notes[-1] == (
        "Only the newest 2 campaigns with a version are read: older versions may be missing."
    )


def test_a_search_says_that_it_proves_nothing(store):
    release(store, "v1", {"late": 20}, method="ast")
    newest = release(store, "v2", {"hard": 20}, method="ast", seed=1)
    table = make_release_table(store, newest.id)
    assert statuses(table) == {"late": [FIRST, ModeStatus.NOT_MET], "hard": [None, OPEN]}
    told = "Not met in this search; this is no proof: replay its failures."
    assert table.modes[0].newest.words == f"0 of the 20 failures. {told}"
    assert "no proof" in table.modes[1].newest.words
    assert [each.newest.chance for each in table.modes] == [None, None]
    assert not table.is_tested
    assert any("does not prove that the mode is gone" in note for note in table.notes)


def test_one_version_with_different_code_is_marked(store):
    one, two = (release(store, "v1", {"late": 9}, seed=seed) for seed in (1, 2))
    code = {"idm_stack": "aa11", "scenarios": "cc33"}
    store.campaigns.add_code(one.id, code)
    store.campaigns.add_code(two.id, code)
    assert len(make_release_table(store, two.id).releases[0].fingerprints) == 1
    store.campaigns.add_code(two.id, {**code, "idm_stack": "bb22"})
    table = make_release_table(store, two.id)
    assert len(table.releases[0].fingerprints) == 2
    told = "Version v1 ran with different code: idm_stack aa11 (campaigns 1, 2), bb22 (campaign 2)."
    assert told in table.notes


def test_the_same_code_and_settings_under_two_versions_change_nothing(store):
    one = release(store, "v1", {"late": 29})
    two = release(store, "v2", {"hard": 30}, seed=1)
    changed = {"late": [FIRST, GONE], "hard": [None, FIRST]}
    assert statuses(make_release_table(store, two.id)) == changed
    for each in (one, two):
        store.campaigns.add_code(each.id, {"idm_stack": "aa11"})
    table = make_release_table(store, two.id)
    assert statuses(table) == {"late": [FIRST, OPEN], "hard": [None, OPEN]}
    for mode in table.modes:
        assert mode.newest.words.endswith("; the same code and settings as v1.")
    assert "v2 has the same code and settings as v1." in table.notes


def test_other_settings_of_the_planner_are_named(store):
    written, other = {"time_headway_s": 1.5}, {"time_headway_s": 4.0}
    made = [
        release(store, "v1", {"late": 30}),
        release(store, "v2", {"late": 30}, seed=1, planner_settings=written),
        release(store, "v3", {}, passes=30, seed=2, planner_settings=other),
    ]
    differing = "time_headway_s 4.0 instead of 1.5."
    table = make_release_table(store, made[-1].id)
    assert table.notes == (f"v3 has other settings than v2: {differing}",)
    for each in made:
        store.campaigns.add_code(each.id, {"idm_stack": "aa11"})
    table = make_release_table(store, made[-1].id)
    assert statuses(table) == {"late": [FIRST, STILL, GONE]}
    # A default that is written out is the same setting.
    assert table.notes == (
        "v2 has the same code and settings as v1.",
        f"v3 has the code of v2 and other settings: {differing}",
    )


def test_counts_of_a_search_are_of_the_failures_analysed(store):
    found = release(store, "v1", {"late": 17, "hard": 5}, method="ast", left_out=21, passes=40)
    table = make_release_table(store, found.id)
    words = "17 of the 22 failures analysed; 43 were found."
    assert table.modes[0].newest.words == words
    assert (table.releases[0].analysed, table.releases[0].failures) == (22, 43)


def test_a_random_sample_has_rates_with_their_bounds(store):
    release(store, "v1", {"late": 26}, passes=34)
    newest = release(store, "v2", {}, seed=1, passes=60)
    (mode,) = make_release_table(store, newest.id).modes
    first, last = (each.words for each in mode.sightings)
    # Wilson's interval of 26 of 60, rounded outwards.
    bounds = wilson(26, 60)
    assert 31.5 < 100 * bounds.low < 31.6
    assert 55.8 < 100 * bounds.high < 55.9
    assert first == "26 of 60 episodes: 43.3 % [31.5, 55.9]."
    # 1 - 0.05^(1/60) is 4.8702 %.
    assert find_upper_bound(0, 60, ERROR) == pytest.approx(0.048702, abs=1e-6)
    chance = "a count this uneven would have a probability of at most 1.5×10⁻⁸."
    assert last == f"No failure in 60 episodes: ≤ 4.88 %; if its rate were unchanged, {chance}"
    assert mode.newest.chance == pytest.approx(0.5**26)
    assert 1.4e-8 < 0.5**26 < 1.5e-8


def test_a_stop_rule_on_failures_widens_the_intervals(store):
    rule = StopRules(failures=26)
    stopped = release(store, "v1", {"late": 26}, passes=34, stop=rule)
    words = make_release_table(store, stopped.id).modes[0].newest.words
    bounds = format_percent_interval(confidence_sequence(26, 60)).removesuffix(" %")
    assert words == f"26 of 60 episodes: 43.3 % {bounds}."


def test_what_chance_may_explain_says_so(store):
    release(store, "v1", {"late": 3}, passes=57)
    newest = release(store, "v2", {}, seed=1, passes=60)
    (mode,) = make_release_table(store, newest.id).modes
    assert mode.newest.status is OPEN
    assert "; chance may explain it: if its rate were unchanged" in mode.newest.words
    assert mode.newest.words.endswith("a probability of at most 0.13.")


def test_groups_that_chance_makes_are_called_so(store):
    release(store, "v1", {"late": 20})
    alike = {"noise_silhouette": 0.9}
    two = release(store, "v2", {"late": 20}, seed=1, result=alike)
    table = make_release_table(store, two.id)
    note = "the groups of analysis 2 cannot be told from chance; read them as a summary."
    assert [each for each in table.notes if "groups" in each] == [f"v2: {note}"]
    assert table.title == "Failure modes"
    three = release(store, "v3", {"late": 20}, seed=2, result=alike, scenario="merge_in")
    assert make_release_table(store, three.id).title == "Groups of failures"
    release(store, "v3", {"late": 20}, seed=3, scenario="merge_in")  # modes of one campaign alone
    assert make_release_table(store, three.id).title == "Groups of failures"


def test_the_triage_of_the_newest_sighting_is_shown_and_what_was_fixed_is_noted(store):
    release(store, "v1", {"late": 20})
    newest = release(store, "v2", {"late": 20}, seed=1)

    def mark(analysis, state):
        store.analyses.change_triage(analysis, 1, TriageChange(state=state), "me")
        return make_release_table(store, newest.id)

    assert mark(2, TriageState.CONFIRMED).modes[0].state is TriageState.CONFIRMED
    assert not any("fixed" in note for note in mark(2, TriageState.KNOWN).notes)
    table = mark(1, TriageState.FIXED)
    assert table.modes[0].state is TriageState.KNOWN
    note = "Mode 1, late, is marked fixed (analysis 1, mode 1), and v2 has failures of it."
    assert note in table.notes
    gone = release(store, "v3", {"hard": 20}, seed=2)
    assert not any("marked fixed" in note for note in make_release_table(store, gone.id).notes)


def test_names_that_repeat_have_their_address(store):
    newest = release(store, "v1", {"late": 20, "hard": 20})
    store.analyses.rename_mode(1, 2, "late")
    names = [each.name for each in make_release_table(store, newest.id).modes]
    assert names == ["late (analysis 1, mode 1)", "late (analysis 1, mode 2)"]
    store.analyses.rename_mode(1, 2, "hard")
    names = [each.name for each in make_release_table(store, newest.id).modes]
    assert names == ["late", "hard"]


def test_an_analysis_is_asked_for_only_where_none_is_coming(store):
    waiting = release(store, "v1", {"late": 20}, analyse=False)

    def find_problem():
        return make_release_table(store, waiting.id).releases[0].problem

    asked = "Campaign 1 is not analysed: run `eigenfail analyze 1`."
    assert find_problem() == asked
    store.analyses.create(waiting.id, AnalysisSettings())
    assert find_problem() == "Campaign 1 is not analysed yet: analysis 1 is queued."
    store.analyses.start(1)
    assert find_problem() == "Campaign 1 is not analysed yet: analysis 1 is running."
    store.analyses.fail(1, "It was too large.")
    assert find_problem() == asked


def test_failures_whose_scenes_are_not_stored_are_not_compared(store, monkeypatch):
    made = release(store, "v1", {"late": 20})
    monkeypatch.setattr(store.episodes, "mode_courses", lambda *_: {})
    problem = make_release_table(store, made.id).releases[0].problem
    assert problem == "The scenes of the failures of campaign 1 are not stored."


def test_an_analysis_of_a_running_campaign_is_not_compared(store):
    source = AnalysedCampaign(campaign=1, episodes=20, failures=20, running=True)
    early = release(store, "v1", {"late": 20}, result={"sources": (source,)})
    problem = make_release_table(store, early.id).releases[0].problem
    begun = "Analysis 1 was made while campaign 1 was running"
    assert problem == f"{begun}: run `eigenfail analyze 1`."


def test_a_campaign_without_a_version_is_part_of_no_release(store):
    plain = release(store, "v1", {"late": 3}, planner_version="v1", method="replay")
    with pytest.raises(NotFound, match="Campaign 1 is part of no release"):
        make_release_table(store, plain.id)
    with pytest.raises(NotFound):
        make_release_table(store, 99)
    assert list_tested_worlds(store) == ()
