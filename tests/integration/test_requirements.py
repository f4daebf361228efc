"""Campaigns that name requirements, from the request to the page."""

import csv

import deadlines
import httpx2
import pytest
from short_searches import CONTINUING, SEARCHES, wait_until_done

from eigenfail.client import Client
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.episode import Outcome

pytestmark = pytest.mark.service

HEADWAY = {"kind": "time_headway", "at_least_s": 0.8}
LANE = {"kind": "lane_keeping", "beyond_m": 0.1}
RESTORED = {
    "kind": "formula",
    "name": "restored",
    "formula": "always (headway_s < 0.6 implies eventually[0:2] headway_s > 0.6)",
}
NAMED = ({"kind": "no_collision"}, HEADWAY, RESTORED)


def create(client, method, episodes, settings, requirements=NAMED, **fields):
    return client.campaigns.create(
        name=f"{method} with {len(requirements)} requirements",
        method=method,
        episodes=episodes,
        settings=settings,
        seed=5,
        planner="idm",
        requirements=list(requirements),
        **fields,
    )


def test_every_search_finds_violations(client, lasting_worker) -> None:
    searches = SEARCHES | CONTINUING
    started = [create(client, name, *given, (HEADWAY,)) for name, given in searches.items()]
    for campaign in started:
        ended = wait_until_done(client, campaign)
        assert ended.counts.errored == 0
        assert ended.counts.failures > 0, ended.spec.method


@pytest.fixture(scope="module")
def failing(service, lasting_worker):
    """A Monte Carlo campaign that is done; no test changes it."""
    with Client(service.address.url) as client:
        return wait_until_done(client, create(client, "monte_carlo", 120, {}, scene_every=1))


def find_violation(client, campaign) -> int:
    return next(iter(client.episodes.list(campaign.id, outcome=Outcome.VIOLATION))).index


def test_collisions_and_violations_are_failures(client, failing) -> None:
    rows = list(client.episodes.list(failing.id))
    failed = [row for row in rows if row.outcome.is_failure]
    assert len(failed) == failing.counts.failures
    assert {row.outcome for row in failed} == {Outcome.COLLISION, Outcome.VIOLATION}
    assert [row.index for row in rows if row.violated] == [row.index for row in failed]
    assert all((row.robustness_m == 0.0) == row.outcome.is_failure for row in rows)
    listed = client.episodes.list(failing.id, filter="violated = 2")
    assert {row.index for row in listed} == {row.index for row in rows if row.violated == 2}


def test_episodes_are_listed_and_exported_with_each_requirement(client, failing, tmp_path) -> None:
    rows = list(client.episodes.list(failing.id))
    wanted = [row for row in rows if row.requirements[1] <= 0.0]
    found = list(client.episodes.list(failing.id, filter="requirement_2 <= 0"))
    assert 0 < len(found) == len(wanted)
    names = [f"requirement_{number}" for number in (1, 2, 3)]
    client.episodes.export(failing.id, tmp_path / "episodes.csv", sort="requirement_2")
    lines = list(csv.DictReader((tmp_path / "episodes.csv").read_text().splitlines()))
    assert list(lines[0])[-3:] == names
    values = [float(line["requirement_2"]) for line in lines]
    assert values == sorted(row.requirements[1] for row in rows)


def test_violations_of_each_are_counted_beside_collisions(client, failing) -> None:
    found = client.campaigns.safety(failing.id)
    assert found.failures.k == failing.counts.failures > found.collisions.k > 0
    assert [each.name for each in found.requirements] == [
        "no_collision",
        "time_headway",
        "restored",
    ]
    results = [
        client.episodes.get(failing.id, row.index) for row in client.episodes.list(failing.id)
    ]
    for place, each in enumerate(found.requirements):
        values = [result.requirements[place] for result in results]
        assert each.violations.k == sum(value <= 0.0 for value in values)
        assert each.worst == min(values)
        assert each.violations.interval is not None


def test_an_episode_is_replayed_and_explained(client, failing) -> None:
    index = find_violation(client, failing)
    replayed = wait_until_done(client, client.episodes.replay(failing.id, index))
    again, stored = client.episodes.get(replayed.id, 0), client.episodes.get(failing.id, index)
    assert replayed.counts.failures == 1
    assert (again.digest(), again.requirements) == (stored.digest(), stored.requirements)
    explained = client.episodes.explanation(failing.id, index)
    assert "is violated" in explained.story[-1]


def test_failures_are_grouped_and_proven(client, failing) -> None:
    found = client.analyses.wait(client.analyses.create(failing.id).id)
    assert found.state is AnalysisState.DONE, found.problem
    assert found.result.before_collision == ()
    client.analyses.prove(found.id)
    proof = client.analyses.wait_for_proof(found.id, timeout_s=deadlines.CAMPAIGN_S)
    here = proof.scenarios[0].medoids.rate
    assert here.k == here.n == len(found.result.modes)
    with pytest.raises(InvalidValue, match="need not end in a collision"):
        client.analyses.create(failing.id, align="collision")


def test_pages_tell_the_requirements(client, failing) -> None:
    index = find_violation(client, failing)
    pages = {
        f"campaigns/{failing.id}": ("time headway above 0.8 s", "violation"),
        f"campaigns/{failing.id}/measures": ("Violates time_headway", "Violates restored"),
        f"campaigns/{failing.id}/episodes/{index}": ("Demands: time headway above 0.8 s",),
        f"campaigns/{failing.id}/episodes?filter=violated+%3E%3D+1": ("violation",),
        f"analyses/{client.analyses.create(failing.id).id}": (),
        "": ("idm in cut_in",),
    }
    for path, words in pages.items():
        text = httpx2.get(f"{client.url}/{path}").raise_for_status().text
        assert all(each in text for each in words), path


def test_with_an_importance_alone_failures_are_collisions_and_can_be_aligned_there(
    client, lasting_worker
) -> None:
    led = wait_until_done(
        client,
        create(
            client,
            "monte_carlo",
            30,
            {},
            ({"kind": "no_collision"},),
            importance={"kind": "measure", "measure": "min_ttc_s", "at_least": 0.0},
        ),
    )
    found = client.analyses.wait(client.analyses.create(led.id, align="collision").id)
    assert found.state is AnalysisState.DONE, found.problem
    assert found.result.before_collision


@pytest.mark.parametrize(
    ("requirement", "kind", "words"),
    [
        ({"kind": "headway"}, UnknownName, "Did you mean 'time_headway'"),
        ({"kind": "time_headway", "at_least": 1.0}, UnknownName, "Did you mean 'at_least_s'"),
        ({"kind": "formula", "formula": "always hedway_s > 1"}, UnknownName, "headway_s"),
        ({"kind": "formula", "formula": "always[0:99] headway_s > 1"}, InvalidValue, "ahead"),
        ({"kind": "measure", "measure": "ttc", "at_least": 1.0}, UnknownName, "min_ttc_s"),
        ({"kind": "time_headway", "scale": 0.0}, InvalidValue, "scale"),
    ],
)
def test_what_cannot_be_required_is_refused(client, requirement, kind, words) -> None:
    with pytest.raises(kind, match=words):
        create(client, "monte_carlo", 10, {}, (requirement,))
