"""Campaigns over HTTP: created once, listed, steered, summed up."""

import pytest

from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail_api.routes import campaigns

URL = "/api/v1/campaigns"


def test_a_created_campaign_is_queued_and_has_an_address(http, fields, store):
    response = http.post(URL, json=fields)
    assert response.status_code == 201
    assert response.json()["state"] == "queued"
    assert response.json()["spec"]["disturbance"]["longitudinal_base_m"] == 1.0
    there = http.get(response.headers["Location"])
    assert there.json() == response.json()
    assert store.campaigns.get(response.json()["id"]).spec == CampaignSpec(**fields)


@pytest.mark.fault(
    "same POST twice with one idempotency key",
    group="api",
    outcome="One campaign is created, and both answers name it.",
)
def test_one_key_makes_one_campaign(http, fields, store):
    key = {"Idempotency-Key": "a key"}
    first, second = (http.post(URL, json=fields, headers=key) for _ in range(2))
    assert first.status_code == second.status_code == 201
    assert first.json()["id"] == second.json()["id"]
    assert len(store.campaigns.page(10).items) == 1


def test_one_key_for_two_campaigns_is_a_conflict(http, fields, problem):
    key = {"Idempotency-Key": "a key"}
    http.post(URL, json=fields, headers=key)
    told = problem(http.post(URL, json={**fields, "seed": 1}, headers=key), 409)
    assert told["type"] == "urn:eigenfail:idempotency-mismatch"


@pytest.mark.parametrize("key", ["", "k" * 201])
def test_keys_have_a_length(http, fields, problem, key):
    told = problem(http.post(URL, json=fields, headers={"Idempotency-Key": key}), 422)
    assert told["field"] == "Idempotency-Key"


def test_a_budget_that_its_method_cannot_begin_with_is_refused(http, fields, problem, store):
    told = problem(http.post(URL, json={**fields, "method": "subset", "episodes": 100}), 422)
    assert told["field"] == "episodes"
    assert "100 are fewer than 20 samples on each of 7 levels in 2 runs" in told["detail"]
    assert told["remedy"].startswith("Give more episodes")
    assert store.campaigns.page(10).items == ()


@pytest.mark.fault(
    "pause, resume or cancel that comes twice, too early or too late",
    group="api",
    outcome="It is granted once, or refused with a 409 that names the state.",
)
@pytest.mark.parametrize(
    ("state", "verb", "then"),
    [
        ("queued", "pause", "paused"),
        ("running", "pause", "pausing"),
        ("pausing", "pause", "pausing"),
        ("paused", "pause", "paused"),
        ("paused", "resume", "queued"),
        ("queued", "resume", "queued"),
        ("running", "resume", "running"),
        ("queued", "cancel", "cancelled"),
        ("paused", "cancel", "cancelled"),
        ("running", "cancel", "cancelling"),
        ("pausing", "cancel", "cancelling"),
        ("cancelling", "cancel", "cancelling"),
        ("cancelled", "cancel", "cancelled"),
    ],
)
def test_wishes_move_a_campaign_and_may_come_twice(http, put_in_state, state, verb, then):
    campaign = put_in_state(state)
    for _ in range(2):
        response = http.post(f"{URL}/{campaign}/{verb}")
        assert response.status_code == 200
        assert response.json()["state"] == then


@pytest.mark.parametrize(
    ("state", "verb"),
    [
        ("done", "pause"),
        ("done", "resume"),
        ("done", "cancel"),
        ("cancelled", "pause"),
        ("cancelled", "resume"),
        ("cancelling", "pause"),
        ("pausing", "resume"),
    ],
)
def test_a_wish_that_cannot_be_granted_is_a_conflict(
    *, http, put_in_state, store, problem, state, verb
):
    campaign = put_in_state(state)
    told = problem(http.post(f"{URL}/{campaign}/{verb}"), 409)
    assert told["type"] == "urn:eigenfail:illegal-transition"
    assert state in told["detail"]
    assert store.campaigns.get(campaign).state == state


def test_a_campaign_that_begins_between_look_and_step_is_paused_all_the_same(
    store, campaign, monkeypatch
):
    look = store.campaigns.get
    seen = [look(campaign)]
    store.campaigns.move(campaign, CampaignState.RUNNING)
    monkeypatch.setattr(store.campaigns, "get", lambda id_: seen.pop() if seen else look(id_))
    assert campaigns.steer(store, campaign, campaigns.PAUSE).state == "pausing"


def test_a_summary_counts_failures_and_prices_them(http, campaign, deliver, result, store):
    deliver(campaign, *(result(i) for i in range(3)), result(3, Outcome.COLLISION))
    store.campaigns.add_active(campaign, 3600.0)
    summary = http.get(f"{URL}/{campaign}/summary").json()
    assert summary["failure_rate"]["k"] == 1
    assert summary["failure_rate"]["n"] == 4
    assert summary["mean_severity"] == 25.0
    assert summary["cost"]["total_usd"] == pytest.approx(1.2)
    assert summary["cost"]["per_failure_usd"] == pytest.approx(1.2)
    assert http.get(f"{URL}/summaries").json()["items"] == [summary]


