"""Alive, ready, measured."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest

from eigenfail.errors import StoreUnavailable
from eigenfail.values.episode import Outcome
from eigenfail.values.operations import Arrival
from eigenfail_api.routes import operations
from eigenfail_services.campaigns import summary


def test_a_live_process_says_so_without_its_database(http, store, monkeypatch):
    monkeypatch.setattr(store, "ping", unreachable)
    assert http.get("/healthz").json() == {"status": "ok"}


def test_ready_means_that_the_database_answers(http, store, monkeypatch, problem):
    monkeypatch.setattr(operations, "MAX_AGE_S", 0.0)
    assert http.get("/readyz").status_code == 200
    monkeypatch.setattr(store, "ping", unreachable)
    response = http.get("/readyz")
    told = problem(response, 503)
    assert told["type"] == "urn:eigenfail:store-unavailable"
    assert told["remedy"] == "Start it."
    assert response.headers["Retry-After"] == "1"


def test_many_probes_at_once_ask_the_database_once(http, store, monkeypatch):
    asked = []
    monkeypatch.setattr(operations, "MAX_AGE_S", 600.0)  # however slow the machine is
    monkeypatch.setattr(store, "ping", lambda: asked.append(time.sleep(0.05)))
    with ThreadPoolExecutor(8) as probes:
        answers = list(probes.map(lambda _: http.get("/readyz").status_code, range(24)))
    assert set(answers) == {200}
    assert len(asked) == 1
    monkeypatch.setattr(operations, "MAX_AGE_S", 0.0)
    http.get("/readyz")
    assert len(asked) == 2


@pytest.mark.fault(
    "database that does not answer a probe",
    group="storage",
    outcome="`/readyz` answers 503 after three seconds; other requests are not held up.",
)
def test_a_probe_that_hangs_is_given_up_and_holds_up_nobody(http, store, monkeypatch, problem):
    answers, begun = Event(), []
    monkeypatch.setattr(store, "ping", lambda: begun.append(answers.wait(60.0)))
    monkeypatch.setattr(operations, "PROBE_LIMIT_S", 0.5)
    with ThreadPoolExecutor(4) as probes:
        waiting = [probes.submit(http.get, "/readyz") for _ in range(4)]
        assert http.get("/healthz").status_code == 200
        for each in waiting:
            told = problem(each.result(timeout=30.0), 503)
            assert "did not answer within 0.5 s" in told["detail"]
    answers.set()
    assert len(begun) <= 1


def test_metrics_count_campaigns_episodes_and_failures(
    *, http, fields, campaign, deliver, result, failed
):
    http.post("/api/v1/campaigns", json=fields)
    deliver(campaign, result(0), result(1, Outcome.COLLISION), failed(2))
    lines = http.get("/metrics").text.splitlines()
    assert 'eigenfail_campaigns{state="running"} 1.0' in lines
    assert 'eigenfail_campaigns{state="queued"} 1.0' in lines
    assert 'eigenfail_campaigns{state="done"} 0.0' in lines
    assert 'eigenfail_episodes_total{end="completed"} 2.0' in lines
    assert 'eigenfail_episodes_total{end="failed"} 1.0' in lines
    assert 'eigenfail_failures_total{method="monte_carlo"} 1.0' in lines


def test_metrics_tell_what_each_method_cost(http, store, campaign):
    store.campaigns.add_active(campaign, 1_800.0)
    spec = store.campaigns.get(campaign).spec
    lines = http.get("/metrics").text.splitlines()
    hours, usd = 0.5 * spec.instances, 0.5 * spec.instances * spec.price_usd_per_hour
    assert f'eigenfail_instance_hours_total{{method="{spec.method}"}} {hours}' in lines
    assert f'eigenfail_cost_usd_total{{method="{spec.method}"}} {usd}' in lines


def test_requests_are_counted_by_route_not_by_address(http, fields, store, monkeypatch):
    for id_ in (1, 2, 3):
        http.get(f"/api/v1/campaigns/{id_}")
    http.get("/anything/else")
    http.request("BREW", "/healthz")
    monkeypatch.setattr(store.campaigns, "page", unheard_of)
    http.get("/api/v1/campaigns")
    monkeypatch.undo()
    lines = http.get("/metrics").text.splitlines()
    counted = "eigenfail_http_requests_total"
    route = "/api/v1/campaigns/{campaign}"
    assert f'{counted}{{method="GET",route="{route}",status="404"}} 3.0' in lines
    assert f'{counted}{{method="GET",route="none",status="404"}} 1.0' in lines
    assert f'{counted}{{method="other",route="/healthz",status="405"}} 1.0' in lines
    assert f'{counted}{{method="GET",route="/api/v1/campaigns",status="500"}} 1.0' in lines


def test_metrics_see_campaigns_beyond_the_first_page(http, fields, monkeypatch):
    monkeypatch.setattr("eigenfail_services.store.campaigns.PORTION", 2)
    for _ in range(5):
        http.post("/api/v1/campaigns", json=fields)
    assert 'eigenfail_campaigns{state="queued"} 5.0' in http.get("/metrics").text.splitlines()


def unreachable():
    raise StoreUnavailable("The database does not answer.", "Start it.")


def unheard_of(*_):
    raise ZeroDivisionError("a bug of ours")


def test_workers_that_are_connected_are_listed_at_work_or_not(http, store, monkeypatch):
    told = Arrival(worker="w1", host="rack 4", pid=77, versions={"numpy": "2.4.6"})
    others = Arrival(worker="gone", host="rack 5", pid=78)
    number, gone = store.roster.arrived([told, others])
    store.roster.left([gone])
    (found,) = http.get("/api/v1/workers/present").json()["items"]
    assert (found["id"], found["worker"], found["host"]) == (number, "w1", "rack 4")
    assert found["versions"] == {"numpy": "2.4.6"}
    monkeypatch.setattr(summary, "PRESENT_S", -1)
    assert http.get("/api/v1/workers/present").json()["items"] == []
