"""Releases are found by what was asked of a planner, and compared by failure modes."""

import pytest
from store_checks.releases import release

from eigenfail.errors import NotFound
from eigenfail.values.release import ModeStatus
from eigenfail_services.campaigns.releases import (
    find_history,
    list_questions,
    make_release_table,
)
from eigenfail_services.store import open_store

FIRST, STILL, GONE, BACK, OPEN = (
    ModeStatus.FIRST_SEEN,
    ModeStatus.STILL_THERE,
    ModeStatus.NOT_FOUND_AGAIN,
    ModeStatus.REGRESSED,
    ModeStatus.UNDECIDED,
)


@pytest.fixture
def store():
    store = open_store("memory://")
    yield store
    store.close()


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
    questions = list_questions(store)
    assert len(questions) == 1 + len(others)
    assert questions[0].versions == ("v1", "v3")
    table = make_release_table(store, first.id)
    assert table.releases[1].campaigns == tuple(each.id for each in alike)
    assert table.releases[1].failures == 18
    assert [each.campaign for each in list_questions(store, "x")] == [alike[0].id]


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
    without = release(store, "v3", {}, seed=2)
    store.campaigns.get(without.id)
    assert make_release_table(store, without.id).releases[2].problem == ""


def test_a_search_says_that_it_proves_nothing(store):
    release(store, "v1", {"late": 20}, method="ast")
    newest = release(store, "v2", {"hard": 20}, method="ast", seed=1)
    table = make_release_table(store, newest.id)
    assert statuses(table) == {"late": [FIRST, GONE], "hard": [None, OPEN]}
    assert "no proof" in table.modes[0].newest.words
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


def test_the_same_code_under_two_versions_has_nothing_new(store):
    one = release(store, "v1", {"late": 9})
    two = release(store, "v2", {"late": 9, "hard": 30}, seed=1)
    assert statuses(make_release_table(store, two.id))["hard"] == [None, FIRST]
    for each in (one, two):
        store.campaigns.add_code(each.id, {"idm_stack": "aa11"})
    table = make_release_table(store, two.id)
    assert statuses(table)["hard"] == [None, OPEN]
    assert "v2 has the same code as v1." in table.notes


def test_a_campaign_without_a_version_is_part_of_no_release(store):
    plain = release(store, "v1", {"late": 3}, planner_version="v1", method="replay")
    with pytest.raises(NotFound, match="Campaign 1 is part of no release"):
        make_release_table(store, plain.id)
    with pytest.raises(NotFound):
        make_release_table(store, 99)
    assert list_questions(store) == ()