def test_a_course_counts_by_blocks(*, http, campaign, deliver, result, failed, problem):
    crashes = [result(index, Outcome.COLLISION) for index in (4, 5)]
    deliver(campaign, *(result(index) for index in range(3)), failed(3), *crashes)
    course = http.get(f"{URL}/{campaign}/course", params={"per": 4}).json()
    assert (course["heading"], course["per"]) == ("Failures over episodes", 4)
    first, second = course["blocks"]
    assert (first["first"], first["last"], second["last"]) == (0, 3, 7)
    assert (first["failure_rate"]["k"], first["failure_rate"]["n"]) == (0, 3)
    assert first["median_robustness_m"] == 3.5
    assert first["log_probability_per_step"] is None
    assert (second["failure_rate"]["k"], second["failure_rate"]["n"]) == (2, 2)
    log_p = sum(crash.noise.log_probability for crash in crashes)
    assert second["log_probability_per_step"] == pytest.approx(log_p / 8)
    assert len(http.get(f"{URL}/{campaign}/course").json()["blocks"]) == 5
    problem(http.get(f"{URL}/{campaign}/course", params={"per": 0}), 422)


def test_a_course_has_a_thousand_blocks_at_most(http, fields, problem):
    many = http.post(URL, json={**fields, "episodes": 10_000}).json()["id"]
    told = problem(http.get(f"{URL}/{many}/course", params={"per": 9}), 422)
    assert (told["field"], told["remedy"]) == ("per", "Take at least 10.")


def test_the_digest_covers_what_is_in_and_says_when_it_is_final(
    http, campaign, deliver, result, store
):
    empty = http.get(f"{URL}/{campaign}/digest").json()
    deliver(campaign, *(result(i) for i in range(10)))
    full = http.get(f"{URL}/{campaign}/digest").json()
    assert full["digest"] != empty["digest"]
    assert (full["episodes"], full["final"]) == (10, False)
    store.campaigns.move(campaign, CampaignState.DONE)
    final = http.get(f"{URL}/{campaign}/digest").json()
    assert final == {**full, "final": True}


@pytest.fixture
def put_in_state(store, campaign):
    ways = {
        "queued": [],
        "running": ["running"],
        "pausing": ["running", "pausing"],
        "paused": ["paused"],
        "cancelling": ["running", "cancelling"],
        "cancelled": ["cancelled"],
        "done": ["running", "done"],
    }

    def move(state):
        for step in ways[state]:
            store.campaigns.move(campaign, CampaignState(step))
        return campaign

    return move


def test_campaigns_are_found_by_method_and_name(http, fields):
    for name, method in (("Night drive", "monte_carlo"), ("night", "ast"), ("day", "ast")):
        http.post("/api/v1/campaigns", json={**fields, "name": name, "method": method})

    def found(asked):
        return [c["id"] for c in http.get(f"/api/v1/campaigns?{asked}").json()["items"]]

    assert found("method=ast") == [3, 2]
    assert found("search=NIGHT") == [2, 1]
    assert found("search=night&method=ast") == [2]
    assert found("search=%25") == []

    def count(asked):
        return http.get(f"/api/v1/campaigns?{asked}&limit=1&total=true").json()["total"]

    assert [count(asked) for asked in ("", "method=ast", "search=NIGHT", "search=%25")] == [
        3,
        2,
        2,
        0,
    ]


@pytest.mark.fault("pause, resume or cancel that comes twice, too early or too late")
def test_no_campaign_can_be_steered_against_its_state(http, problem, finished):
    campaign = f"/api/v1/campaigns/{finished()}"
    http.post(f"{campaign}/cancel")
    told = problem(http.post(f"{campaign}/pause"), 409)
    assert told["remedy"] == "Only one that is queued or running can."


def test_a_priority_is_asked_for_and_changed(http, fields, store, problem):
    made = http.post(URL, json={**fields, "priority": "low"}).json()
    assert made["spec"]["priority"] == "low"
    changed = http.post(f"{URL}/{made['id']}/priority", json={"priority": "high"})
    assert changed.status_code == 200
    assert changed.json() == {**made, "spec": {**made["spec"], "priority": "high"}}
    assert http.get(f"{URL}/{made['id']}").json() == changed.json()
    told = problem(http.post(f"{URL}/{made['id']}/priority", json={"priority": "urgent"}), 422)
    assert told["field"] == "priority"
    http.post(f"{URL}/{made['id']}/cancel")
    problem(http.post(f"{URL}/{made['id']}/priority", json={"priority": "low"}), 409)
    problem(http.post(f"{URL}/99/priority", json={"priority": "low"}), 404)


LABELS = {"project": "lane keeping", "tags": ["nightly"], "planner_version": "v1.2"}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("planner_version", "v 1"),
        ("planner_version", "v1\n"),
        ("planner_version", ""),
        ("project", " x"),
        ("project", "x\n"),
        ("tags", ["a b"]),
        ("tags", ['"']),
        ("tags", ["x"] * 51),
    ],
)
def test_a_label_that_cannot_be_is_refused_by_its_name(http, fields, problem, name, value):
    told = problem(http.post(URL, json={**fields, name: value}), 422)
    assert told["field"].startswith(name), told


def test_a_clone_with_another_planner_has_no_version(http, fields):
    http.post(URL, json={**fields, **LABELS})
    same = http.post(f"{URL}/1/clone", json={"seed": 5}).json()["spec"]
    other = http.post(f"{URL}/1/clone", json={"planner": "rulebook"}).json()["spec"]
    assert same["planner_version"] == "v1.2"
    assert "planner_version" not in other
    assert other["project"] == LABELS["project"]
