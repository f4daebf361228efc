"""The pages of releases, and the way from a failure mode to them and back."""

import json
from pathlib import Path

import pytest
from store_checks.releases import release

from eigenfail.values.triage import TriageChange, TriageState
from eigenfail_api.dashboard import release_page

CLAIMS = Path(__file__).parents[3] / "benchmarks/results/claims.json"


@pytest.fixture
def newest(store):
    """The newest campaign of three releases."""
    release(store, "v1", {"late": 20}, project="lanes")
    release(store, "v2", {"hard": 20, "late": 12}, seed=1)
    mixed = release(store, "v3", {"hard": 20}, seed=2)
    for digest in ("aa11", "bb22"):
        store.campaigns.add_code(mixed.id, {"idm_stack": digest})
    release(store, "v4", {"hard": 2}, seed=3, analyse=False)
    return mixed.id + 1


def test_releases_have_a_page(newest, check_page):
    check_page("dashboard/releases/list", "/releases")
    check_page("dashboard/releases/table", f"/releases/{newest}")


def test_one_click_from_the_home_page_says_what_is_fixed(store, check_page, http):
    release(store, "v1", {"late": 20, "hard": 12})
    newest = release(store, "v2", {"late": 22}, seed=1, passes=60)
    release(store, "v1", {"late": 9}, method="ast")
    release(store, "v2", {"hard": 9}, method="ast", seed=1)
    release(store, "v1", {"late": 3}, scenario_parameters={"distance_m": 60.0})
    assert 'href="/releases"' in http.get("/").text
    text = http.get("/releases").text
    assert "v2 against v1: 1 still there, 1 fixed." in text
    assert "v2 against v1: 1 not met, 1 undecided." in text
    assert text.index("1 fixed") < text.index("Table of scenarios")
    assert f'<a href="/releases/{newest.id}#mode-2">hard</a>' in text
    assert text.count("against v1") == 2
    check_page("dashboard/releases/newest", "/releases")


def test_a_bounded_number_of_scenarios_is_compared(store, http, monkeypatch):
    monkeypatch.setattr(release_page, "SHOWN", 1)
    for method in ("ast", "difs"):
        release(store, "v1", {"late": 9}, method=method)
        release(store, "v2", {"late": 9}, method=method, seed=1)
    text = http.get("/releases").text
    assert text.count("against v1") == 1
    assert "difs" in text[: text.index("Table of scenarios")]


def test_releases_of_a_search_have_a_page(store, check_page):
    release(store, "v1", {"late": 17, "hard": 5}, method="ast", left_out=21, passes=40)
    store.analyses.change_triage(1, 1, TriageChange(state=TriageState.CONFIRMED), "me")
    store.analyses.rename_mode(1, 2, "late")
    alike = {"noise_silhouette": 0.9}
    newest = release(store, "v2", {"hard": 4}, method="ast", seed=1, passes=9, result=alike)
    check_page("dashboard/releases/search", f"/releases/{newest.id}")


def test_the_figures_of_the_tests_are_those_that_were_measured(newest, look):
    claims = json.loads(CLAIMS.read_text())
    new, gone = (claims[f"releases.false_{each}"] for each in ("new", "gone"))
    assert (new["value"] * new["n"], gone["value"] * gone["n"]) == (0.0, 1.0)
    told = f"In {new['n']} re-runs of synthetic releases without a change nothing was"
    assert told in look(f"/releases/{newest}")


def test_where_nothing_was_tested_no_level_is_stated(store, look):
    only = release(store, "v1", {"late": 20})
    assert "level of 5" not in look(f"/releases/{only.id}")


def test_without_a_version_the_page_says_how_to_name_one(check_page, look):
    check_page("dashboard/releases/empty", "/releases")
    assert "Campaign 9" in look("/releases/9", 404)


def test_releases_of_a_project(newest, look):
    assert "cut_in" in look("/releases?project=lanes")
    assert "No release matches this filter" in look("/releases?project=other")


def test_a_mode_leads_to_its_releases_and_back(newest, http, store):
    later = "/analyses/2/modes/2/history"
    assert f'hx-get="{later}"' in http.get("/analyses/2/modes/2").text
    history = http.get(later).text
    assert f'href="/releases/{newest}#mode-1"' in history
    assert "Over releases" in history
    table = http.get(f"/releases/{newest}").text
    assert 'id="mode-1"' in table
    assert 'href="/analyses/2/modes/2"' in table


def test_the_api_says_the_same(newest, http):
    (question,) = http.get("/api/v1/releases").json()["items"]
    assert question["versions"] == ["v1", "v2", "v3", "v4"]
    answer = http.get(f"/api/v1/releases/{question['campaign']}")
    assert answer.json()["question"] == question
    assert question["campaign"] == newest
    assert [each["name"] for each in answer.json()["modes"]] == ["late", "hard"]
    assert http.get("/api/v1/releases?project=other").json()["items"] == []
