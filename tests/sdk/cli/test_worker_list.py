"""`eigenfail worker list`: who works for a service."""

import json

import pytest

from eigenfail.presentation.workers import WorkerState, summarize_activity
from eigenfail.values.operations import Arrival, Presence, WorkerShare


def test_who_brought_results_is_listed_once(eigenfail, done, spec_file):
    assert eigenfail("run", spec_file, "--seed", "2").exit_code == 0
    told = eigenfail("worker", "list")
    assert told.exit_code == 0, told.output
    assert told.stdout.splitlines()[-1].split()[:7] == ["by", "hand", "–", "–", "gone", "2", "48"]
    (found,) = json.loads(eigenfail("worker", "list", "--json").stdout)
    assert (found["worker"], found["state"], found["campaigns"]) == ("by hand", "gone", [1, 2])
    assert (found["episodes"], found["failed"]) == (48, 0)


def test_that_nobody_works_is_said_with_what_to_do(eigenfail):
    told = eigenfail("worker", "list", "--within-s", "90")
    assert told.exit_code == 0
    assert told.stdout.startswith(
        "No worker is connected, and no results arrived in the last 90 s."
    )
    assert json.loads(eigenfail("worker", "list", "--json").stdout) == []


def test_it_is_watched_until_no_campaign_runs(eigenfail, spec_file, store):
    eigenfail("campaign", "create", spec_file)
    told = eigenfail("worker", "list", "--watch", "--json")
    seen = [json.loads(line) for line in told.stdout.splitlines()]
    episodes = [sum(each["episodes"] for each in workers) for workers in seen]
    assert episodes == sorted(set(episodes))
    assert episodes[-1] == 24


HERE = Presence(id=3, worker="w", host="rack 4", pid=7, versions={}, arrived_ms=5, heard_ms=6)


@pytest.mark.parametrize(
    ("here", "is_at_work", "state"),
    [
        (None, True, WorkerState.GONE),
        (HERE, True, WorkerState.AT_WORK),
        (HERE, False, WorkerState.WAITING),
        (None, False, WorkerState.GONE),
    ],
)
def test_what_a_worker_did_for_several_campaigns_is_added_up(here, is_at_work, state):
    counts = {"worker": "w", "failures": 1, "errored": 2, "wall_s": 1.0}
    shares = [
        WorkerShare(campaign=campaign, episodes=5, last_ms=at_ms, **counts)
        for campaign, at_ms in ((4, 20), (3, 10))
    ]
    found = summarize_activity("w", shares, here, is_at_work=is_at_work)
    assert (found.campaigns, found.episodes, found.failures, found.errored) == ((3, 4), 10, 2, 4)
    assert (found.state, found.last_ms) == (state, 20)
    assert (found.host, found.since_ms) == (("rack 4", 5) if here else ("", None))


def test_who_waits_is_listed_before_the_first_result(eigenfail, store):
    store.roster.arrived([Arrival(worker="idle [1]", host="rack 4", pid=7)])
    told = eigenfail("worker", "list").stdout.splitlines()[-1].split()
    assert told == ["idle", "[1]", "rack", "4", "–", "waiting", "0", "0", "0", "0", "–"]
    (found,) = json.loads(eigenfail("worker", "list", "--json").stdout)
    assert (found["state"], found["last_ms"], found["campaigns"]) == ("waiting", None, [])
